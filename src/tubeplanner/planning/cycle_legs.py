"""Plans of a cycle's legs: in order, with other end configurations, all together."""

from collections.abc import Iterator, Sequence
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
    Location,
    PlanningClock,
    PlanStatus,
    Progress,
)
from tubeplanner.planning.cycle_result import BlockedLeg, LegPlan
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.refined_plan import continued_plan
from tubeplanner.planning.result import refused_result, stopped_result
from tubeplanner.planning.strategy import shortest_plan
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.endpoints import GoalRegion
from tubeplanner.task.problem import PlanningProblem

# ---- Other configurations in which a move could end, where the next has no answer from its own.

_SAME = 0.1  # [rad or m] of every joint


def other_ends(cycle: Cycle, k: int, junctions: list[FloatArray]) -> Iterator[FloatArray]:
    """Yield other configurations (n,) for leg k's begin, each with a branch along the leg.

    Configurations nearest to the begin of the leg before come first.

    Args:
        cycle: The cycle; the leg before ends openly.
        k: Index of the leg.
        junctions: Configurations (n,) of the junctions up to the leg's begin; the last one as it
            is.
    """
    before = cycle.problem_from_anywhere(k - 1)
    after = cycle.problem_from_anywhere(k)
    lower = np.maximum(before.joint_lower[-1], after.joint_lower[0])
    upper = np.minimum(before.joint_upper[-1], after.joint_upper[0])
    if (lower > upper).any():
        return
    distinct = [junctions[k]]
    for q in _reaching(before, junctions[k], lower, upper):
        if all(abs(q - other).max() > _SAME for other in distinct):
            distinct.append(q)
    others = sorted(distinct[1:], key=lambda q: float(abs(q - junctions[k - 1]).max()))
    for q in others:
        try:
            problem = cycle.problem(k, [*junctions[:k], q]).joined
        except ProblemError:
            continue
        if is_free(problem, "start", q) and is_continued(problem):
            yield q


def _reaching(
    problem: PlanningProblem, near: FloatArray, lower: FloatArray, upper: FloatArray
) -> Iterator[FloatArray]:
    """Yield configurations (n,) within bounds with the tool at a leg's open goal."""
    goal = problem.open_goal
    assert goal is not None
    last = problem.tube.segment_count - 1
    for seed in [near, *spread_seeds(lower, upper)]:
        target = wanted_at(problem, goal.position, last, seed)
        solution = solve_position(problem.robot, goal.position, seed, lower, upper, rotation=target)
        if solution.error > MARGIN_TOLERANCE / 2:
            continue
        if problem.tube.rotation is not None:
            rotation, tool = problem.robot.tool_pose(solution.q[None])
            if problem.tube.rotation.margin(rotation, tool, last)[0] < 0:
                continue
        yield solution.q


# ---- Moves planned alone, one after the other, each from where the last one ended.

# Other configurations for a leg's end, where the next leg has no answer.
_MAX_CANDIDATES = 6
_STOPPED = (PlanStatus.TIME_LIMIT, PlanStatus.INTERRUPTED)


def greedy_plan(cycle: Cycle, options: PlanOptions, clock: PlanningClock) -> list[LegPlan]:
    """Return the shortest motion of every leg, each from the end of the leg before.

    Args:
        cycle: The cycle.
        options: Options of planning for each leg.
        clock: The planning's.

    Raises:
        BlockedLeg: A leg has no answer from there.
    """
    junctions = [first_configuration(cycle)]
    plans: list[LegPlan] = []
    for k in range(len(cycle.legs)):
        try:
            plans.append(_planned_from(cycle, k, junctions, options, clock))
        except BlockedLeg as blocked:
            was_stopped = blocked.result.stopped_by is not None or blocked.result.status in _STOPPED
            if k == 0 or was_stopped or not cycle.legs[k - 1].joined.ends_openly:
                raise
            plans[-1:] = _planned_around(cycle, k, junctions, options, clock, blocked)
            junctions[-1] = plans[-2].end
        junctions.append(plans[-1].end)
    return plans


