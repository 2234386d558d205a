"""The order of attempts at one problem, and the result when all fail."""

from dataclasses import replace
from typing import TypeGuard

from tubeplanner.certificate.refusal import require_free
from tubeplanner.first_guess.branches import KnownBranches
from tubeplanner.optimizer.starts import RefinedMotion
from tubeplanner.outcome import Infeasible, PlanningClock, PlanStatus
from tubeplanner.planning.diagnosis import certain_blocking_sample, refined_diagnosis
from tubeplanner.planning.necessary_conditions import require_possible
from tubeplanner.planning.options import REFINEMENT, STOP_AT_CORNERS, SUH_BISHOP, PlanOptions
from tubeplanner.planning.refined_plan import RefinedPlans, continued_plan, narrowed_plan
from tubeplanner.planning.result import PlanResult, refused_result, stopped_result
from tubeplanner.planning.waypoint_plans import (
    StoppingPlan,
    resting_plan,
    searched_plan,
    stopping_plan,
    suh_bishop_plan,
)
from tubeplanner.task.problem import PlanningProblem

_CONTINUED = "planned from the last motion, not afresh"
_PROVIDED_AT = 0.25  # of the time limit


def attempted_plan(
    problem: PlanningProblem, last: RefinedMotion | None, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    """Return the answer of the first attempt with an answer, or the refusal.

    Raises:
        TimeLimitReached: Before there was a result; likewise KeyboardInterrupt.
    """
    branches = KnownBranches(problem, clock)
    try:
        require_possible(problem, branches)
    except Infeasible as reason:
        return refused_result(reason, options.method)
    resting = resting_plan(problem, branches.require_ends(), options.method, clock)
    if resting is not None:
        return resting
    result = _attempted(problem, branches, options, clock, last)
    if result.proved is not False or result.starts_tried:
        return result
    return replace(result, starts_tried=branches.tried)


def _attempted(
    problem: PlanningProblem,
    branches: KnownBranches,
    options: PlanOptions,
    clock: PlanningClock,
    last: RefinedMotion | None,
) -> PlanResult:
    """Return the answer of the first attempt with an answer, or the last refusal.

    Raises:
        TimeLimitReached: Before there was a result; likewise KeyboardInterrupt.
    """
    if options.method == SUH_BISHOP:
        return suh_bishop_plan(problem, branches, options, clock)
    if options.method != REFINEMENT or problem.tube.visit != "ordered":
        return _searched(problem, stopping_plan(problem, branches, clock), options, clock)
    continued = None if last is None else continued_plan(problem, last, clock)
    if continued is not None:
        notes = (*continued.notes, _CONTINUED) if continued.succeeded else continued.notes
        return replace(continued, notes=notes)
    if not options.persistent:
        blocked = certain_blocking_sample(problem, branches.require_ends()[0], clock.check)
        if blocked is not None:
            return refused_result(blocked, REFINEMENT)
    corners: StoppingPlan | None = None

    def stop_at_corners() -> None:
        # After a part of the time: an answer, in case no better one comes in time.
        nonlocal corners
        if corners is None and clock.used >= _PROVIDED_AT:
            corners = stopping_plan(problem, branches, clock)

    plans = RefinedPlans(problem, branches, options, clock, stop_at_corners)
    refined = plans.after_all() if options.persistent else plans.after_one()
    if not options.persistent and not _is_last(refined):
        corners = corners or stopping_plan(problem, branches, clock, every_rule=False)
        if not corners.result.succeeded:
            return _with_better_reason(corners.result, refined)
        refined = plans.after_all()
    if _is_last(refined):
        if refined.succeeded:
            return refined
        # Stopped before a motion was certified.
        if corners is None and branches.has_any:  # along a branch, corners take little time
            silent = PlanningClock(None, None)  # the callback would only interrupt again
            corners = stopping_plan(problem, branches.under(silent), silent)
        if corners is None or (refined.stopped_by == "interrupt" and not corners.result.succeeded):
            return stopped_result(clock, refined.stopped_by or "interrupt", REFINEMENT)
        result = _with_better_reason(corners.result, refined)
        return replace(result, stopped_by=refined.stopped_by)
    corners = corners or stopping_plan(problem, branches, clock, every_rule=True)
    if corners.result.succeeded and corners.result.stopped_by is None:
        narrowed = narrowed_plan(problem, options, clock)
        if narrowed is not None:
            return narrowed
    result = _with_better_reason(_searched(problem, corners, options, clock), refined)
    return refined_diagnosis(problem, branches, result, clock)


def _is_last(refined: PlanResult | None) -> TypeGuard[PlanResult]:
    """Return True if no other method is tried after refinement's result."""
    return refined is not None and (refined.succeeded or refined.stopped_by is not None)


def _searched(
    problem: PlanningProblem, corners: StoppingPlan, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    """Return the result of branch and bound along a branch, or of stopping at corners alone."""
    branch = corners.branch
    searches = options.method != STOP_AT_CORNERS and corners.result.stopped_by is None
    if not searches or branch is None or not branch.moving_segments:
        return corners.result
    try:
        require_free(problem, "goal", branch.goal)
    except Infeasible:  # all trajectories of the search would end there
        return corners.result
    return searched_plan(problem, branch, corners, options, clock)


def _with_better_reason(result: PlanResult, refined: PlanResult | None) -> PlanResult:
    """Return a result, with refinement's reason if links block both."""
    blocked = PlanStatus.TUBE_BLOCKED
    if refined is not None and result.status is blocked and refined.status is blocked:
        return replace(refined, search=result.search)
    return result
