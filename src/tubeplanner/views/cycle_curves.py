"""What there is to draw of the motion of a cycle: of every leg and of every rest, in turn."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.errors import ProblemError
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.views.binding_strip import LimitedMotion, limited_motion
from tubeplanner.views.stretch import Stretch, TrajectoryCurves, trajectory_curves


def cycle_curves(cycle: Cycle, motion: CycleMotion) -> list[TrajectoryCurves]:
    """Return the curves of legs and rests in order, their times those of the whole motion.

    Each has the arm as it is then, with what it carries.
    """
    legs = [
        _later(trajectory_curves(stretch.problem, stretch.trajectory), stretch.begin)
        for stretch in cycle_stretches(cycle, motion)
    ]
    found: list[TrajectoryCurves] = []
    for k, leg in enumerate(legs):
        found += [*_rest_curves(cycle, motion, k, leg, 0), leg]
    return [*found, *_rest_curves(cycle, motion, len(legs), legs[-1], -1)]


def limited_motions(cycle: Cycle, motion: CycleMotion) -> list[LimitedMotion]:
    """Return what there is to say of the limits of all legs, in order."""
    return [
        limited_motion(stretch.problem, stretch.trajectory, stretch.begin)
        for stretch in cycle_stretches(cycle, motion)
    ]


def cycle_stretches(cycle: Cycle, motion: CycleMotion) -> tuple[Stretch, ...]:
    """Return the legs of a motion, each under its problem."""
    legs = zip(motion.legs, motion.leg_times, strict=True)
    return tuple(
        Stretch(_problem(cycle, motion, k), leg, begin) for k, (leg, (begin, _)) in enumerate(legs)
    )


def _problem(cycle: Cycle, motion: CycleMotion, k: int) -> PlanningProblem:
    """Return the problem of a leg as the judge has it, which tells what segment counts when.

    What begins where its problem has no place fails, and is drawn all the same.
    """
    try:
        return cycle.problem(k, motion.seams[: k + 1])
    except ProblemError:
        return cycle.problem_from_anywhere(k)


def _later(curves: TrajectoryCurves, begin: float) -> TrajectoryCurves:
    """Return curves that begin at another time [s]."""
    return replace(curves, samples=replace(curves.samples, time=curves.samples.time + begin))


def _rest_curves(
    cycle: Cycle, motion: CycleMotion, seam: int, beside: TrajectoryCurves, sample: int
) -> Iterator[TrajectoryCurves]:
    """Yield the curves of what takes time at a seam.

    Args:
        cycle: The cycle.
        motion: Its motion.
        seam: Which one.
        beside: Of the leg after it, or before it.
        sample: Which of its samples is at the seam.
    """
    rest, marks = cycle.rest_at(seam), motion.marks
    first = sum(len(leg.before.steps) + len(leg.moves) for leg in cycle.legs[:seam])
    times = [mark.time for mark in marks[first : first + len(rest.steps) + 1]]
    if seam == len(cycle.legs):
        times.append(motion.trajectory.duration)
    for (begin, end), arm in zip(pairwise(times), rest.arms[1:], strict=True):
        if end > begin:
            yield _held_curves(beside, sample, arm, (begin, end))


def _held_curves(
    beside: TrajectoryCurves, sample: int, arm: RobotModel, span: tuple[float, float]
) -> TrajectoryCurves:
    """Return what is at a sample, at rest for a span of time [s]: motors hold the arm."""
    rows = np.arange(len(beside.segment))[[sample, sample]]
    given = beside.samples
    still = np.zeros_like(given.velocity[rows])
    return replace(
        beside,
        samples=replace(
            given,
            time=np.array(span),
            position=given.position[rows],
            velocity=still,
            acceleration=still,
        ),
        jerk=still,
        effort=arm.gravity_effort(given.position[rows]),
        effort_rate=None if beside.effort_rate is None else still,
        tool=beside.tool[rows],
        speed=np.zeros(2),
        speed_limit=beside.speed_limit[rows],
        points=np.zeros_like(beside.points[rows]),
        segment=beside.segment[rows],
        tube_use=beside.tube_use[rows],
        rotation_use=None if beside.rotation_use is None else beside.rotation_use[rows],
    )
