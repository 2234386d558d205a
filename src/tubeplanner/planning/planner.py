"""From a problem to a certified trajectory, or to the reason why there is none."""

from dataclasses import replace

from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning.plan_options import REFINEMENT, STOP_AT_CORNERS, SUH_BISHOP, PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.refined_plan import refined_plan
from tubeplanner.planning.searched_plan import searched_plan
from tubeplanner.planning.stopping_plan import stopping_plan
from tubeplanner.planning.suh_bishop_plan import suh_bishop_plan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, ProgressCallback


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
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    options = options or PlanOptions()
    clock = PlanningClock(options.time_limit, progress)
    result = _planned(problem, options, clock)
    return replace(result, planning_time=clock.elapsed, stopped_by=clock.stopped_by)


def _planned(problem: PlanningProblem, options: PlanOptions, clock: PlanningClock) -> PlanResult:
    """Return the answer of the first of the allowed methods that has one."""
    branches = KnownBranches(problem, clock)
    if options.method == SUH_BISHOP:
        return suh_bishop_plan(problem, branches, options, clock)
    refines = options.method == REFINEMENT and problem.tube.visit == "ordered"
    # Under a time limit, a trajectory that stops at corners comes first, in case nothing else is
    # ready.
    corners = refined = None
    if not refines or options.time_limit is not None:
        corners = stopping_plan(problem, branches, clock)
    if refines:
        refined = refined_plan(problem, branches, options, clock)
        if refined is not None and refined.succeeded:
            return refined
    corners = corners or stopping_plan(problem, branches, clock)
    result, branch = corners.result, corners.branch
    searches = options.method != STOP_AT_CORNERS and clock.stopped_by is None
    if searches and branch is not None and branch.moving_segments:
        result = searched_plan(problem, branch, corners, options, clock)
    if clock.stopped_by == "interrupt" and not result.succeeded:
        raise KeyboardInterrupt
    return _with_better_reason(result, refined)


def _with_better_reason(result: PlanResult, refined: PlanResult | None) -> PlanResult:
    """Return a result; if links are in the way, only those that refinement could not move away."""
    blocked = PlanStatus.TUBE_BLOCKED
    if refined is not None and result.status is blocked and refined.status is blocked:
        return replace(refined, search=result.search)
    return result
