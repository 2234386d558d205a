"""The attempts at a problem: their order, when each is made, and the result when all fail."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.first_guess.branches import KnownBranches
from tubeplanner.geometry.tube.bands import BEST, REQUIRED
from tubeplanner.optimizer.starts import RefinedMotion
from tubeplanner.outcome import (
    Infeasible,
    Location,
    PlanningClock,
    PlanStatus,
    StoppedBy,
    TimeLimitReached,
)
from tubeplanner.planning.diagnosis import blocking_sample, refined_diagnosis, require_possible
from tubeplanner.planning.free_plans import free_plan
from tubeplanner.planning.options import (
    BRANCH_AND_BOUND,
    METHODS,
    QUALITIES,
    REFINEMENT,
    STOP_AT_CORNERS,
    SUH_BISHOP,
    PlanOptions,
)
from tubeplanner.planning.refined_plan import RefinedPlans, continued_plan, narrowed_plan
from tubeplanner.planning.result import PlanResult, refused_result, stopped_result
from tubeplanner.planning.route_plans import route_plan
from tubeplanner.planning.steady_plans import (
    StretchSpeeds,
    bend_refusal,
    dip_refusal,
    steadiest_plan,
    without_floors,
)
from tubeplanner.planning.waypoint_plans import (
    StoppingPlan,
    resting_plan,
    searched_plan,
    stopping_plan,
    suh_bishop_plan,
)
from tubeplanner.task.problem import PlanningProblem

_CONTINUED = "planned from the last motion, not afresh"
# Fraction of the time limit after which refinement pauses for stops at corners.
_RESERVE_AT = 0.25
# Fraction by which a motion in fewer segments is faster if there may be one in still fewer.
_WORTHWHILE = 0.005
# Of a band's lower end: less than this share is given up before other starts are tried.
_SURELY_LESS = 0.88


class _Planning:
    """The state of the attempts at a problem.

    Attributes:
        is_union: True if refinement's motion, which visits segments in order, competes with others.
        is_brief: True if refinement is to give up early.
        corners: Stops at corners, after that attempt or in reserve.
        refined: The best result of refinement so far.
        latest: The latest motion in a union, until it is refined in the segments that it visits.
        fastest: The fastest motion in a union so far.
        refusal: The refusal of all attempts before the diagnosis.
        has_bands: True if the tube has speed bands, which stops break.
        has_floors: True if they are required.
        upper: The speeds of a motion with the upper ends of required bands alone.
    """

    corners: StoppingPlan | None = None
    refined: PlanResult | None = None
    latest: PlanResult | None = None
    fastest: PlanResult | None = None
    refusal: PlanResult | None = None
    upper: StretchSpeeds | None = None

    def __init__(
        self,
        problem: PlanningProblem,
        last: RefinedMotion | None,
        options: PlanOptions,
        clock: PlanningClock,
    ) -> None:
        self.problem, self.last, self.options, self.clock = problem, last, options, clock
        has_no_order = problem.tube.visit == "any" and problem.tube.segment_count > 1
        self.is_union = options.method == REFINEMENT and has_no_order
        is_refined_in_order = options.method == REFINEMENT and not has_no_order
        self.is_brief = is_refined_in_order and not options.persistent
        self.has_bands = bool(problem.tube.stretches)
        self.has_floors = self.has_bands and problem.tube.process.steady == REQUIRED
        self.branches = KnownBranches(problem, clock)
        self.starts = RefinedPlans(problem, self.branches, options, clock, self._fill_reserve)

    def stopping(self, *, every_rule: bool = True) -> StoppingPlan:
        """Return stops at corners, from the reserve if they are there."""
        if self.corners is None:
            self.corners = stopping_plan(
                self.problem, self.branches, self.clock, every_rule=every_rule
            )
        return self.corners

    @property
    def has_none_in_order(self) -> bool:
        """True if refinement has no motion in a union and is to go on."""
        has_motion = self.refined is not None and self.refined.succeeded
        return self.options.persistent and not has_motion

    @property
    def can_stop_at_corners(self) -> bool:
        """True if stops at corners are certified, the clock not stopped."""
        result = self.stopping().result
        return result.succeeded and result.stopped_by is None

    def compared(self, result: PlanResult | None) -> PlanResult | None:
        """Return a result; in a union None, as other motions may be faster, unless stopped."""
        if result is None or not self.is_union:
            return result
        if result.succeeded:
            self.latest = result
        known, search = self.fastest, result.search
        if known is not None:
            search = search or known.search
            is_faster = result.duration is not None and result.duration < (known.duration or 0.0)
            self.fastest = replace(result if is_faster else known, search=search)
        elif result.succeeded:
            self.fastest = result
        if result.stopped_by is None:
            return None
        return result if self.fastest is None else self.stopped(result.stopped_by)

    def stopped(self, stopped_by: StoppedBy) -> PlanResult:
        """Return the fastest motion in a union, as the answer of stopped planning."""
        assert self.fastest is not None
        return replace(self.fastest, stopped_by=stopped_by)

    def _fill_reserve(self) -> None:
        if self.clock.used >= _RESERVE_AT and not self.has_bands:
            self.stopping()

    def without_motion(self, stopped: PlanResult) -> PlanResult:
        """Return the result of refinement that was stopped: the reserve, or the reason."""
        if self.fastest is not None:
            return self.stopped(stopped.stopped_by or "interrupt")
        if (
            self.corners is None and self.branches.has_any and not self.has_bands
        ):  # then corners take little time
            silent = PlanningClock(None, None)  # the callback would only interrupt again
            self.corners = stopping_plan(self.problem, self.branches.under(silent), silent)
        stopped_by, corners = stopped.stopped_by or "interrupt", self.corners
        if corners is None or (stopped_by == "interrupt" and not corners.result.succeeded):
            return stopped_result(self.clock, stopped_by, REFINEMENT)
        return replace(self.better_reason(corners.result), stopped_by=stopped_by)

    def better_reason(self, result: PlanResult) -> PlanResult:
        """Return a result, with refinement's reason if links block both."""
        refined, blocked = self.refined, PlanStatus.TUBE_BLOCKED
        if refined is not None and result.status is blocked and refined.status is blocked:
            return replace(refined, search=result.search)
        return result


