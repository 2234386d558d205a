"""Plans of legs: between configurations of poses, in order, and all together."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.branches import (
    configured_ends,
    end_configuration,
    is_continued,
    least_time,
    other_ends,
)
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
    StoppedBy,
    until_stopped,
)
from tubeplanner.planning.attempts import attempted_plan
from tubeplanner.planning.diagnosis import require_within_bound
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.refined_plan import continued_plan
from tubeplanner.planning.result import (
    BlockedLeg,
    LegPlan,
    PlanResult,
    refused_result,
    stopped_result,
)
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.endpoints import GoalRegion
from tubeplanner.task.motion import Task
from tubeplanner.task.problem import PlanningProblem

# ---- The shortest motion of a leg, whose poses have several configurations.


def fastest_leg(
    problem: PlanningProblem,
    options: PlanOptions,
    clock: PlanningClock,
    last: RefinedMotion | None = None,
    *,
    takes_first: bool = False,
) -> LegPlan:
    """Return the shortest motion, without period, slack and robustness, between its configurations.

    Each of the configurations of poses from which a branch leads along the tube is planned, but for
    those whose joints need longer than the fastest motion takes; the others where these have no
    answer. One after the other: the answer does not depend on timing. Not `persistent`, from a last
    motion (there the nearest comes first), and if told so, the first with an answer is taken.

    Raises:
        Infeasible: A point is out of reach, proved, or a pose has no configuration.
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    require_within_bound(problem)
    pose, others = problem.endpoints[1].pose, list[PlanningProblem]()
    if problem.has_free_tool and pose is not None:
        # No branch chooses among the goal's configurations: the search does.
        first, notes = configured_ends(replace(problem, goal=GoalRegion(pose.position)))
        first, count = replace(problem, start=first.start), 1
    else:
        first, notes = configured_ends(problem)
        others, count = other_ends(problem, first)
    if not others:
        result = _shortest(first, options, clock, last)
        return LegPlan(first, replace(result, notes=(*notes, *result.notes)))
    takes_first = takes_first or last is not None or not options.persistent
    if last is not None:
        motion = last.spline.control_points[[0, -1]]

        def away(each: PlanningProblem) -> float:
            ends = zip(each.endpoints, motion, strict=True)
            return sum(
                float(abs(end.joints - q).max()) for end, q in ends if end.joints is not None
            )

        first, *others = sorted((first, *others), key=away)
    quick = replace(options, persistent=False)
    results: list[PlanResult] = []
    best: LegPlan | None = None
    stopped_by: StoppedBy | None = None

    def in_turn() -> Iterator[PlanningProblem]:
        # Configurations from which no branch leads along the tube only where nothing else helps.
        yield first
        rest = []
        for each in others:
            if is_continued(each.joined):
                yield each
            else:
                rest.append(each)
        if best is None:
            yield from rest

    for number, each in enumerate(in_turn(), 1):
        shortest = np.inf if best is None else best.duration
        if least_time(each) >= shortest:
            continue
        # Of the remaining time twice as much as would remain for each further one.
        open_count = len(others) + 2 - number
        limit = 2 * clock.remaining / (open_count + 1) if np.isfinite(clock.remaining) else None
        try:
            with clock.within(f"configurations {number} of {len(others) + 1}"):
                result = _shortest(each, quick, PlanningClock(limit, clock.announce), last)
        except KeyboardInterrupt:
            if best is None:
                raise
            stopped_by = "interrupt"
            break
        results.append(result)
        stopped_by = result.stopped_by or stopped_by
        if (result.duration or np.inf) < shortest * (1 - _EQUAL):
            best = LegPlan(each, result)
        if (best is not None and takes_first) or stopped_by == "interrupt" or clock.remaining <= 0:
            break
    if best is None and stopped_by is not None:
        return LegPlan(first, stopped_result(clock, stopped_by, options.method))
    if best is None:
        result = results[0]
        if options.persistent and result.status not in _SURE:
            result = _shortest(first, options, clock, last)
        best = LegPlan(first, result)
    result = _of_configurations(problem, best, results, count)
    return LegPlan(best.problem, replace(result, stopped_by=result.stopped_by or stopped_by))


_EQUAL = 1e-6  # relative: of durations that differ by rounding alone the first counts
# Refusals of a configuration itself.
_SURE = (PlanStatus.GRAVITY_EXCEEDS_EFFORT,)


