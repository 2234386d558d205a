"""Plan_cycle: cycle to one certified motion."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from tubeplanner.certificate.cycle_verification import verify_cycle
from tubeplanner.certificate.verification import judged_visits
from tubeplanner.checks import given_options
from tubeplanner.outcome import (
    Infeasible,
    Place,
    PlanningClock,
    PlanStatus,
    ProgressCallback,
    StoppedBy,
    until_stopped,
)
from tubeplanner.planning.cycle_legs import greedy_plan, shared_plan
from tubeplanner.planning.cycle_result import BlockedLeg, CycleResult, LegPlan, cycle_sensitivities
from tubeplanner.planning.necessary_conditions import require_within_bound
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import refused_result, with_grounds
from tubeplanner.planning.second_stage import followed_plan
from tubeplanner.planning.strategy import require_honoured
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.cycle_motion import CycleMotion, LegMotion, cycle_motion
from tubeplanner.task.legs import Leg
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- The motion of a leg with the times at which its moves begin.

_SAMPLES = 200


def leg_motion(leg: Leg, plan: LegPlan) -> LegMotion:
    """Return the motion of a leg's plan, which has one."""
    trajectory = plan.result.trajectory
    assert trajectory is not None
    begins = [_begin(plan.problem, trajectory, first) for first in leg.first_segments[1:]]
    return LegMotion(trajectory, tuple(begins))


def _begin(problem: PlanningProblem, trajectory: JointTrajectory, first: int) -> float:
    """Return when a segment begins, one of those that the problem's file has [s].

    Where segments on one line are joined: when the tool is nearest to its first point.
    """
    numbers = problem.joined.tube.numbers
    visits = judged_visits(problem, trajectory)
    k = int(np.searchsorted(numbers, first))
    if numbers[k] == first:
        return next(visit.begin for visit in visits if visit.segment >= k)
    inside = [visit for visit in visits if visit.segment == k - 1]
    times = np.linspace(inside[0].begin, inside[-1].end, _SAMPLES)
    tool = problem.robot.tool_position(trajectory.position(times))
    point = problem.tube.points[np.searchsorted(problem.tube.numbers, first)]
    return float(times[np.linalg.norm(tool - point, axis=1).argmin()])


# ---- From a cycle to a certified motion of all of it, or to the reason why there is none.


def plan_cycle(
    cycle: Cycle,
    options: PlanOptions | None = None,
    progress: ProgressCallback | None = None,
    *,
    shares_configurations: bool = True,
) -> CycleResult:
    """Plan the motion of a whole cycle and certify it.

    Moves are planned alone, in order, each from where the last one ended. Then the configurations
    in which moves end of which only the hand's position is given, and in which the next begin, are
    chosen so that the sum of durations is least.

    Args:
        cycle: The cycle.
        options: How to plan every move; the time limit is that of the whole.
        progress: As of `plan`.
        shares_configurations: False: moves stay as they were planned alone.

    Returns:
        A result whose status is success only if the certificate passed; else its message and place
        name the move and say what is in the way.

    Raises:
        OptionError: A slack is asked for that the method does not honour.
        ProblemError: The cycle is none, or a move cannot begin where the one before ended.
        KeyboardInterrupt: Ctrl-C before all moves were certified.
    """
    Cycle.require(cycle)
    options = given_options(options, PlanOptions)
    for k in range(len(cycle.legs)):
        require_honoured(cycle.problem_from_anywhere(k), options)
    clock = PlanningClock(options.time_limit, progress)
    try:
        _require_within_bound(cycle)
        greedy = greedy_plan(cycle, options, clock)
    except BlockedLeg as blocked:
        return _blocked(cycle, blocked, options, clock)
    shared, stopped_by = None, _stop_of(greedy)
    if shares_configurations and stopped_by is None:
        shared, stopped_by = until_stopped(partial(shared_plan, cycle, greedy, options, clock))
    answer = partial(_answer, cycle, greedy, options, clock, stopped_by)
    result = answer(shared or greedy)
    return result if result.succeeded or shared is None else answer(greedy)


def _answer(
    cycle: Cycle,
    greedy: Sequence[LegPlan],
    options: PlanOptions,
    clock: PlanningClock,
    stopped_by: StoppedBy | None,
    plans: Sequence[LegPlan],
) -> CycleResult:
    """Return the result of the shortest motions of all legs, as they are written."""
    if stopped_by is not None:  # then they stay as they are, but for whole periods
        plans = [
            replace(plan, result=replace(plan.result, stopped_by=stopped_by)) for plan in plans
        ]
    written = [_followed(cycle, k, plan, options, clock) for k, plan in enumerate(plans)]
    result = _certified(cycle, written, greedy, options, clock, stopped_by or _stop_of(written))
    return replace(result, notes=(*result.notes, *_notes(cycle, plans, written)))


