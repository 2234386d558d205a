"""Plans of a cycle's legs: greedy, other end configurations, all together."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.branches import end_configuration, is_continued
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.first_guess.pose_configurations import is_free, spread_seeds
from tubeplanner.first_guess.segment_walk import wanted_at
from tubeplanner.optimizer.phased_spline import PhasedSpline
from tubeplanner.optimizer.starts import RefinedMotion
from tubeplanner.optimizer.tied_legs import TiedLegs
from tubeplanner.outcome import (
    MARGIN_TOLERANCE,
    Infeasible,
    Place,
    PlanningClock,
    PlanStatus,
    Progress,
)
from tubeplanner.planning.cycle_result import BlockedLeg, LegPlan
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.refined_plan import continued_plan
from tubeplanner.planning.result import PlanResult, refused_result, stopped_result
from tubeplanner.planning.strategy import shortest_plan
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.endpoints import Goal, GoalRegion
from tubeplanner.task.problem import PlanningProblem

# ---- Other configurations in which a move could end, where the next has no answer from its own.

_SAME = 0.1  # [rad or m] of every joint


def other_ends(cycle: Cycle, k: int, seams: list[FloatArray]) -> Iterator[FloatArray]:
    """Yield configurations (n,) in which leg k could begin, from which a branch leads along it.

    Those nearest to where the leg before begins come first.

    Args:
        cycle: The cycle; the leg before ends openly.
        k: The leg.
        seams: Configurations (n,) of the seams up to where it begins, the last one as it is now.
    """
    before = cycle.problem_from_anywhere(k - 1)
    after = cycle.problem_from_anywhere(k)
    lower = np.maximum(before.joint_lower[-1], after.joint_lower[0])
    upper = np.minimum(before.joint_upper[-1], after.joint_upper[0])
    if (lower > upper).any():
        return
    found = [seams[k]]
    for q in _reaching(before, seams[k], lower, upper):
        if all(abs(q - other).max() > _SAME for other in found):
            found.append(q)
    others = sorted(found[1:], key=lambda q: float(abs(q - seams[k - 1]).max()))
    yield from (q for q in others if _leads_on(cycle, k, [*seams[:k], q]))


def _reaching(
    problem: PlanningProblem, near: FloatArray, lower: FloatArray, upper: FloatArray
) -> Iterator[FloatArray]:
    """Yield configurations (n,) within bounds that have the tool where a leg ends openly."""
    goal = problem.open_goal
    assert goal is not None
    last = problem.tube.segment_count - 1
    for seed in [near, *spread_seeds(lower, upper)]:
        wanted = wanted_at(problem, goal.position, last, seed)
        solution = solve_position(problem.robot, goal.position, seed, lower, upper, rotation=wanted)
        if solution.error <= MARGIN_TOLERANCE / 2 and _is_turned(problem, solution.q, last):
            yield solution.q


def _is_turned(problem: PlanningProblem, q: FloatArray, segment: int) -> bool:
    """Return whether the tool is turned as a segment asks."""
    if problem.tube.rotation is None:
        return True
    rotation, tool = problem.robot.tool_pose(q[None])
    return bool(problem.tube.rotation.margin(rotation, tool, segment)[0] >= 0)


def _leads_on(cycle: Cycle, k: int, seams: list[FloatArray]) -> bool:
    """Return whether a leg can begin there, and a branch leads along it."""
    try:
        problem = cycle.problem(k, seams).joined
    except ProblemError:
        return False
    return is_free(problem, "start", seams[k]) and is_continued(problem)


# ---- Moves planned alone, one after the other, each from where the last one ended.

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
    if cycle.endpoint.joints is not None:
        return cycle.endpoint.joints
    last = len(cycle.legs) - 1
    leg, end, point = 0, cycle.endpoint, 0
    if cycle.closed and not cycle.legs[last].joined.ends_openly:
        leg, end, point = last, cycle.legs[last].joined.endpoint, -1
    try:
        return end_configuration(cycle.problem_from_anywhere(leg), end, point)
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
    return k == 0 and cycle.endpoint.joints is not None


def _unproved(result: PlanResult) -> PlanResult:
    """Return a result without an answer: what is proved from one beginning is not from others."""
    return replace(result, proved=False, starts_tried=1) if result.proved else result


# ---- The configurations in which moves end and the next begin, for the least sum of durations.

_STAGE = "shared configurations"
# Where a part is taken and put down in other configurations, it hangs and stands otherwise: where
# it is then put down a little too deep, that configuration alone is chosen once more.
_ROUNDS = 4


def shared_plan(
    cycle: Cycle, greedy: Sequence[LegPlan], options: PlanOptions, clock: PlanningClock
) -> list[LegPlan] | None:
    """Return the shortest motions of all legs between ends that suit all of them.

    Args:
        cycle: The cycle.
        greedy: Each leg's from where the one before ended.
        options: How to plan a leg afresh, where that is necessary.
        clock: The planning's.

    Returns:
        None if nothing shorter is found than what there is.

    Raises:
        TimeLimitReached: Before it was known; likewise KeyboardInterrupt.
    """
    last = len(greedy) - 1
    is_open = [leg.joined.ends_openly for leg in cycle.legs]
    is_open[last] &= not cycle.closed or cycle.endpoint.kind == "seed"
    goals = _goals(cycle, greedy, is_open)
    motions = [_opened(*each) for each in zip(greedy, goals, strict=True)]
    known = [motion for motion in motions if motion is not None]
    if last == 0 or not any(is_open) or len(known) < len(greedy):
        return None
    for _ in range(_ROUNDS):
        clock.enter(_STAGE)
        splines = _tied(known, is_open, clock, closed=cycle.closed)
        if splines is None:
            return None
        ends = [spline.control_points[[0, -1]] for spline in splines]
        try:
            problems = cycle.problems([ends[0][0], *(end for _, end in ends)])
        except ProblemError:  # no place for an end after all
            return None
        opened = [
            replace(motion, problem=replace(problem.joined, goal=goal), spline=spline)
            for motion, problem, goal, spline in zip(known, problems, goals, splines, strict=True)
        ]
        is_open = [_presses(*each) for each in zip(opened, is_open, strict=True)]
        known = [
            motion if opens else replace(motion, problem=problem.joined)
            for motion, problem, opens in zip(opened, problems, is_open, strict=True)
        ]
        if not any(is_open):
            plans = _planned(problems, known, options, clock)
            return plans if plans is not None and _total(plans) < _total(greedy) else None
    return None


def _goals(cycle: Cycle, greedy: Sequence[LegPlan], is_open: Sequence[bool]) -> list[Goal]:
    """Return where legs end: as their moves say if that is open, else where they end already."""
    goals = [
        leg.joined.goal if opens else plan.end
        for leg, plan, opens in zip(cycle.legs, greedy, is_open, strict=True)
    ]
    if cycle.closed and is_open[-1]:
        # A ball would leave more room than the start has, where the first tube begins.
        begin, region = cycle.legs[0].joined.tube.points[0], cycle.legs[-1].joined.endpoint.region
        turn = None if region is None else region.rotation_tolerance
        goals[-1] = GoalRegion(begin, rotation_tolerance=turn)
    return goals


def _tied(
    motions: Sequence[RefinedMotion], is_open: Sequence[bool], clock: PlanningClock, *, closed: bool
) -> list[PhasedSpline] | None:
    """Return the splines of legs, those with open ends improved together; None if none can be.

    Args:
        motions: Of all legs.
        is_open: Whether each ends openly.
        clock: The planning's.
        closed: Whether the first follows the last.
    """
    splines = [motion.spline for motion in motions]
    for chain in _chains(is_open, closed=closed):
        found = TiedLegs(
            [motions[k] for k in chain],
            [is_open[k] for k in chain[:-1]],
            is_closed=closed and all(is_open),
            checkpoint=_checkpoint(clock),
        ).run()
        for k, spline in zip(chain, found or (), strict=found is not None):
            splines[k] = spline
    is_same = all(spline is motion.spline for spline, motion in zip(splines, motions, strict=True))
    return None if is_same else splines


def _chains(is_open: Sequence[bool], *, closed: bool) -> list[list[int]]:
    """Return the legs that open ends join, in the order in which they run.

    Args:
        is_open: Whether each leg ends openly.
        closed: Whether the first follows the last.
    """
    count = len(is_open)
    # So that the ring is cut where an end is given, if one is.
    first = next((k + 1 for k in range(count) if not is_open[k]), 0) if closed else 0
    chains: list[list[int]] = [[]]
    for leg in range(first, first + count):
        k = leg % count
        chains[-1].append(k)
        if not is_open[k]:
            chains.append([])
    return [chain for chain in chains if any(is_open[k] for k in chain)]


def _presses(motion: RefinedMotion, is_open: bool) -> bool:
    """Return whether a leg's end was chosen, and what is put down there is in what it stands on."""
    end = motion.spline.control_points[-1]
    return is_open and not is_free(motion.problem, "goal", end)