def _planned_from(
    cycle: Cycle, k: int, junctions: list[FloatArray], options: PlanOptions, clock: PlanningClock
) -> LegPlan:
    """Return the shortest motion of leg k from the end of the leg before."""
    return planned_leg(cycle, k, leg_problem(cycle, k, junctions), options, clock)


def _planned_around(
    cycle: Cycle,
    k: int,
    junctions: list[FloatArray],
    options: PlanOptions,
    clock: PlanningClock,
    blocked: BlockedLeg,
) -> list[LegPlan]:
    """Return motions of leg k and of the leg before, which ends in another configuration.

    Raises:
        BlockedLeg: As before, if there are no such motions.
    """
    count = 0
    for q in islice(other_ends(cycle, k, junctions), _MAX_CANDIDATES):
        count += 1
        with suppress(BlockedLeg):
            problem = cycle.problem(k - 1, junctions[:-1], q)
            before = planned_leg(cycle, k - 1, problem, options, clock)
            return [before, _planned_from(cycle, k, [*junctions[:-1], q], options, clock)]
    if count == 0:
        raise blocked
    result = blocked.result
    message = f"{result.message}; {count} other start configurations have no answer either"
    raise BlockedLeg(k, replace(result, message=message)) from None


def first_configuration(cycle: Cycle) -> FloatArray:
    """Return the first configuration (n,) of a cycle; of a closed cycle the last goal, if given.

    Raises:
        BlockedLeg: The first leg's start, or the last leg's goal, is not reached.
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


def leg_problem(cycle: Cycle, k: int, junctions: list[FloatArray]) -> PlanningProblem:
    """Return a leg's problem from the end of the leg before; the last leg closes a closed cycle.

    Args:
        cycle: The cycle.
        k: Index of the leg.
        junctions: Configurations (n,) of all junctions up to the leg's begin.

    Raises:
        BlockedLeg: The leg's start or goal is not allowed there.
    """
    closes = cycle.closed and k == len(cycle.legs) - 1
    try:
        return cycle.problem(k, junctions, junctions[0] if closes else None)
    except ProblemError as error:
        reason = Infeasible(PlanStatus.UNREACHABLE, str(error), Location())
        raise BlockedLeg(k, refused_result(reason, "")) from None


def planned_leg(
    cycle: Cycle, k: int, problem: PlanningProblem, options: PlanOptions, clock: PlanningClock
) -> LegPlan:
    """Return the shortest motion of a leg.

    Of the remaining time the leg gets twice as much as would remain for each further leg.

    Raises:
        BlockedLeg: The leg has no motion.
        KeyboardInterrupt: Ctrl-C before every leg had a motion.
    """
    remaining = len(cycle.legs) - k
    limit = 2 * clock.remaining / (remaining + 1) if np.isfinite(clock.remaining) else None
    if limit is not None and limit <= 0:
        raise BlockedLeg(k, stopped_result(clock, "time_limit", options.method))
    with clock.within(cycle.label(k)):
        alone = replace(options, time_limit=limit)
        result = shortest_plan(problem, alone, PlanningClock(limit, clock.announce))
    if not result.succeeded and result.stopped_by == "time_limit":
        result = stopped_result(clock, "time_limit", options.method)
    if not result.succeeded:
        begins_as_given = k == 0 and cycle.endpoint.joints is not None
        if result.proved and not begins_as_given:  # proved of one begin, not of others
            result = replace(result, proved=False, starts_tried=1)
        raise BlockedLeg(k, result)
    if result.stopped_by == "interrupt" and remaining > 1:  # later legs have nothing
        raise KeyboardInterrupt
    return LegPlan(problem, result)


_STAGE = "shared configurations"
# A part that is taken and put down in other configurations hangs and stands otherwise. Where it is
# then put down a little too deep, that configuration alone is chosen again.
_ROUNDS = 4


def shared_plan(
    cycle: Cycle, greedy: Sequence[LegPlan], options: PlanOptions, clock: PlanningClock
) -> list[LegPlan] | None:
    """Return the shortest motions of all legs between configurations chosen for all.

    Args:
        cycle: The cycle.
        greedy: Plans of the legs, each from the end of the leg before.
        options: Options of planning a leg afresh, where that is necessary.
        clock: The planning's.

    Returns:
        None if the sum of durations is no shorter than the greedy plans'.

    Raises:
        TimeLimitReached: Before that was known; likewise KeyboardInterrupt.
    """
    last = len(greedy) - 1
    is_open = [leg.joined.ends_openly for leg in cycle.legs]
    is_open[last] &= not cycle.closed or cycle.endpoint.kind == "seed"
    goals = [
        leg.joined.goal if opens else plan.end
        for leg, plan, opens in zip(cycle.legs, greedy, is_open, strict=True)
    ]
    if cycle.closed and is_open[-1]:
        # A ball would leave more freedom than the start has, where the first tube begins.
        begin, region = cycle.legs[0].joined.tube.points[0], cycle.legs[-1].joined.endpoint.region
        turn = None if region is None else region.rotation_tolerance
        goals[-1] = GoalRegion(begin, rotation_tolerance=turn)
    motions = [
        replace(motion, problem=replace(motion.problem, goal=goal))
        for plan, goal in zip(greedy, goals, strict=True)
        if (motion := plan.result.motion) is not None
    ]
    if last == 0 or not any(is_open) or len(motions) < len(greedy):
        return None
    for _ in range(_ROUNDS):
        clock.enter(_STAGE)
        splines = _tied(motions, is_open, clock, closed=cycle.closed)
        if splines is None:
            return None
        ends = [spline.control_points[[0, -1]] for spline in splines]
        try:
            problems = cycle.problems([ends[0][0], *(end for _, end in ends)])
        except ProblemError:  # an end is not allowed after all
            return None
        opened = [
            replace(motion, problem=replace(problem.joined, goal=goal), spline=spline)
            for motion, problem, goal, spline in zip(motions, problems, goals, splines, strict=True)
        ]
        # Ends that were chosen stay open if not free: what is put down there is too deep.
        is_open = [
            opens and not is_free(motion.problem, "goal", motion.spline.control_points[-1])
            for motion, opens in zip(opened, is_open, strict=True)
        ]
        motions = [
            motion if opens else replace(motion, problem=problem.joined)
            for motion, problem, opens in zip(opened, problems, is_open, strict=True)
        ]
        if not any(is_open):
            plans = []
            for problem, motion in zip(problems, motions, strict=True):
                with clock.within(f"{_STAGE}, {problem.name}"):
                    result = continued_plan(problem.joined, motion, clock)
                    if result is None or not result.succeeded:
                        result = shortest_plan(problem, options, clock)
                if not result.succeeded:
                    return None
                plans.append(LegPlan(problem, result))
            total = sum(plan.duration for plan in greedy)
            return plans if sum(plan.duration for plan in plans) < total else None
    return None


def _tied(
    motions: Sequence[RefinedMotion], is_open: Sequence[bool], clock: PlanningClock, *, closed: bool
) -> list[PhasedSpline] | None:
    """Return the splines of legs, legs with open ends improved together; None without a change.

    Args:
        motions: Of all legs.
        is_open: Whether each leg ends openly.
        clock: The planning's.
        closed: Whether the first leg follows the last.
    """

    def checkpoint(duration: float) -> None:
        clock.announce(Progress(_STAGE, best_duration=duration))
        clock.check()

    splines = [motion.spline for motion in motions]
    # Runs of legs joined by open ends.
    count = len(is_open)
    # A ring is cut after a given end, if there is one.
    first = next((k + 1 for k in range(count) if not is_open[k]), 0) if closed else 0
    chains: list[list[int]] = [[]]
    for leg in range(first, first + count):
        k = leg % count
        chains[-1].append(k)
        if not is_open[k]:
            chains.append([])
    for chain in chains:
        if not any(is_open[k] for k in chain):
            continue
        improved = TiedLegs(
            [motions[k] for k in chain],
            [is_open[k] for k in chain[:-1]],
            is_closed=closed and all(is_open),
            checkpoint=checkpoint,
        ).run()
        for k, spline in zip(chain, improved or (), strict=improved is not None):
            splines[k] = spline
    is_same = all(spline is motion.spline for spline, motion in zip(splines, motions, strict=True))
    return None if is_same else splines