def _followed(
    cycle: Cycle, k: int, plan: LegPlan, options: PlanOptions, clock: PlanningClock
) -> LegPlan:
    """Return the motion of a leg that is written, between the ends of its shortest one."""
    with clock.within(cycle.called(k)):
        problem = replace(plan.problem, start=plan.begin, goal=plan.end)
        fixed = plan.between(problem)
        result = followed_plan(problem, fixed.result, options.slack, clock)
    return LegPlan(problem, result)


def _certified(
    cycle: Cycle,
    plans: Sequence[LegPlan],
    greedy: Sequence[LegPlan],
    options: PlanOptions,
    clock: PlanningClock,
    stopped_by: StoppedBy | None,
) -> CycleResult:
    """Return the result of all legs together, judged as one motion."""
    for k, plan in enumerate(plans):
        if not plan.result.succeeded:
            return _blocked(cycle, BlockedLeg(k, plan.result), options, clock)
    each = zip(cycle.legs, plans, strict=True)
    motion = cycle_motion(cycle, [leg_motion(leg, plan) for leg, plan in each])
    begin = clock.elapsed
    certificate = verify_cycle(cycle, motion)
    rests = motion.trajectory.duration - sum(plan.duration for plan in plans)
    result = CycleResult(
        PlanStatus.SUCCESS,
        _message(cycle, motion),
        Place(),
        options.method,
        motion,
        certificate,
        tuple(plans),
        greedy_duration=rests + sum(plan.duration for plan in greedy),
        planning_time=clock.elapsed,
        certificate_time=clock.elapsed - begin,
        stopped_by=stopped_by,
        sensitivities=cycle_sensitivities(cycle, plans),
    )
    if certificate.passed:
        return result
    worst = certificate.failures()[0]
    return replace(
        result,
        status=PlanStatus.CERTIFICATE_FAILED,
        message=f"the certificate of the whole fails: {certificate.describe(worst)}",
        motion=None,
    )


def _require_within_bound(cycle: Cycle) -> None:
    """Raise BlockedLeg if a point of a leg is out of reach for certain."""
    for k in range(len(cycle.legs)):
        try:
            require_within_bound(cycle.problem_from_anywhere(k), start_is_known=k == 0)
        except Infeasible as reason:
            raise BlockedLeg(k, refused_result(reason, "")) from None


def _blocked(
    cycle: Cycle, blocked: BlockedLeg, options: PlanOptions, clock: PlanningClock
) -> CycleResult:
    """Return the result that a leg has no answer.

    Raises:
        KeyboardInterrupt: It was Ctrl-C that ended it.
    """
    result, leg = with_grounds(blocked.result), cycle.legs[blocked.leg]
    if result.status is PlanStatus.INTERRUPTED:
        raise KeyboardInterrupt
    where = cycle.called(blocked.leg)
    if len(leg.moves) > 1:
        where += " (segments are counted over all of them)"
    return CycleResult(
        result.status,
        f"{where}: {result.message}",
        leg.in_cycle(result.place, 0.0),
        options.method,
        planning_time=clock.elapsed,
        stopped_by=result.stopped_by,
        notes=result.notes,
        proved=result.proved,
        starts_tried=result.starts_tried,
    )


def _stop_of(plans: Sequence[LegPlan]) -> StoppedBy | None:
    """Return what stopped the planning of any leg early."""
    return next((each for plan in plans if (each := plan.result.stopped_by) is not None), None)


def _message(cycle: Cycle, motion: CycleMotion) -> str:
    moving = sum(end - begin for begin, end in motion.leg_times)
    whole = motion.trajectory.duration
    moves = sum(len(leg.moves) for leg in cycle.legs)
    return (
        f"certified cycle of {whole:.4f} s: {moves} moves in {moving:.4f} s, "
        f"{whole - moving:.4g} s at rest"
    )


def _notes(cycle: Cycle, shortest: Sequence[LegPlan], plans: Sequence[LegPlan]) -> tuple[str, ...]:
    """Return what is worth knowing of the legs, once where it is the same of several.

    Args:
        cycle: The cycle.
        shortest: The shortest motions.
        plans: Those that are written.
    """
    said: dict[str, list[str]] = {}
    for leg, plan in zip(cycle.legs, shortest, strict=True):
        problem = plan.problem
        for note in (*problem.robot.limits.notes, *problem.tube.notes, *plan.result.notes):
            said.setdefault(note, []).append(leg.name)
    notes = [
        note if len(names) == len(cycle.legs) else f"move {', '.join(names)}: {note}"
        for note, names in said.items()
    ]
    return (*notes, *_smoothing_note(shortest, plans))


def _smoothing_note(shortest: Sequence[LegPlan], plans: Sequence[LegPlan]) -> list[str]:
    """Return how many legs take longer than they must, to be smooth or thrifty."""
    longer = [p for s, p in zip(shortest, plans, strict=True) if p.duration > s.duration]
    if not longer:
        return []
    fewest, most = sum(p.duration for p in shortest), sum(p.duration for p in plans)
    return [
        f"{len(longer)} of {len(plans)} motions between rests are not the shortest, but better by "
        f"their objective: {most:.4f} s in all instead of {fewest:.4f} s; --slack 0 gives these"
    ]