def _necessary_conditions(state: _Planning) -> None:
    require_possible(state.problem, state.branches)


def _rest(state: _Planning) -> PlanResult | None:
    ends = state.branches.require_ends()
    return resting_plan(state.problem, ends, state.options.method, state.clock)


def _both_phases_of_1988(state: _Planning) -> PlanResult:
    return suh_bishop_plan(state.problem, state.branches, state.options, state.clock)


def _last_motion(state: _Planning) -> PlanResult | None:
    assert state.last is not None
    result = continued_plan(state.problem, state.last, state.clock)
    if result is None or not result.succeeded:
        return result
    return replace(result, notes=(*result.notes, _CONTINUED))


def _certain_obstruction(state: _Planning) -> None:
    start = state.branches.require_ends()[0]
    reason = blocking_sample(state.problem, start, Location(), state.clock.check, is_certain=True)
    if reason is not None:
        raise reason


def _first_start(state: _Planning) -> PlanResult | None:
    return _refined(state, state.starts.after_one())


def _every_start(state: _Planning) -> PlanResult | None:
    return _refined(state, state.starts.after_all())


def _refined(state: _Planning, result: PlanResult | None) -> PlanResult | None:
    state.refined = result
    if result is None or result.succeeded:
        return state.compared(result)
    return None if result.stopped_by is None else state.without_motion(result)


def _stops_at_corners(state: _Planning) -> PlanResult | None:
    result = state.stopping(every_rule=not state.is_brief).result
    if state.options.method == STOP_AT_CORNERS:
        return result
    is_enough = state.is_brief and not result.succeeded
    return state.better_reason(result) if is_enough else None


