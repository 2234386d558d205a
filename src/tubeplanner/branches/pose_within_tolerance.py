"""Inverse kinematics of a tool position, its rotation anywhere within a tolerance.

Nonlinear least squares (scipy, trust region with bounds) of the tool's distance and of what its
rotation vector lacks of the tolerance. Where the arm is nearly stretched, it finds configurations
at the edge of the tolerance that inverse kinematics of the reference orientation does not lead to.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import PositionSolution
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.rotational_tube import RotationalTube
from tubeplanner.tube.rotations import inverse_right_jacobian

_ANGLE_WEIGHT = 0.3  # [m/rad]
_JUST_INSIDE = 0.999  # of the bounds
_MAX_EVALUATIONS = 100
_CONVERGED = 1e-10
_INSIDE = 1e-9  # [rad or m]: where a search may begin, from its bounds


def solve_within_tolerance(
    robot: RobotModel,
    target: FloatArray,
    tube: RotationalTube,
    rows: tuple[int, ...],
    seed: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> PositionSolution:
    """Move a configuration until the tool is at a position and turned within a tolerance.

    Args:
        robot: The arm.
        target: Tool position, shape (3,), base frame [m].
        tube: The rotation tolerance.
        rows: Its rows that hold there; their reference orientations are the same.
        seed: Where to start, shape (n,) [rad or m].
        lower: Lower joint bounds, shape (n,).
        upper: Upper joint bounds, shape (n,).

    Returns:
        The nearest; its rotation error is how far it is outside the tolerance.
    """
    from scipy.optimize import least_squares

    lacks = _Lacks(robot, target, tube, rows[0], _JUST_INSIDE * tube.bounds[list(rows)].min(axis=0))
    wide = (lower - 2 * _INSIDE, upper + 2 * _INSIDE)
    found = least_squares(
        lambda q: lacks.of(q)[0],
        np.clip(seed, lower - _INSIDE, upper + _INSIDE),
        lambda q: lacks.of(q)[1],
        bounds=wide,
        max_nfev=_MAX_EVALUATIONS,
        xtol=_CONVERGED,
        ftol=_CONVERGED**1.5,
        gtol=_CONVERGED,
    )
    q = np.clip(found.x, lower, upper)
    rotation, tool = robot.tool_pose(q[None])
    outside = max(-float(tube.margin(rotation, tool, row)[0]) for row in rows)
    return PositionSolution(q, float(np.linalg.norm(tool[0] - target)), max(outside, 0.0))


@dataclass(frozen=True, eq=False)
class _Lacks:
    """What a configuration lacks of a position and of bounds (4,) on its rotation vector."""

    robot: RobotModel
    target: FloatArray
    tube: RotationalTube
    row: int
    bounds: FloatArray

    def of(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return it for a configuration (n,), (9,) [m], and its derivative (9, n)."""
        rotation, tool, jacobian = (part[0] for part in self.robot.tool_pose_jacobian(q[None]))
        error = self.tube.error(rotation[None], tool[None], self.row)[0]
        turned = inverse_right_jacobian(error) @ rotation.T @ jacobian[3:]
        beyond = np.maximum(abs(error) - self.bounds[:3], 0.0) * np.sign(error)
        rows = [jacobian[:3], _ANGLE_WEIGHT * (beyond != 0)[:, None] * turned]
        angle = float(np.linalg.norm(error))
        out, out_rows = np.zeros(3), np.zeros_like(turned)
        if angle > self.bounds[3]:
            share, axis = self.bounds[3] / angle, error / angle
            out = (1 - share) * error
            out_rows = ((1 - share) * np.eye(3) + share * np.outer(axis, axis)) @ turned
        parts = [tool - self.target, _ANGLE_WEIGHT * beyond, _ANGLE_WEIGHT * out]
        return np.concatenate(parts), np.vstack([*rows, _ANGLE_WEIGHT * out_rows])
