"""Verdict over a cycle's runs: legs, hand-over errors."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.execution.excursions import Extreme
from tubeplanner.execution.plants import first_instant, last_instant
from tubeplanner.execution.run_verdict import JudgedRun, judged_runs
from tubeplanner.execution.simulation import Execution
from tubeplanner.task.cycle_motion import CycleMotion
from tubeplanner.task.legs import Leg
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import ATTACH, DETACH, Mark, part_of

# ---- What was executed of a cycle, leg by leg, each with the cell as it is planned to be then.


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


# ---- Where the tool is when it takes something or lets it go.


@dataclass(frozen=True, eq=False)
class HandoverErrors:
    """How far R tools are from where they should be when something changes hands.

    Attributes:
        mark: What, and when.
        distance: Of the tool centre points, errors of tool and base included, shape (R,) [m].
        angle: By which they are turned, shape (R,) [rad].
        speed: Of the tool centre points, which should be at rest, shape (R,) [m/s].
    """

    mark: Mark
    distance: FloatArray
    angle: FloatArray
    speed: FloatArray

    __repr__ = short_repr

    def as_dict(self) -> dict[str, Any]:
        """Return the mark, and the worst and the median of each quantity, as JSON values."""
        found = {name: getattr(self, name) for name in ("distance", "angle", "speed")}
        return self.mark.as_dict() | {
            name: {
                "worst": float(values.max()),
                "run": int(values.argmax()),
                "median": float(np.median(values)),
            }
            for name, values in found.items()
        }


def handover_errors(motion: CycleMotion, execution: Execution) -> Iterator[HandoverErrors]:
    """Yield where the tools are when something changes hands, at the last control period before.

    Args:
        motion: The planned motion.
        execution: Of its trajectory.
    """
    robot = motion.cycle.robot
    for mark in motion.marks:
        if mark.kind not in (ATTACH, DETACH):
            continue
        k = last_instant(execution.time, mark.time)
        turned, aim = robot.tool_pose(motion.trajectory.position(mark.time)[None])
        q, v = execution.position[:, k], execution.velocity[:, k]
        poses = [
            plant.tool_pose(robot, one[None])
            for plant, one in zip(execution.plants, q, strict=True)
        ]
        away = np.array([position[0] - aim[0] for _, position in poses])
        angle = np.array([_angle(turned[0].T @ rotation[0]) for rotation, _ in poses])
        speed = np.linalg.norm(robot.tool_velocity(q, v)[0], axis=1)
        yield HandoverErrors(mark, np.linalg.norm(away, axis=1), angle, speed)


def _angle(rotation: FloatArray) -> float:
    """Return the angle of a rotation (3, 3) [rad]."""
    axis = rotation - rotation.T
    sine = np.linalg.norm(axis) / np.sqrt(8)
    return float(np.arctan2(sine, (np.trace(rotation) - 1) / 2))


# ---- What becomes of a cycle's promises when it is executed: seen in n runs, not proved.

_LARGEST = ("tube", "rotation", "points", "tracking", "tool_tracking", "position", "velocity")


@dataclass(frozen=True, eq=False)
class JudgedCycle:
    """The executed motions of a cycle, at every control period.

    Attributes:
        legs: Every run of each leg, by the names of its moves; times and places in the cycle.
        runs: Every run of the whole.
        handovers: Where the tools are when something changes hands.
    """

    legs: dict[tuple[str, ...], list[JudgedRun]]
    runs: list[JudgedRun]
    handovers: list[HandoverErrors]

    __repr__ = short_repr


def judged_cycle(
    motion: CycleMotion, execution: Execution, checkpoint: Callable[[], None] = lambda: None
) -> JudgedCycle:
    """Judge the executed motions of a cycle.

    Every leg is judged as the motion of its planning problem, as `executed_legs` cuts it out. Of
    the whole, a run has the worst of all its legs; motors count from first to last.

    Args:
        motion: What was to be executed.
        execution: What was.
        checkpoint: Called before every run of every leg; may raise to end the work.

    Raises:
        ProblemError: A leg begins or ends where its problem has no place.
    """
    legs = {
        tuple(move.name for move in each.leg.moves): _judged(each, checkpoint)
        for each in executed_legs(motion, execution)
    }
    saturated = execution.is_saturated.any(axis=2).mean(axis=1)
    runs = [
        replace(_whole(run), saturated=float(share))
        for run, share in zip(zip(*legs.values(), strict=True), saturated, strict=True)
    ]
    return JudgedCycle(legs, runs, list(handover_errors(motion, execution)))


def _judged(leg: ExecutedLeg, checkpoint: Callable[[], None]) -> list[JudgedRun]:
    """Return the runs of a leg, their times and places those of the cycle."""
    runs = judged_runs(leg.problem, leg.trajectory, leg.execution, checkpoint)
    return [_in_cycle(run, leg) for run in runs]


def _in_cycle(run: JudgedRun, leg: ExecutedLeg) -> JudgedRun:
    placed: dict[str, Any] = {
        name: replace(found, place=leg.leg.in_cycle(found.place, leg.begin))
        for name, found in vars(run).items()
        if isinstance(found, Extreme)
    }
    return replace(run, **placed)


def _whole(legs: Sequence[JudgedRun]) -> JudgedRun:
    """Return a run of the whole: of every quantity the worst of all legs."""
    worst: dict[str, Any] = {name: _most(legs, name) for name in _LARGEST}
    # The distance that is least beside what its own move asks.
    near = [leg for leg in legs if leg.obstacles is not None]
    nearest = min(near, key=_spare, default=legs[0])
    folded = [leg.self_collision for leg in legs if leg.self_collision is not None]
    return replace(
        legs[0],
        **worst,
        obstacles=nearest.obstacles,
        clearance=nearest.clearance,
        self_collision=min(folded, key=lambda found: found.value, default=None),
        tube_by_segment=np.concatenate([leg.tube_by_segment for leg in legs]),
        rotation_by_segment=np.concatenate([leg.rotation_by_segment for leg in legs]),
        position_by_joint=np.max([leg.position_by_joint for leg in legs], axis=0),
    )


def _most(legs: Sequence[JudgedRun], name: str) -> Extreme | None:
    """Return the largest of a quantity of all legs; None where none is asked it."""
    found = [getattr(leg, name) for leg in legs]
    return max(
        (extreme for extreme in found if extreme is not None),
        key=lambda extreme: extreme.value,
        default=None,
    )


def _spare(leg: JudgedRun) -> float:
    assert leg.obstacles is not None
    return leg.obstacles.value - leg.clearance