def _of_configurations(
    problem: PlanningProblem, best: LegPlan, results: list[PlanResult], count: int
) -> PlanResult:
    """Return the best result of configurations, with what the others led to.

    Of `count` configurations that were found for the problem's poses those of `results` were
    planned.
    """
    result = best.result
    kinds = zip(("start", "goal"), problem.endpoints, strict=True)
    ends = [name for name, end in kinds if end.pose is not None and end.pose.seed is None]
    whose = "its pose" if len(ends) == 1 else "their poses"
    number = f"{len(results)} {'was' if len(results) == 1 else 'were'}"
    of = f"{' and '.join(ends)}: of {count} configurations found for {whose} {number}"
    if not result.succeeded:
        starts = sum(each.starts_tried or 1 for each in results)
        message = (
            f"{result.message} (in the likeliest configuration); {of} tried, none has an answer"
        )
        return replace(result, message=message, proved=False, starts_tried=starts)
    values = " and ".join(
        f"[{', '.join(f'{x:.6g}' for x in np.round(getattr(best.problem, end), 6) + 0.0)}]"
        for end in ends
    )
    durations = sorted(each.duration for each in results if each.duration is not None)
    note = f"{of} planned: {values}"
    if len(durations) > 1:
        note += f" is the fastest, {durations[0]:.4f} s, {len(durations) - 1} others take up to "
        note += f"{durations[-1]:.4f} s"
    note += "; a seed or joint signs ask for another"
    return replace(result, notes=(note, *result.notes))


def of_poses(problem: PlanningProblem, result: PlanResult) -> PlanResult:
    """Return a result; a proof for a configuration chosen for a pose is none for the pose."""
    ends = zip(problem.endpoints, problem.end_radii.tolist(), strict=True)
    # A seed too leads to one of several configurations where the arm misses the point.
    has_choice = any(end.pose is not None or (end.kind == "seed" and size) for end, size in ends)
    if not (result.proved and has_choice):
        return result
    return replace(result, proved=False, starts_tried=1)


def _shortest(
    problem: PlanningProblem, options: PlanOptions, clock: PlanningClock, last: RefinedMotion | None
) -> PlanResult:
    """Return the shortest motion between configured ends; if stopped early, the best so far.

    Raises:
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    result, stopped_by = until_stopped(
        partial(attempted_plan, problem.joined, last, options, clock)
    )
    if result is None:
        result = stopped_result(clock, stopped_by or "interrupt", options.method)
    if result.status is PlanStatus.INTERRUPTED:
        raise KeyboardInterrupt
    return result


# ---- Other configurations in which a move could end, where the next has no answer from its own.

_SAME = 0.1  # [rad or m] of every joint


def other_junctions(cycle: Cycle, k: int, junctions: list[FloatArray]) -> Iterator[FloatArray]:
    """Yield other configurations (n,) for leg k's begin, each with a branch along the leg.

    The leg before ends openly. Configurations nearest to its begin come first. `junctions` are the
    configurations up to leg k's begin; the last one as it is.
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
    """Yield configurations (n,) within bounds with the tool at an open goal."""
    goal, rotation = problem.open_goal, problem.rotation
    assert goal is not None
    last = problem.tube.segment_count - 1 + goal.bounds_rotation
    for seed in [near, *spread_seeds(lower, upper)]:
        target = wanted_at(problem, goal.position, last, seed)
        solution = solve_position(problem.robot, goal.position, seed, lower, upper, rotation=target)
        if solution.error > MARGIN_TOLERANCE / 2:
            continue
        if rotation is not None:
            matrix, tool = problem.robot.tool_pose(solution.q[None])
            if rotation.margin(matrix, tool, last)[0] < 0:
                continue
        yield solution.q


# ---- Moves planned alone, one after the other, each from where the last one ended.

# Other configurations for a leg's end, where the next leg has no answer.
_MAX_CANDIDATES = 6
_STOPPED = (PlanStatus.TIME_LIMIT, PlanStatus.INTERRUPTED)


def shortest_legs(
    task: Task, options: PlanOptions, clock: PlanningClock, last: RefinedMotion | None = None
) -> list[LegPlan]:
    """Return the shortest motion of every leg, each from the end of the leg before.

    A problem is its only leg: the motion between the fastest configurations of its poses, begun
    with its last motion if there is one.

    Raises:
        BlockedLeg: A leg of a cycle has no answer from there, or a problem's poses have none.
    """
    if isinstance(task, PlanningProblem):
        with _blocking(0, options.method):
            return [fastest_leg(task, options, clock, last)]
    for k in range(len(task.legs)):
        with _blocking(k):
            require_within_bound(task.problem_from_anywhere(k), start_is_known=k == 0)
    junctions = [_first_configuration(task)]
    plans: list[LegPlan] = []
    for k in range(len(task.legs)):
        try:
            plans.append(_planned_leg(task, k, junctions, options, clock))
        except BlockedLeg as blocked:
            was_stopped = blocked.result.stopped_by is not None or blocked.result.status in _STOPPED
            if k == 0 or was_stopped or not task.legs[k - 1].joined.ends_openly:
                raise
            plans[-1:] = _planned_around(task, k, junctions, options, clock, blocked)
            junctions[-1] = plans[-2].end
        junctions.append(plans[-1].end)
    return plans


