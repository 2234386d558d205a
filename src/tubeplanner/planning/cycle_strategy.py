"""Planning of a cycle: one certified motion of all moves."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from tubeplanner.certificate.verification import judged_visits, verify_cycle
from tubeplanner.checks import checked_options
from tubeplanner.outcome import (
    Infeasible,
    Location,
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
from tubeplanner.planning.result import refused_result, with_diagnosis
from tubeplanner.planning.second_stage import followed_plan
from tubeplanner.planning.strategy import require_supported
from tubeplanner.robot.notes import robot_notes
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.demands import SMOOTHNESS, Objective
from tubeplanner.task.info import cycle_doubts
from tubeplanner.task.legs import Leg
from tubeplanner.task.motion import LegMotion, cycle_motion

_SAMPLES = 200


def plan_cycle(
    cycle: Cycle,
    options: PlanOptions | None = None,
    progress: ProgressCallback | None = None,
    *,
    shares_configurations: bool = True,
) -> CycleResult:
    """Plan and certify the motion of a whole cycle.

    Moves are planned alone, in order, each from the end of the last one. Then the configurations
    between moves, where a move ends openly, are chosen for the least sum of durations.

    Args:
        cycle: The cycle.
        options: Options of planning for every move; the time limit is that of the whole.
        progress: As of `plan`.
        shares_configurations: False: moves stay as they were planned alone.

    Returns:
        A result whose status is success only if the certificate passed; else its message and place
        name the move and the obstruction.

    Raises:
        OptionError: A slack is asked for that the method does not honour.
        ProblemError: The cycle is no `Cycle`, or a move cannot begin at the end of the last one.
        KeyboardInterrupt: Ctrl-C before all moves were certified.
    """
    Cycle.require(cycle)
    options = checked_options(options, PlanOptions)
    for k in range(len(cycle.legs)):
        require_supported(cycle.problem_from_anywhere(k), options)
    clock = PlanningClock(options.time_limit, progress)
    doubts = cycle_doubts(cycle)
    try:
        for k in range(len(cycle.legs)):
            try:
                require_within_bound(cycle.problem_from_anywhere(k), start_is_known=k == 0)
            except Infeasible as reason:
                raise BlockedLeg(k, refused_result(reason, "")) from None
        greedy = greedy_plan(cycle, options, clock)
    except BlockedLeg as blocked:
        refused = _blocked(cycle, blocked, options, clock)
        return replace(refused, notes=(*doubts, *refused.notes))
    shared, stopped_by = None, _stop_of(greedy)
    if shares_configurations and stopped_by is None:
        shared, stopped_by = until_stopped(partial(shared_plan, cycle, greedy, options, clock))
    answer = partial(_answer, cycle, greedy, options, clock, stopped_by)
    result = answer(shared or greedy)
    result = result if result.succeeded or shared is None else answer(greedy)
    return replace(result, notes=(*doubts, *result.notes))


def _answer(
    cycle: Cycle,
    greedy: Sequence[LegPlan],
    options: PlanOptions,
    clock: PlanningClock,
    stopped_by: StoppedBy | None,
    plans: Sequence[LegPlan],
) -> CycleResult:
    """Return the result of all legs, from their shortest motions."""
    if stopped_by is not None:  # then motions stay as they are, but for whole periods
        plans = [
            replace(plan, result=replace(plan.result, stopped_by=stopped_by)) for plan in plans
        ]
    written = []
    for k, plan in enumerate(plans):
        with clock.within(cycle.label(k)):
            problem = replace(plan.problem, start=plan.begin, goal=plan.end)
            followed = followed_plan(problem, plan.between(problem).result, options.slack, clock)
        written.append(LegPlan(problem, followed))
    result = _certified(cycle, written, greedy, options, clock, stopped_by or _stop_of(written))
    return replace(result, notes=(*result.notes, *_notes(cycle, plans, written)))


def _certified(
    cycle: Cycle,
    plans: Sequence[LegPlan],
    greedy: Sequence[LegPlan],
    options: PlanOptions,
    clock: PlanningClock,
    stopped_by: StoppedBy | None,
) -> CycleResult:
    """Return the result of all legs, judged as a single motion."""
    for k, plan in enumerate(plans):
        if not plan.result.succeeded:
            return _blocked(cycle, BlockedLeg(k, plan.result), options, clock)
    legs = zip(cycle.legs, plans, strict=True)
    motion = cycle_motion(cycle, [leg_motion(leg, plan) for leg, plan in legs])
    moves = sum(len(leg.moves) for leg in cycle.legs)
    moving = sum(end - begin for begin, end in motion.leg_times)
    begin = clock.elapsed
    certificate = verify_cycle(cycle, motion)
    dwells = motion.trajectory.duration - sum(plan.duration for plan in plans)
    result = CycleResult(
        PlanStatus.SUCCESS,
        f"certified cycle of {motion.trajectory.duration:.4f} s: {moves} move{'s' * (moves > 1)} "
        f"in {moving:.4f} s, {motion.trajectory.duration - moving:.4g} s at rest",
        Location(),
        options.method,
        motion,
        certificate,
        tuple(plans),
        greedy_duration=dwells + sum(plan.duration for plan in greedy),
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


def leg_motion(leg: Leg, plan: LegPlan) -> LegMotion:
    """Return the motion of a leg's successful plan, with the times at which its moves begin."""
    trajectory = plan.result.trajectory
    assert trajectory is not None
    problem, numbers = plan.problem, plan.problem.joined.tube.numbers
    begins: list[float] = []
    for first in leg.first_segments[1:]:
        visits = judged_visits(problem, trajectory)
        k = int(np.searchsorted(numbers, first))
        if numbers[k] == first:
            begins.append(next(visit.begin for visit in visits if visit.segment >= k))
            continue
        # Segments on one line are joined: the sample nearest to the segment's first point counts.
        inside = [visit for visit in visits if visit.segment == k - 1]
        times = np.linspace(inside[0].begin, inside[-1].end, _SAMPLES)
        tool = problem.robot.tool_position(trajectory.position(times))
        point = problem.tube.points[np.searchsorted(problem.tube.numbers, first)]
        begins.append(float(times[np.linalg.norm(tool - point, axis=1).argmin()]))
    return LegMotion(trajectory, tuple(begins))