def _opened(plan: LegPlan, goal: Goal) -> RefinedMotion | None:
    """Return a leg's motion as one of a problem whose goal is that of its move."""
    motion = plan.result.motion
    if motion is None:
        return None
    return replace(motion, problem=replace(motion.problem, goal=goal))


def _planned(
    problems: Sequence[PlanningProblem],
    motions: Sequence[RefinedMotion],
    options: PlanOptions,
    clock: PlanningClock,
) -> list[LegPlan] | None:
    """Return the shortest motions of legs between their ends; None if one has none.

    Args:
        problems: The legs'.
        motions: From which to begin.
        options: How to plan a leg afresh, if that leads nowhere.
        clock: The planning's.
    """
    plans = []
    for problem, motion in zip(problems, motions, strict=True):
        with clock.within(f"{_STAGE}, {problem.name}"):
            result = continued_plan(problem.joined, motion, clock)
            if result is None or not result.succeeded:
                result = shortest_plan(problem, options, clock)
        if not result.succeeded:
            return None
        plans.append(LegPlan(problem, result))
    return plans


def _checkpoint(clock: PlanningClock) -> Callable[[float], None]:
    """Return what is called with the sum of durations after every step."""

    def checkpoint(duration: float) -> None:
        clock.announce(Progress(_STAGE, best_duration=duration))
        clock.check()

    return checkpoint


def _total(plans: Sequence[LegPlan]) -> float:
    return sum(plan.duration for plan in plans)
