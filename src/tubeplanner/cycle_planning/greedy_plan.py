"""Moves planned alone, one after the other, each from where the last one ended."""

from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.reference_branch import end_configuration
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle_planning.leg_plan import BlockedLeg, LegPlan
from tubeplanner.cycle_planning.other_ends import other_ends
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult, refused_result, stopped_result
from tubeplanner.planning.planner import shortest_plan
from tubeplanner.problem.goal_region import GoalRegion
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.problem.tool_pose import ToolPose
from tubeplanner.progress import PlanningClock

# Other configurations in which a leg may end, where the next has no answer.
_MOST_TRIED = 6
_STOPPED = (PlanStatus.TIME_LIMIT, PlanStatus.INTERRUPTED)


def greedy_plan(cycle: Cycle, options: PlanOptions, clock: PlanningClock) -> list[LegPlan]:
    """Return the shortest motion of every leg from where the one before ended.

    Args:
        cycle: The cycle.
        options: How to plan each of them.
        clock: The planning's.

    Raises:
        BlockedLeg: One has no answer from there.
    """
    seams = [first_configuration(cycle)]
    plans: list[LegPlan] = []
    for k in range(len(cycle.legs)):
        try:
            plans.append(_planned_from(cycle, k, seams, options, clock))
        except BlockedLeg as blocked:
            if k == 0 or not cycle.legs[k - 1].joined.ends_openly or not _says_why(blocked):
                raise
            plans[-1:] = _planned_around(cycle, k, seams, options, clock, blocked)
            seams[-1] = plans[-2].end
        seams.append(plans[-1].end)
    return plans


def _planned_from(
    cycle: Cycle, k: int, seams: list[FloatArray], options: PlanOptions, clock: PlanningClock
) -> LegPlan:
    """Return the shortest motion of leg k from where those before end."""
    return planned_leg(cycle, k, leg_problem(cycle, k, seams), options, clock)


def _planned_around(
    cycle: Cycle,
    k: int,
    seams: list[FloatArray],
    options: PlanOptions,
    clock: PlanningClock,
    blocked: BlockedLeg,
) -> list[LegPlan]:
    """Return motions of leg k and of the one before it, which ends in another configuration.

    Raises:
        BlockedLeg: As it was, if there are none.
    """
    tried = 0
    for q in islice(other_ends(cycle, k, seams), _MOST_TRIED):
        tried += 1
        with suppress(BlockedLeg):
            problem = cycle.problem(k - 1, seams[:-1], q)
            before = planned_leg(cycle, k - 1, problem, options, clock)
            return [before, _planned_from(cycle, k, [*seams[:-1], q], options, clock)]
    if tried == 0:
        raise blocked
    result = blocked.result
    message = f"{result.message}; {tried} other configurations at its start led nowhere either"
    raise BlockedLeg(k, replace(result, message=message)) from None


def _says_why(blocked: BlockedLeg) -> bool:
    """Return whether a leg is blocked, rather than planning stopped."""
    return blocked.result.stopped_by is None and blocked.result.status not in _STOPPED


def first_configuration(cycle: Cycle) -> FloatArray:
    """Return the configuration (n,) in which a cycle begins: of a closed one its last goal, if any.

    Raises:
        BlockedLeg: The first leg's start, or the last one's goal, is not reached.
    """
    if isinstance(cycle.start, np.ndarray):
        return cycle.start
    last = len(cycle.legs) - 1
    leg, point = 0, 0
    given: FloatArray | Seed | ToolPose = cycle.start
    goal = cycle.legs[last].joined.goal
    if cycle.closed and goal is not None and not isinstance(goal, GoalRegion):
        leg, given, point = last, goal, -1
    try:
        return end_configuration(cycle.problem_from_anywhere(leg), given, point)
    except Infeasible as reason:
        raise BlockedLeg(leg, refused_result(reason, "")) from None


def leg_problem(cycle: Cycle, k: int, seams: list[FloatArray]) -> PlanningProblem:
    """Return a leg's problem from where those before end; the last one's of a closed cycle closes.

    Args:
        cycle: The cycle.
        k: Which leg.
        seams: Configurations (n,) of all seams up to where it begins.

    Raises:
        BlockedLeg: It has no place for its start or goal.
    """
    closes = cycle.closed and k == len(cycle.legs) - 1
    try:
        return cycle.problem(k, seams, seams[0] if closes else None)
    except ProblemError as error:
        reason = Infeasible(PlanStatus.UNREACHABLE, str(error), Place())
        raise BlockedLeg(k, refused_result(reason, "")) from None


def planned_leg(
    cycle: Cycle, k: int, problem: PlanningProblem, options: PlanOptions, clock: PlanningClock
) -> LegPlan:
    """Return the shortest motion of a leg.

    Of what is left of the time limit it gets twice as much as would be left to each of the others.

    Raises:
        BlockedLeg: It has none.
        KeyboardInterrupt: Ctrl-C before every leg had one.
    """
    left = len(cycle.legs) - k
    limit = 2 * clock.remaining / (left + 1) if np.isfinite(clock.remaining) else None
    if limit is not None and limit <= 0:
        raise BlockedLeg(k, stopped_result(clock, "time_limit", options.method))
    with clock.within(cycle.called(k)):
        alone = replace(options, time_limit=limit)
        result = shortest_plan(problem, alone, PlanningClock(limit, clock.announce))
    if not result.succeeded and result.stopped_by == "time_limit":
        result = stopped_result(clock, "time_limit", options.method)
    if not result.succeeded:
        raise BlockedLeg(k, result if _begins_as_given(cycle, k) else _unproved(result))
    if result.stopped_by == "interrupt" and left > 1:  # those after it have nothing
        raise KeyboardInterrupt
    return LegPlan(problem, result)


def _begins_as_given(cycle: Cycle, k: int) -> bool:
    """Return whether leg k begins in a configuration that was not chosen."""
    return k == 0 and isinstance(cycle.start, np.ndarray)


def _unproved(result: PlanResult) -> PlanResult:
    """Return a result without an answer: what is proved from one beginning is not from others."""
    return replace(result, proved=False, starts_tried=1) if result.proved else result