def _blocked(
    cycle: Cycle, blocked: BlockedLeg, options: PlanOptions, clock: PlanningClock
) -> CycleResult:
    """Return the result that a leg has no answer.

    Raises:
        KeyboardInterrupt: Ctrl-C stopped the leg's planning.
    """
    result, leg = with_diagnosis(blocked.result), cycle.legs[blocked.leg]
    if result.status is PlanStatus.INTERRUPTED:
        raise KeyboardInterrupt
    where = cycle.label(blocked.leg)
    if len(leg.moves) > 1:
        where += " (segments are counted over all of them)"
    return CycleResult(
        result.status,
        f"{where}: {result.message}",
        leg.in_cycle(result.location, 0.0),
        options.method,
        planning_time=clock.elapsed,
        stopped_by=result.stopped_by,
        notes=result.notes,
        proved=result.proved,
        starts_tried=result.starts_tried,
    )


def _stop_of(plans: Sequence[LegPlan]) -> StoppedBy | None:
    """Return the cause of the first early stop of the legs' planning, or None."""
    return next((each for plan in plans if (each := plan.result.stopped_by) is not None), None)


def _notes(cycle: Cycle, shortest: Sequence[LegPlan], plans: Sequence[LegPlan]) -> tuple[str, ...]:
    """Return the notes on the legs; a note of several legs once.

    Args:
        cycle: The cycle.
        shortest: The shortest motions.
        plans: The written motions.
    """
    names_by_note: dict[str, list[str]] = {}
    for leg, plan in zip(cycle.legs, shortest, strict=True):
        problem = plan.problem
        own = (*robot_notes(problem.robot), *problem.tube.notes, *plan.result.notes)
        for note in dict.fromkeys(own):
            names_by_note.setdefault(note, []).append(leg.name)
    notes = [
        note if len(names) == len(cycle.legs) else f"move {', '.join(names)}: {note}"
        for note, names in names_by_note.items()
    ]
    if any(p.duration > s.duration for s, p in zip(shortest, plans, strict=True)):
        objectives = {(each.problem.objective or Objective()).minimise for each in plans}
        done = "smoothed" if objectives == {SMOOTHNESS} else "better by the objective"
        least, total = sum(p.duration for p in shortest), sum(p.duration for p in plans)
        notes.append(f"{done}: moves of {total:.4f} s; the shortest are {least:.4f} s (--slack 0)")
    return tuple(notes)