def _narrower_tubes(state: _Planning) -> PlanResult | None:
    return state.compared(narrowed_plan(state.problem, state.options, state.clock))


def _visited_segments(state: _Planning) -> PlanResult | None:
    slower = np.inf
    while (motion := state.latest) is not None:
        state.latest, duration = None, motion.duration or 0.0
        if duration > (1 - _WORTHWHILE) * slower:
            return None
        slower, result = duration, state.starts.in_visited_segments(motion)
        if (answer := state.compared(result)) is not None:
            return answer
    return None


def _search(state: _Planning) -> PlanResult | None:
    result = searched_plan(state.problem, state.stopping(), state.options, state.clock)
    state.refusal = result = state.better_reason(result)
    if state.is_union:
        return state.compared(result)
    return result if result.succeeded or state.options.method != REFINEMENT else None


def _along_route(state: _Planning) -> PlanResult:
    planned = free_plan if state.problem.tube.route is None else route_plan
    return planned(state.problem, state.options, state.clock)


def _upper_ends(state: _Planning) -> PlanResult | None:
    problem = without_floors(state.problem)
    branches, clock = KnownBranches(problem, state.clock), state.clock
    starts = RefinedPlans(problem, branches, state.options, clock)
    result = starts.after_one() if state.is_brief else starts.after_all()
    if result is not None and result.stopped_by is not None and not result.succeeded:
        return stopped_result(clock, result.stopped_by, REFINEMENT)
    if result is None or result.trajectory is None or result.motion is None:
        return None
    state.upper = StretchSpeeds(state.problem, result.trajectory)
    tried = state.branches.tried
    enough = 0.0 if QUALITIES[state.options.quality].every_start else _SURELY_LESS
    if (reason := bend_refusal(state.upper, tried, enough)) is not None:
        raise reason
    continued = continued_plan(state.problem, result.motion, clock)
    if continued is not None:
        return continued
    if (reason := dip_refusal(state.upper, tried, enough)) is not None:
        raise reason
    return None


def _outside_bands(state: _Planning) -> PlanResult | None:
    if state.upper is not None:
        tried = state.branches.tried
        reason = bend_refusal(state.upper, tried) or dip_refusal(state.upper, tried)
        if reason is not None:
            raise reason
    if state.refined is None:
        message = "refinement has no trajectory to start from"
        raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Location())
    return refined_diagnosis(state.problem, state.branches, state.refined, state.clock)


def _fastest(state: _Planning) -> PlanResult | None:
    return state.fastest or state.refusal


def _diagnosis(state: _Planning) -> PlanResult | None:
    assert state.refusal is not None
    return refined_diagnosis(state.problem, state.branches, state.refusal, state.clock)


@dataclass(frozen=True)
class Attempt:
    """An attempt, the methods that make it, and a further condition."""

    # returns the result that ends planning, None for the next attempt; Infeasible is a result too
    run: Callable[[_Planning], PlanResult | None]
    methods: tuple[str, ...] = (REFINEMENT,)
    applies: Callable[[_Planning], bool] = lambda state: True