@contextmanager
def _blocking(k: int, method: str = "") -> Iterator[None]:
    """Raise BlockedLeg of leg k in place of Infeasible."""
    try:
        yield
    except Infeasible as reason:
        raise BlockedLeg(k, refused_result(reason, method)) from None


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
    for q in islice(other_junctions(cycle, k, junctions), _MAX_CANDIDATES):
        count += 1
        with suppress(BlockedLeg):
            before = _planned_leg(cycle, k - 1, junctions[:-1], options, clock, goal=q)
            return [before, _planned_leg(cycle, k, [*junctions[:-1], q], options, clock)]
    if count == 0:
        raise blocked
    result = blocked.result
    message = f"{result.message}; {count} other start configurations have no answer either"
    raise BlockedLeg(k, replace(result, message=message)) from None


def _first_configuration(cycle: Cycle) -> FloatArray:
    """Return the first configuration (n,) of a cycle; of a closed cycle the last goal, if given."""
    if cycle.endpoint.joints is not None:
        return cycle.endpoint.joints
    last = len(cycle.legs) - 1
    leg, end, point = 0, cycle.endpoint, 0
    if cycle.closed and not cycle.legs[last].joined.ends_openly:
        leg, end, point = last, cycle.legs[last].joined.endpoint, -1
    with _blocking(leg):
        return end_configuration(cycle.problem_from_anywhere(leg), end, point)


def _planned_leg(
    cycle: Cycle,
    k: int,
    junctions: list[FloatArray],
    options: PlanOptions,
    clock: PlanningClock,
    goal: FloatArray | None = None,
) -> LegPlan:
    """Return the shortest motion of leg k from the end of the leg before, to another goal if given.

    The last leg closes a closed cycle. Of the remaining time the leg gets twice as much as would
    remain for each further leg.

    Raises:
        BlockedLeg: The leg has no motion, or its start or goal is not allowed there.
        KeyboardInterrupt: Ctrl-C before every leg had a motion.
    """
    if goal is None and cycle.closed and k == len(cycle.legs) - 1:
        goal = junctions[0]
    try:
        problem = cycle.problem(k, junctions, goal)
    except ProblemError as error:
        reason = Infeasible(PlanStatus.UNREACHABLE, str(error), Location())
        raise BlockedLeg(k, refused_result(reason, "")) from None
    remaining = len(cycle.legs) - k
    limit = 2 * clock.remaining / (remaining + 1) if np.isfinite(clock.remaining) else None
    if limit is not None and limit <= 0:
        raise BlockedLeg(k, stopped_result(clock, "time_limit", options.method))
    with clock.within(cycle.label(k)):
        alone = replace(options, time_limit=limit)
        result = _first_answer(problem, alone, PlanningClock(limit, clock.announce))
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


def _first_answer(
    problem: PlanningProblem, options: PlanOptions, clock: PlanningClock
) -> PlanResult:
    """Return the shortest motion in the first configurations with an answer, or the refusal."""
    try:
        return of_poses(problem, fastest_leg(problem, options, clock, takes_first=True).result)
    except Infeasible as reason:
        return refused_result(reason, options.method)


# ---- Configurations of junctions chosen for all legs together.

_STAGE = "shared configurations"
# A part that is taken and put down in other configurations hangs and stands otherwise. Where it is
# then put down a little too deep, that configuration alone is chosen again.
_ROUNDS = 4


def shared_plan(
    cycle: Cycle, greedy: Sequence[LegPlan], options: PlanOptions, clock: PlanningClock
) -> list[LegPlan] | None:
    """Return the shortest motions of all legs between configurations chosen for all.

    None if the sum of durations is no shorter than that of the greedy plans, each from the end of
    the leg before.

    Raises:
        TimeLimitReached: Before that was known; likewise KeyboardInterrupt.
    """
    last = len(greedy) - 1
    # Where the tool may be anywhere, ends stay as the search chose them.
    is_open = [
        leg.joined.ends_openly and not plan.problem.has_free_tool
        for leg, plan in zip(cycle.legs, greedy, strict=True)
    ]
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
                        result = _first_answer(problem, options, clock)
                if not result.succeeded:
                    return None
                plans.append(LegPlan(problem, result))
            total = sum(plan.duration for plan in greedy)
            return plans if sum(plan.duration for plan in plans) < total else None
    return None


def _tied(
    motions: Sequence[RefinedMotion], is_open: Sequence[bool], clock: PlanningClock, *, closed: bool
) -> list[PhasedSpline] | None:
    """Return the splines of legs, legs with open ends improved together; None without a change."""

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
