"""Attempts without refinement: stops at corners, branch and bound, the method of 1988."""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import require_free
from tubeplanner.first_guess.branch_and_bound import BranchAndBound
from tubeplanner.first_guess.branches import (
    KnownBranches,
    RedundancyRule,
    ReferenceBranch,
    redundancy_rules,
)
from tubeplanner.first_guess.knot_modification import KnotTrajectory
from tubeplanner.first_guess.stop_at_corners import stop_at_corners
from tubeplanner.first_guess.suh_bishop import SuhBishop
from tubeplanner.first_guess.waypoints import candidate_waypoints, sequential_quartics
from tubeplanner.limits.speed_limits import scaled_to_limits
from tubeplanner.outcome import (
    Infeasible,
    Location,
    PlanningClock,
    PlanStatus,
    Progress,
    StoppedBy,
    TimeLimitReached,
    until_stopped,
)
from tubeplanner.planning.options import BRANCH_AND_BOUND, STOP_AT_CORNERS, SUH_BISHOP, PlanOptions
from tubeplanner.planning.result import (
    PlanResult,
    certified_result,
    judged_result,
    refused_result,
    stopped_result,
)
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import resting

_SAME_END = 1e-9  # [rad or m] between start and goal, and [m] outside the goal's ball
# Trajectories, and moves of cycles, have a duration [s]; parts of some seconds still resolve this.
_REST = 1e-6


def resting_plan(
    problem: PlanningProblem, ends: FloatArray, method: str, clock: PlanningClock
) -> PlanResult | None:
    """Return the certified rest at the start, if the arm may end where it begins; else None.

    `ends` are the configurations of the start and of a given goal, shape (1 or 2, n). A tube that
    leads out and home is no such problem: the certificate finds the arm nowhere else.
    """
    region = problem.open_goal
    if region is None:
        away = float(abs(ends[-1] - ends[0]).max())
    else:
        away = -region.margin(problem.robot.tool_position(ends[:1])[0])
    if away > _SAME_END:
        return None
    still = resting(problem.robot.joint_names, ends[0], _REST)
    result = certified_result(problem, still, method, clock)
    if not result.succeeded:
        return None
    where = "start and goal are the same configuration"
    if region is not None:
        where = "the start is inside the goal's region"
    note = f"there is nothing to do: {where}; the arm rests for {still.duration:g} s"
    return replace(result, notes=(note, *result.notes))


# ---- Planning without refinement or search: the arm rests at every reference point.


@dataclass(frozen=True, eq=False)
class StoppingPlan:
    """The result of stopping at corners, certified or not, with its branch and trajectory."""

    result: PlanResult
    branch: ReferenceBranch | None = None
    trajectory: JointTrajectory | None = None


def stopping_plan(
    problem: PlanningProblem,
    branches: KnownBranches,
    clock: PlanningClock,
    *,
    every_rule: bool = True,
) -> StoppingPlan:
    """Return the first certified trajectory with stops at corners, or a refusal.

    Rules for redundant joints are tried in turn, or the most natural one alone. A refusal has the
    reason of that rule, AS_NEEDED if every rule is tried; branch and trajectory are the first ones.
    """
    reasons: dict[RedundancyRule, PlanResult] = {}
    first_branch = first_trajectory = None
    rules = redundancy_rules(problem)
    for rule in rules if every_rule else rules[:1]:
        try:
            branch = branches.by_rule(rule)
            clock.enter("trajectory along it, stopping at corners")
            first_branch = first_branch or branch
            trajectory = stop_at_corners(problem, branch, clock.check)
            first_trajectory = first_trajectory or trajectory
            clock.enter("certificate")
            result = certified_result(problem, trajectory, STOP_AT_CORNERS, clock)
        except TimeLimitReached:
            return StoppingPlan(stopped_result(clock, "time_limit", STOP_AT_CORNERS))
        except Infeasible as reason:
            result = refused_result(reason, STOP_AT_CORNERS)
        if result.succeeded:
            return StoppingPlan(result, branch, trajectory)
        reasons[rule] = result
    most_natural = RedundancyRule.AS_NEEDED if every_rule else rules[0]
    return StoppingPlan(reasons[most_natural], first_branch, first_trajectory)


# ---- Planning by branch and bound: the first phase of the paper.


