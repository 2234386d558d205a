"""Planning by the method of Suh & Bishop (1988): both its phases and no other method."""

from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.branches.reference_branch import ReferenceBranch, redundancy_rules
from tubeplanner.constraints.time_scaling import scaled_to_limits
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_options import SUH_BISHOP, PlanOptions
from tubeplanner.planning.plan_result import (
    PlanResult,
    judged_result,
    refused_result,
    stopped_result,
)
from tubeplanner.planning.searched_plan import run_search
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, Progress, StoppedBy, until_stopped
from tubeplanner.suh_bishop.knot_trajectory import KnotTrajectory
from tubeplanner.suh_bishop.suh_bishop import SuhBishop
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.certificate import Certificate
from tubeplanner.waypoint_search.branch_and_bound import BranchAndBound
from tubeplanner.waypoint_search.candidate_waypoints import candidate_waypoints
from tubeplanner.waypoint_search.waypoint_interpolation import sequential_quartics


def suh_bishop_plan(
    problem: PlanningProblem, branches: KnownBranches, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    """Return what both phases find, or why the first one finds nothing.

    Tries rules for redundant joints in turn until phase 1 has a certified trajectory.

    Raises:
        TimeLimitReached: Before there was anything; likewise KeyboardInterrupt.
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
    """Return what both phases find along a branch.

    Raises:
        Infeasible: Nothing is to be moved, or gravity is too strong for phase 1's trajectories.
        TimeLimitReached: Before phase 1 began.
    """
    if not branch.moving_segments:
        message = "the start is the goal: there is nothing to move"
        raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Place(), proved=True)
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
        nothing = _nothing_found(search, options, stopped_by)
        return replace(nothing, search=search.statistics, stopped_by=stopped_by)
    knots = waypoints[list(search.best_waypoints)]
    candidate = KnotTrajectory(knots, sequential_quartics, search.best)
    phase_two = _phase_two(problem, candidate, search.certificate, options, clock)
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

    Not on quartics through all of them: those swing ever farther, and soon beyond all numbers.
    """
    rows = [np.diff(waypoints, axis=0), waypoints[:-1]]
    lines = JointTrajectory(problem.robot.joint_names, np.arange(len(waypoints)), rows)
    scaled_to_limits(problem, lines)


def _phase_two(
    problem: PlanningProblem,
    candidate: KnotTrajectory,
    certificate: Certificate,
    options: PlanOptions,
    clock: PlanningClock,
) -> SuhBishop:
    """Return phase 2, ready to run; its checkpoint ends it at the time limit or at Ctrl-C."""

    def checkpoint() -> None:
        now = phase_two.statistics
        clock.announce(Progress("moving knots", now.nodes, None, phase_two.best.duration))
        clock.check()

    phase_two = SuhBishop(problem, candidate, certificate, options.suh_bishop, checkpoint)
    return phase_two


def _nothing_found(
    search: BranchAndBound, options: PlanOptions, stopped_by: StoppedBy | None
) -> PlanResult:
    """Say that phase 1 ended without a trajectory."""
    if stopped_by == "time_limit":
        message = "the time limit passed before phase 1 found a trajectory"
        return PlanResult(PlanStatus.TIME_LIMIT, message, Place(), SUH_BISHOP)
    message = (
        f"phase 1 found no certified trajectory through {options.candidate_points} points of the "
        f"reference path ({search.statistics}); another number of candidate points, or a wider "
        "tube, may have one"
    )
    return refused_result(Infeasible(PlanStatus.NO_TRAJECTORY, message, Place()), SUH_BISHOP)
