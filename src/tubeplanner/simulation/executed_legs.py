"""What was executed of a cycle, leg by leg, each with the cell as it is planned to be then."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.cycle.leg import Leg
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.short_repr import short_repr
from tubeplanner.simulation.execution import Execution
from tubeplanner.simulation.stage import first_instant, last_instant
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.marks import ATTACH, DETACH
from tubeplanner.trajectory.parts import part_of


@dataclass(frozen=True, eq=False)
class ExecutedLeg:
    """What was executed of one leg, and while the arm rests beside it with the same in its hand.

    Attributes:
        leg: Which one.
        begin: When that begins [s].
        problem: What it keeps.
        trajectory: What was to be executed, from time zero.
        execution: What was, in times of the trajectory.
    """

    leg: Leg
    begin: float
    problem: PlanningProblem
    trajectory: JointTrajectory
    execution: Execution

    __repr__ = short_repr


def executed_legs(motion: CycleMotion, execution: Execution) -> list[ExecutedLeg]:
    """Return what was executed of every leg.

    A leg counts from when the tool last takes or lets something go before it until it first does
    so after it; where nothing changes hands, from its beginning to that of the next. What was taken
    or let go is where the planned motion has it.

    Args:
        motion: The planned motion.
        execution: Of its trajectory.

    Raises:
        ProblemError: A leg begins or ends where its problem has no place.
    """
    time, found = execution.time, []
    problems = motion.cycle.problems(motion.seams)
    for leg, problem, span in zip(motion.cycle.legs, problems, _spans(motion), strict=True):
        begin, end = span
        part = part_of(motion.trajectory, begin, min(end, motion.trajectory.duration))
        while_it = slice(first_instant(time, begin), last_instant(time, end) + 1)
        made = _between(execution, while_it, begin)
        found.append(ExecutedLeg(leg, begin, problem, part, made))
    return found


def _spans(motion: CycleMotion) -> list[tuple[float, float]]:
    """Return from when until when each leg counts [s]; inf: to the end of what is executed."""
    handed_over = [mark.time for mark in motion.marks if mark.kind in (ATTACH, DETACH)]
    legs = motion.leg_times
    ends = [0.0, *(end for _, end in legs)]
    begins = [*(begin for begin, _ in legs), np.inf]
    rests = [
        [time for time in handed_over if end <= time <= begin]
        for end, begin in zip(ends, begins, strict=True)
    ]
    seams = [
        (min(at, default=begin), max(at, default=begin))
        for at, begin in zip(rests, begins, strict=True)
    ]
    return [(last, first) for (_, last), (first, _) in pairwise(seams)]


def _between(execution: Execution, while_it: slice, begin: float) -> Execution:
    """Return what was executed in some instants, in times from a beginning [s]."""
    return replace(
        execution,
        time=execution.time[while_it] - begin,
        position=execution.position[:, while_it],
        velocity=execution.velocity[:, while_it],
        effort=execution.effort[:, while_it],
        is_saturated=execution.is_saturated[:, while_it],
    )