def searched_plan(
    problem: PlanningProblem, corners: StoppingPlan, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    """Return the result of branch and bound along a branch, if faster than stops at corners.

    Stops at corners bound the search even if their certificate failed: without a bound it takes
    very long. Nothing is searched without a branch that moves to a free goal.
    """
    branch = corners.branch
    if corners.result.stopped_by is not None or branch is None or not branch.moving_segments:
        return corners.result
    try:
        require_free(problem, "goal", branch.goal)
    except Infeasible:  # all trajectories of the search would end there
        return corners.result

    def prepared() -> BranchAndBound:
        clock.enter("candidate points on the reference path")
        return BranchAndBound(
            problem,
            candidate_waypoints(problem, branch, options.candidate_points, clock.check),
            upper_bound=np.inf if corners.trajectory is None else corners.trajectory.duration,
            node_budget=options.node_budget,
            checkpoint=clock.check,
        )

    search, stopped_by = until_stopped(prepared)
    if search is not None:
        stopped_by = run_search(search, corners.result.duration, clock)
    has_answer = corners.result.succeeded or (search is not None and search.best is not None)
    if stopped_by == "interrupt" and not has_answer:
        return stopped_result(clock, stopped_by, BRANCH_AND_BOUND)
    result = corners.result
    if search is not None and search.best is not None and search.certificate is not None:
        result = judged_result(
            problem, search.best, search.certificate, search.certificate_time, BRANCH_AND_BOUND
        )
    elif stopped_by == "time_limit" and not result.succeeded:
        message = "the time limit passed before a trajectory was found"
        result = PlanResult(PlanStatus.TIME_LIMIT, message, Location(), BRANCH_AND_BOUND)
    elif stopped_by is None and result.succeeded:
        message = f"{result.message}; branch and bound found nothing faster"
        result = replace(result, message=message)
    result = replace(result, stopped_by=stopped_by)
    if search is None:
        return result
    if search.statistics.budget_reached:
        message = f"{result.message}; the search ended at its budget of {options.node_budget} nodes"
        result = replace(result, message=message)
    return replace(result, search=search.statistics)


def run_search(
    search: BranchAndBound, known: float | None, clock: PlanningClock
) -> StoppedBy | None:
    """Search until no node is better or the budget is used; return the cause of an earlier stop.

    `known` is the duration of the best trajectory before the search [s].
    """

    def work() -> None:
        while not search.finished:
            clock.check()
            search.expand()
            now = search.statistics
            best = now.best_duration or known
            clock.announce(Progress("branch and bound", now.nodes, now.lower_bound, best))

    return until_stopped(work)[1]


# ---- Planning by the method of Suh & Bishop (1988): both phases and no other method.


def suh_bishop_plan(
    problem: PlanningProblem, branches: KnownBranches, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    """Return the result of both phases, or the refusal of phase 1.

    Tries rules for redundant joints in turn until phase 1 has a certified trajectory.
    """
    reasons = []
    for rule in redundancy_rules(problem):
        try:
            result = _along(problem, branches.by_rule(rule), options, clock)
        except Infeasible as reason:
            result = refused_result(reason, SUH_BISHOP)
        if result.succeeded or result.stopped_by is not None:
            return result
        reasons.append(result)
    return reasons[0]


def _along(
    problem: PlanningProblem, branch: ReferenceBranch, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    if not branch.moving_segments:
        message = "the start is the goal: there is nothing to move"
        raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Location())
    clock.enter("candidate points on the reference path")
    waypoints = candidate_waypoints(problem, branch, options.candidate_points, clock.check)
    search = BranchAndBound(
        problem, waypoints, node_budget=options.node_budget, checkpoint=clock.check
    )
    stopped_by = run_search(search, None, clock)
    if search.best is None and stopped_by == "interrupt":
        return stopped_result(clock, stopped_by, SUH_BISHOP)
    if search.best is None or search.certificate is None:
        _require_held(problem, waypoints)
        if stopped_by == "time_limit":
            message = "the time limit passed before phase 1 found a trajectory"
            result = PlanResult(PlanStatus.TIME_LIMIT, message, Location(), SUH_BISHOP)
        else:
            message = (
                f"phase 1 found no certified trajectory through {options.candidate_points} points "
                f"of the reference path ({search.statistics}); another number of candidate points, "
                "or a wider tube, may have one"
            )
            reason = Infeasible(PlanStatus.NO_TRAJECTORY, message, Location())
            result = refused_result(reason, SUH_BISHOP)
        return replace(result, search=search.statistics, stopped_by=stopped_by)
    knots = waypoints[list(search.best_waypoints)]
    candidate = KnotTrajectory(knots, sequential_quartics, search.best)

    def checkpoint() -> None:
        now = phase_two.statistics
        clock.announce(Progress("moving knots", now.nodes, None, phase_two.best.duration))
        clock.check()

    certificate, settings = search.certificate, options.suh_bishop
    phase_two = SuhBishop(problem, candidate, certificate, settings, checkpoint)
    if stopped_by is None:
        _, stopped_by = until_stopped(phase_two.run)
    certificate_time = phase_two.certificate_time or search.certificate_time
    result = judged_result(
        problem, phase_two.best.trajectory, phase_two.certificate, certificate_time, SUH_BISHOP
    )
    statistics = phase_two.statistics
    message = result.message
    if statistics.budget_reached:
        message += "; searches of phase 2 ended at their shares of the node budget"
    return replace(
        result,
        message=message,
        search=search.statistics,
        phase_two=statistics,
        stopped_by=stopped_by,
    )


def _require_held(problem: PlanningProblem, waypoints: FloatArray) -> None:
    """Raise Infeasible if gravity alone is too strong on the joint lines between waypoints (M, n).

    Quartics through all waypoints would not do: they swing ever farther, beyond all numbers.
    """
    rows = [np.diff(waypoints, axis=0), waypoints[:-1]]
    lines = JointTrajectory(problem.robot.joint_names, np.arange(len(waypoints)), rows)
    scaled_to_limits(problem, lines)
