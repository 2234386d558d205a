"""Which joint keeps configurations out of bounds."""

from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel


class OutsideBounds(NamedTuple):
    """A joint outside its bounds.

    Attributes:
        joint: Its index.
        is_above: Whether it is above the upper one, not below the lower one.
        words: Its name, where it would be, and the bounds.
    """

    joint: int
    is_above: bool
    words: str


def outside_bounds(
    robot: RobotModel, found: FloatArray, lower: FloatArray, upper: FloatArray
) -> OutsideBounds:
    """Return the joint that is farthest outside, in the configuration that is so the least.

    Args:
        robot: The arm.
        found: Configurations, each outside, shape (c, n) [rad or m].
        lower: Lower bounds, shape (n,).
        upper: Upper bounds, shape (n,).
    """
    beyond = np.maximum(np.maximum(lower - found, found - upper), 0.0)
    best = int(beyond.max(axis=1).argmin())
    joint = int(beyond[best].argmax())
    value = float(found[best, joint])
    return OutsideBounds(
        joint,
        value > upper[joint],
        f"'{robot.joint_names[joint]}' would be at {value:.4g}, outside "
        f"[{lower[joint]:g}, {upper[joint]:g}]",
    )


def bounded_by(problem: PlanningProblem, segments: tuple[int, ...], outside: OutsideBounds) -> str:
    """Return whether position limits or joint signs of segments bound a joint outside them."""
    limits, joint, rows = problem.robot.limits, outside.joint, list(segments)
    if outside.is_above:
        is_limit = problem.joint_upper[rows, joint].min() == limits.upper_position[joint]
    else:
        is_limit = problem.joint_lower[rows, joint].max() == limits.lower_position[joint]
    return "position limits" if is_limit else "joint signs"
