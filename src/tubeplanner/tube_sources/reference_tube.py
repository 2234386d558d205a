"""A tube around reference points and the arm's configurations between them."""

from collections.abc import Sequence

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.tube import Tube

_POINT_DECIMALS, _RANGE_DECIMALS = 6, 4


def reference_tube(
    robot: RobotModel,
    points: FloatArray,
    segments: Sequence[FloatArray],
    band: float,
    radius: float,
) -> Tube:
    """Return the tube whose joint ranges hold the arm's path in each segment, plus a band.

    A joint that has one sign in all segments keeps it: signs distinguish the arm's configurations
    (Suh & Bishop 1988, section on the tube model).

    Args:
        robot: The arm.
        points: Reference points, shape (m+1, 3) [m].
        segments: Per segment, configurations, shape (P_k, n) [rad or m].
        band: Added to both sides of every range [rad or m].
        radius: Path tolerance of all segments [m].
    """
    limits = robot.limits
    every = np.vstack(segments)
    lower = np.where((every > 0).all(axis=0), np.maximum(limits.lower_position, 0), -np.inf)
    lower = np.maximum(lower, limits.lower_position)
    upper = np.where((every < 0).all(axis=0), np.minimum(limits.upper_position, 0), np.inf)
    upper = np.minimum(upper, limits.upper_position)
    scale = 10.0**_RANGE_DECIMALS
    signs = []
    for q in segments:
        low = np.maximum(np.floor((q.min(axis=0) - band) * scale) / scale, lower)
        high = np.minimum(np.ceil((q.max(axis=0) + band) * scale) / scale, upper)
        ranges = zip(low.tolist(), high.tolist(), strict=True)
        signs.append(dict(zip(robot.joint_names, ranges, strict=True)))
    return Tube(np.round(points, _POINT_DECIMALS), radius, joint_signs=signs)
