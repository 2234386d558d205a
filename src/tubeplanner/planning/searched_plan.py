"""Planning by branch and bound: the first phase of the paper."""

from dataclasses import replace

import numpy as np

from tubeplanner.branches.reference_branch import ReferenceBranch
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.plan_options import BRANCH_AND_BOUND, PlanOptions
from tubeplanner.planning.plan_result import PlanResult, judged_result, stopped_result
from tubeplanner.planning.stopping_plan import StoppingPlan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, Progress, StoppedBy, until_stopped
from tubeplanner.waypoint_search.branch_and_bound import BranchAndBound
from tubeplanner.waypoint_search.candidate_waypoints import candidate_waypoints


def searched_plan(
    problem: PlanningProblem,
    branch: ReferenceBranch,
    corners: StoppingPlan,
    options: PlanOptions,
    clock: PlanningClock,
) -> PlanResult:
    """Return what branch and bound finds, if it is faster than stopping at corners.

    Even if that one failed its certificate: a search without a bound takes very long.
    """
    known = corners.result

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
        stopped_by = run_search(search, known.duration, clock)
    has_answer = known.succeeded or (search is not None and search.best is not None)
    if stopped_by == "interrupt" and not has_answer:
        return stopped_result(clock, stopped_by, BRANCH_AND_BOUND)
    return _better(problem, replace(known, stopped_by=stopped_by), search, options)


def run_search(
    search: BranchAndBound, known: float | None, clock: PlanningClock
) -> StoppedBy | None:
    """Search until there is nothing better or the budget is used; return what stopped it earlier.

    Args:
        search: Its best trajectory is the answer.
        known: Duration of the best trajectory known before [s].
        clock: Announces how far the search has come.
    """

    def work() -> None:
        while not search.finished:
            clock.check()
            search.expand()
            now = search.statistics
            best = now.best_duration or known
            clock.announce(Progress("branch and bound", now.nodes, now.lower_bound, best))

    return until_stopped(work)[1]


def _better(
    problem: PlanningProblem,
    known: PlanResult,
    search: BranchAndBound | None,
    options: PlanOptions,
) -> PlanResult:
    """Return the search's answer, or else what was known before, with what the search did."""
    result, stopped_by = known, known.stopped_by
    if search is not None and search.best is not None and search.certificate is not None:
        result = judged_result(
            problem, search.best, search.certificate, search.certificate_time, BRANCH_AND_BOUND
        )
    elif stopped_by == "time_limit" and not known.succeeded:
        message = "the time limit passed before a trajectory was found"
        result = PlanResult(PlanStatus.TIME_LIMIT, message, Place(), BRANCH_AND_BOUND)
    elif stopped_by is None and known.succeeded:
        message = f"{result.message}; branch and bound found nothing faster"
        result = replace(result, message=message)
    result = replace(result, stopped_by=stopped_by)
    if search is None:
        return result
    if search.statistics.budget_reached:
        message = f"{result.message}; the search ended at its budget of {options.node_budget} nodes"
        result = replace(result, message=message)
    return replace(result, search=search.statistics)
