"""Verdict over a cycle's runs: executed legs, hand-over errors."""

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
from tubeplanner.task.demands import Robustness
from tubeplanner.task.legs import Leg
from tubeplanner.task.motion import CycleMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import ATTACH, DETACH, Mark, part_of

# Quantities of a run whose largest value is the worst.
_LARGEST = ("tube", "rotation", "points", "tracking", "tool_tracking", "position", "velocity")


@dataclass(frozen=True, eq=False)
class HandoverErrors:
    """The pose errors and speeds of R tools at an attach or detach.

    Attributes:
        mark: The attach or detach, with its time.
        distance: Errors of the tool centre points, of tool and base included, shape (R,) [m].
        angle: Rotation errors of the tools, shape (R,) [rad].
        speed: Speeds of the tool centre points, planned at rest, shape (R,) [m/s].
    """

    mark: Mark
    distance: FloatArray
    angle: FloatArray
    speed: FloatArray

    __repr__ = short_repr

    def as_dict(self) -> dict[str, Any]:
        """Return the mark, and the worst and the median of each quantity, as JSON values."""
        quantities = {name: getattr(self, name) for name in ("distance", "angle", "speed")}
        return self.mark.as_dict() | {
            name: {
                "worst": float(values.max()),
                "run": int(values.argmax()),
                "median": float(np.median(values)),
            }
            for name, values in quantities.items()
        }


@dataclass(frozen=True, eq=False)
class JudgedCycle:
    """The verdict over the runs of a cycle at its control instants; nothing is proved between.

    Attributes:
        legs: Runs of each leg, by the names of its moves; times and places in the cycle.
        runs: Runs of the whole cycle.
        handovers: Errors at each attach and detach.
    """

    legs: dict[tuple[str, ...], list[JudgedRun]]
    runs: list[JudgedRun]
    handovers: list[HandoverErrors]

    __repr__ = short_repr


def judged_cycle(
    motion: CycleMotion,
    execution: Execution,
    checkpoint: Callable[[], None] = lambda: None,
    errors: Robustness | None = None,
) -> JudgedCycle:
    """Judge the executed motions of a cycle.

    Every leg is judged as the motion of its planning problem, as `executed_legs` cuts it out. A
    run of the cycle has the worst of all its legs; saturation counts at all instants.

    Args:
        motion: The planned motion.
        execution: The execution of its trajectory.
        checkpoint: Called before every run of every leg; may raise to end the work.
        errors: The field with the controller's stops; None: the default.

    Raises:
        ProblemError: A leg begins or ends where its problem does not allow it.
    """
    legs: dict[tuple[str, ...], list[JudgedRun]] = {}
    for leg in executed_legs(motion, execution):
        judged = judged_runs(leg.problem, leg.trajectory, leg.execution, checkpoint, errors)
        runs_of_leg = legs[tuple(move.name for move in leg.leg.moves)] = []
        for run in judged:
            extremes: dict[str, Any] = {
                name: replace(extreme, location=leg.leg.in_cycle(extreme.location, leg.begin))
                for name, extreme in vars(run).items()
                if isinstance(extreme, Extreme)
            }
            runs_of_leg.append(replace(run, **extremes))
    saturated = execution.is_saturated.any(axis=2).mean(axis=1)
    runs = [
        replace(_whole(run), saturated=float(fraction))
        for run, fraction in zip(zip(*legs.values(), strict=True), saturated, strict=True)
    ]
    return JudgedCycle(legs, runs, list(handover_errors(motion, execution)))


def _whole(legs: Sequence[JudgedRun]) -> JudgedRun:
    """Return a run of the cycle: the worst of all legs for each quantity."""
    worst: dict[str, Any] = {}
    for name in _LARGEST:
        extremes = [extreme for leg in legs if (extreme := getattr(leg, name)) is not None]
        worst[name] = max(extremes, key=lambda extreme: extreme.value, default=None)
    # Each leg has a clearance of its own: the nearest is the least distance beyond its clearance.
    slack = [leg.obstacles.value - leg.clearance if leg.obstacles else np.inf for leg in legs]
    nearest = legs[int(np.argmin(slack))]
    folded = [leg.self_collision for leg in legs if leg.self_collision is not None]
    # The unit of the joint farthest from the plan may be another in each leg.
    farthest = max(legs, key=lambda leg: (leg.tracking_by_joint.max(), leg.tracking.value))
    return replace(
        legs[0],
        **worst | {"tracking": farthest.tracking, "stops": farthest.stops},
        obstacles=nearest.obstacles,
        clearance=nearest.clearance,
        self_collision=min(folded, key=lambda extreme: extreme.value, default=None),
        tube_by_segment=np.concatenate([leg.tube_by_segment for leg in legs]),
        rotation_by_segment=np.concatenate([leg.rotation_by_segment for leg in legs]),
        position_by_joint=np.max([leg.position_by_joint for leg in legs], axis=0),
        velocity_by_joint=np.max([leg.velocity_by_joint for leg in legs], axis=0),
        tracking_by_joint=np.max([leg.tracking_by_joint for leg in legs], axis=0),
    )


