"""Where the tool is when it takes something or lets it go."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.short_repr import short_repr
from tubeplanner.simulation.execution import Execution
from tubeplanner.simulation.stage import last_instant
from tubeplanner.trajectory.marks import ATTACH, DETACH, Mark


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