# In this order, until one has a result. After a quarter of a time limit, stops at corners are made
# between the steps of refinement: an answer, should there be no better one in time. If all fail,
# the diagnosis has the first condition that no configuration satisfies at some sample of the
# reference path; without such a sample, refinement's reason if links block both refinement and the
# search, else the search's, or that of stops at corners where it did not run.
ATTEMPTS = (
    Attempt(_necessary_conditions, METHODS),
    Attempt(_rest, METHODS),
    Attempt(_both_phases_of_1988, (SUH_BISHOP,)),
    Attempt(_last_motion, (REFINEMENT,), lambda state: state.last is not None),
    Attempt(_certain_obstruction, (REFINEMENT,), lambda state: state.is_brief),
    Attempt(_first_start, (REFINEMENT,), lambda state: state.is_brief),
    Attempt(_every_start, (REFINEMENT,), lambda state: not state.is_brief),
    Attempt(_stops_at_corners, (REFINEMENT, BRANCH_AND_BOUND, STOP_AT_CORNERS)),
    Attempt(_every_start, (REFINEMENT,), lambda state: state.is_brief),
    Attempt(_narrower_tubes, (REFINEMENT,), lambda state: state.can_stop_at_corners),
    Attempt(_search, (REFINEMENT, BRANCH_AND_BOUND)),
    Attempt(_diagnosis, (REFINEMENT,)),
)
# In a union of segments, refinement visits them in order, and branch and bound in any. What either
# finds does not end planning: it is refined again in the segments alone that it visits, and the
# fastest motion of all is the answer. Refinement in order goes on until it has a motion, so that
# the answer is no slower than that of the same tube with an order.
UNION_ATTEMPTS = (
    Attempt(_necessary_conditions),
    Attempt(_rest),
    Attempt(_last_motion, applies=lambda state: state.last is not None),
    Attempt(_first_start),
    Attempt(_visited_segments),
    Attempt(_stops_at_corners),
    Attempt(_search),
    Attempt(_visited_segments),
    Attempt(_every_start, applies=lambda state: state.has_none_in_order),
    Attempt(_narrower_tubes, applies=lambda s: s.has_none_in_order and s.can_stop_at_corners),
    Attempt(_visited_segments),
    Attempt(_fastest),
)

# With speed bands, no motion rests on the way. Where none is in required bands, one with their
# upper ends alone shows where the joints cannot hold them.
BAND_ATTEMPTS = (
    Attempt(_necessary_conditions),
    Attempt(_last_motion, applies=lambda state: state.last is not None),
    Attempt(_certain_obstruction, applies=lambda state: state.is_brief),
    Attempt(_first_start),
    Attempt(_upper_ends, applies=lambda state: state.has_floors),
    Attempt(_every_start, applies=lambda state: not state.is_brief),
    Attempt(_narrower_tubes, applies=lambda state: not state.is_brief),
    Attempt(_outside_bands),
)

# Along a joint route, the problem's or those that a search finds, the tool anywhere.
ROUTE_ATTEMPTS = (
    Attempt(_necessary_conditions, METHODS),
    Attempt(_rest, METHODS),
    Attempt(_last_motion, (REFINEMENT,), lambda state: state.last is not None),
    Attempt(_along_route, METHODS),
)
# The same to a pose, whose configurations the search tries.
POSE_ATTEMPTS = (Attempt(_along_route, METHODS),)


def attempted_plan(
    problem: PlanningProblem, last: RefinedMotion | None, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    """Return the result of the first attempt that has one.

    It begins with the last motion, if there is one.

    Raises:
        TimeLimitReached: Before there was a result; likewise KeyboardInterrupt.
    """
    state, result = _Planning(problem, last, options, clock), None
    table: tuple[Attempt, ...] = UNION_ATTEMPTS if state.is_union else ATTEMPTS
    table = BAND_ATTEMPTS if state.has_bands else table
    if problem.tube.route is not None or problem.has_free_tool:
        table = ROUTE_ATTEMPTS if problem.endpoints[1].pose is None else POSE_ATTEMPTS
    attempts = (each for each in table if options.method in each.methods and each.applies(state))
    try:
        while result is None:
            result = next(attempts).run(state)
        if state.has_bands and problem.tube.process.steady == BEST and result.succeeded:
            result = steadiest_plan(problem, result, clock)
    except Infeasible as reason:
        result = state.fastest or refused_result(reason, options.method)
    except (TimeLimitReached, KeyboardInterrupt) as reason:
        if state.fastest is None:
            raise
        is_late = isinstance(reason, TimeLimitReached)
        result = state.stopped("time_limit" if is_late else "interrupt")
    if result.proved is not False or result.starts_tried:
        return result
    return replace(result, starts_tried=state.branches.tried)
