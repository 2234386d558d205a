"""How far an arm can reach at most: the sum of the lengths between its joints."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel


@dataclass(frozen=True, eq=False)
class ReachBound:
    """A ball that the tool cannot leave, whatever the joints do within their limits.

    Attributes:
        center: The first joint's origin, shape (3,), base frame [m].
        radius: [m]; infinite where a sliding joint has no limits.
    """

    center: FloatArray
    radius: float

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return how far outside points (N, 3) are, negative inside, shape (N,) [m]."""
        outside: FloatArray = np.linalg.norm(points - self.center, axis=1) - self.radius
        return outside


def reach_bound(robot: RobotModel) -> ReachBound:
    """Return a bound on where the tool centre point can be.

    From one joint's origin to the next one's it is as far wherever turning joints are; a sliding
    joint's is farthest at one end of its range, as distances are convex along a line.

    Args:
        robot: The arm.
    """
    limits = robot.limits
    ends = np.stack([limits.lower_position, limits.upper_position])
    ends = np.where(robot.revolute, 0.0, ends)
    tool = robot.link_body[robot.tool_frame]
    chain = [body for body in range(1, robot.body_count) if robot.carries[tool, body - 1]]
    if not np.isfinite(ends).all() or not chain:
        return ReachBound(np.zeros(3), np.inf)
    origins = robot.body_poses(ends)[1][:, chain]
    points = np.concatenate([origins, robot.tool_position(ends)[:, None]], axis=1)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=0)
    center = origins[:, 0].mean(axis=0)
    travel = np.linalg.norm(origins[:, 0] - center, axis=1).max()
    return ReachBound(center, float(lengths.sum() + travel))