@dataclass(frozen=True, eq=False)
class ExecutedLeg:
    """The execution of one leg and of the rests beside it under the same load.

    Attributes:
        leg: The leg.
        begin: Time in the cycle at which the section begins [s].
        problem: The leg's planning problem, with the cell as planned for that time.
        trajectory: The planned section, from time zero.
        execution: The executed section, in times of `trajectory`.
    """

    leg: Leg
    begin: float
    problem: PlanningProblem
    trajectory: JointTrajectory
    execution: Execution

    __repr__ = short_repr


def executed_legs(motion: CycleMotion, execution: Execution) -> list[ExecutedLeg]:
    """Return the executed legs in the cycle's order.

    A leg counts from the last attach or detach before it to the first after it; where the load
    does not change, from its beginning to that of the next leg. Attached and detached objects are
    where the planned motion has them.

    Args:
        motion: The planned motion.
        execution: The execution of its trajectory.

    Raises:
        ProblemError: A leg begins or ends where its problem does not allow it.
    """
    time, result = execution.time, []
    problems = motion.cycle.problems(motion.junctions)
    for leg, problem, span in zip(motion.cycle.legs, problems, _spans(motion), strict=True):
        begin, end = span
        part = part_of(motion.trajectory, begin, min(end, motion.trajectory.duration))
        first = first_instant(time, begin)
        instants = slice(first, max(last_instant(time, end), first) + 1)  # at least one
        section = replace(
            execution,
            time=time[instants] - begin,
            position=execution.position[:, instants],
            velocity=execution.velocity[:, instants],
            effort=execution.effort[:, instants],
            is_saturated=execution.is_saturated[:, instants],
        )
        result.append(ExecutedLeg(leg, begin, problem, part, section))
    return result


def _spans(motion: CycleMotion) -> list[tuple[float, float]]:
    """Return begin and end of each leg's section [s]; an end of inf is that of the execution."""
    handed_over = [mark.time for mark in motion.marks if mark.kind in (ATTACH, DETACH)]
    ends = [0.0, *(end for _, end in motion.leg_times)]
    begins = [*(begin for begin, _ in motion.leg_times), np.inf]
    stops = [
        [time for time in handed_over if end <= time <= begin]
        for end, begin in zip(ends, begins, strict=True)
    ]
    junctions = [
        (min(at, default=begin), max(at, default=begin))
        for at, begin in zip(stops, begins, strict=True)
    ]
    return [(last, first) for (_, last), (first, _) in pairwise(junctions)]


def handover_errors(motion: CycleMotion, execution: Execution) -> Iterator[HandoverErrors]:
    """Yield the errors at each attach and detach, at the last control instant before.

    Args:
        motion: The planned motion.
        execution: The execution of its trajectory.
    """
    robot = motion.cycle.robot
    for mark in motion.marks:
        if mark.kind not in (ATTACH, DETACH):
            continue
        k = last_instant(execution.time, mark.time)
        orientation, aim = robot.tool_pose(motion.trajectory.position(mark.time)[None])
        q, v = execution.position[:, k], execution.velocity[:, k]
        poses = [
            plant.displaced(*robot.tool_pose(row[None]))
            for plant, row in zip(execution.plants, q, strict=True)
        ]
        offset = np.array([position[0] - aim[0] for _, position in poses])
        angle = np.array([_angle(orientation[0].T @ rotation[0]) for rotation, _ in poses])
        speed = np.linalg.norm(robot.tool_velocity(q, v)[0], axis=1)
        yield HandoverErrors(mark, np.linalg.norm(offset, axis=1), angle, speed)


def _angle(rotation: FloatArray) -> float:
    """Return the angle of a rotation (3, 3) [rad]."""
    axis = rotation - rotation.T
    sine = np.linalg.norm(axis) / np.sqrt(8)
    return float(np.arctan2(sine, (np.trace(rotation) - 1) / 2))
