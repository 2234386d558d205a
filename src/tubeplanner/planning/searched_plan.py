"""Planning by branch and bound: the first phase of the paper."""

from dataclasses import replace

import numpy as np

from tubeplanner.branches.reference_branch import ReferenceBranch
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_options import BRANCH_AND_BOUND, PlanOptions
from tubeplanner.planning.plan_result import PlanResult, judged_result
from tubeplanner.planning.stopping_plan import StoppingPlan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock, Progress
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
    known, search = corners.result, None
    try:
        clock.enter("candidate points on the reference path")
        search = BranchAndBound(
            problem,
            candidate_waypoints(problem, branch, options.candidate_points, clock.check),
            upper_bound=np.inf if corners.trajectory is None else corners.trajectory.duration,
            node_budget=options.node_budget,
            checkpoint=clock.check,
        )
        run_search(search, known.duration, clock)
    except KeyboardInterrupt:
        if not known.succeeded and (search is None or search.best is None):
            raise
        clock.stopped_by = "interrupt"
    except Infeasible:  # the time limit, before the search began
        clock.stopped_by = "time_limit"
    return _better(problem, known, search, options, clock)


def run_search(search: BranchAndBound, known: float | None, clock: PlanningClock) -> None:
    """Search until there is nothing better, or until time or budget end.

    Args:
        search: Its best trajectory is the answer.
        known: Duration of the best trajectory known before [s].
        clock: Receives the search's progress; knows what stopped it.
    """
    while not search.finished:
        if clock.remaining <= 0:
            clock.stopped_by = "time_limit"
            return
        search.expand()
        now = search.statistics
        best = now.best_duration or known
        clock.announce(Progress("branch and bound", now.nodes, now.lower_bound, best))


def _better(
    problem: PlanningProblem,
    known: PlanResult,
    search: BranchAndBound | None,
    options: PlanOptions,
    clock: PlanningClock,
) -> PlanResult:
    """Return the search's answer, or else the one known before, with a message."""
    result = known
    if search is not None and search.best is not None and search.certificate is not None:
        result = judged_result(
            problem, search.best, search.certificate, search.certificate_time, BRANCH_AND_BOUND
        )
    elif clock.stopped_by == "time_limit" and not known.succeeded:
        message = "the time limit passed before a trajectory was found"
        result = PlanResult(PlanStatus.TIME_LIMIT, message, Place(), BRANCH_AND_BOUND)
    elif clock.stopped_by is None and known.succeeded:
        message = f"{result.message}; branch and bound found nothing faster"
        result = replace(result, message=message)
    if search is None:
        return result
    if search.statistics.budget_reached:
        message = f"{result.message}; the search ended at its budget of {options.node_budget} nodes"
        result = replace(result, message=message)
    return replace(result, search=search.statistics)
