"""From a problem to a certified trajectory, or to the reason why there is none."""

from dataclasses import replace
from functools import partial

from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.planning.necessary_conditions import require_possible
from tubeplanner.planning.plan_options import REFINEMENT, STOP_AT_CORNERS, SUH_BISHOP, PlanOptions
from tubeplanner.planning.plan_result import PlanResult, stopped_result
from tubeplanner.planning.refined_plan import refined_plan
from tubeplanner.planning.searched_plan import searched_plan
from tubeplanner.planning.stopping_plan import StoppingPlan, stopping_plan
from tubeplanner.planning.suh_bishop_plan import suh_bishop_plan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, ProgressCallback, until_stopped
from tubeplanner.verification.refusal import require_free


def plan(
    problem: PlanningProblem,
    options: PlanOptions | None = None,
    progress: ProgressCallback | None = None,
) -> PlanResult:
    """Plan a trajectory and certify it.

    Args:
        problem: The planning problem.
        options: How to plan.
        progress: Called as each stage begins, and many times during the search.

    Returns:
        A result whose status is success only if the certificate passed; else its message and place
        say what is in the way. Ctrl-C ends the search with the best so far.

    Raises:
        ProblemError: The problem is none.
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    PlanningProblem.require(problem)
    options = options or PlanOptions()
    clock = PlanningClock(options.time_limit, progress)
    result, stopped_by = until_stopped(partial(_planned, problem.joined, options, clock))
    if result is None:
        result = stopped_result(clock, stopped_by or "interrupt", options.method)
    if result.status is PlanStatus.INTERRUPTED:
        raise KeyboardInterrupt
    notes = (*problem.tube.notes, *result.notes)
    return replace(result, planning_time=clock.elapsed, notes=notes)


def _planned(problem: PlanningProblem, options: PlanOptions, clock: PlanningClock) -> PlanResult:
    """Return the answer of the first method in question that has one.

    Raises:
        TimeLimitReached: Before there was anything; likewise KeyboardInterrupt.
    """
    branches = KnownBranches(problem, clock)
    try:
        require_possible(problem, branches)
    except Infeasible as reason:
        return PlanResult(reason.status, str(reason), reason.place, options.method)
    if options.method == SUH_BISHOP:
        return suh_bishop_plan(problem, branches, options, clock)
    if options.method != REFINEMENT or problem.tube.visit != "ordered":
        return _searched(problem, stopping_plan(problem, branches, clock), options, clock)
    # Under a time limit, stopping at corners comes first, in case nothing else is found in time.
    limited = options.time_limit is not None
    corners = stopping_plan(problem, branches, clock) if limited else None
    refined = refined_plan(problem, branches, options, clock)
    if refined is not None and (refined.succeeded or refined.stopped_by is not None):
        if refined.succeeded:
            return refined
        return _after_stop(problem, branches, corners, refined, clock)
    corners = corners or stopping_plan(problem, branches, clock)
    return _with_better_reason(_searched(problem, corners, options, clock), refined)


def _after_stop(
    problem: PlanningProblem,
    branches: KnownBranches,
    corners: StoppingPlan | None,
    refined: PlanResult,
    clock: PlanningClock,
) -> PlanResult:
    """Return what there is when refinement was stopped and left nothing certified."""
    if corners is None and branches.has_any:  # along it, corners take little time
        silent = PlanningClock(None, None)  # its callback would only interrupt again
        corners = stopping_plan(problem, branches.under(silent), silent)
    if corners is None or (refined.stopped_by == "interrupt" and not corners.result.succeeded):
        return stopped_result(clock, refined.stopped_by or "interrupt", REFINEMENT)
    result = _with_better_reason(corners.result, refined)
    return replace(result, stopped_by=refined.stopped_by)


def _searched(
    problem: PlanningProblem, corners: StoppingPlan, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    """Return what branch and bound makes of a branch, or stopping at corners alone."""
    branch = corners.branch
    is_asked = options.method != STOP_AT_CORNERS and corners.result.stopped_by is None
    if not is_asked or branch is None or not branch.moving_segments:
        return corners.result
    try:
        require_free(problem, "goal", branch.goal)
    except Infeasible:  # where all trajectories of the search would end
        return corners.result
    return searched_plan(problem, branch, corners, options, clock)


def _with_better_reason(result: PlanResult, refined: PlanResult | None) -> PlanResult:
    """Return a result; if links are in the way, only those that refinement could not move away."""
    blocked = PlanStatus.TUBE_BLOCKED
    if refined is not None and result.status is blocked and refined.status is blocked:
        return replace(refined, search=result.search)
    return result
