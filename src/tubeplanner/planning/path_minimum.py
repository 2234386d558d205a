"""How fast the path of a motion could be run by motors that switch at once: bang-bang control.

Solved by TOPP-RA (Pham & Pham, "A new approach to time-optimal path parameterization based on
reachability analysis", IEEE T-RO 34(3), 2018); first by Bobrow et al. and Shin & McKay (1985).
"""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.motion.trajectory import JointTrajectory
from tubeplanner.robot.robot_model import RobotModel

_GRID_POINTS = 1600
# Points of the path nearer to each other than this share of its length are one: rounding errors
# between them would look like curvature.
_APART = 1e-6
# A limit that is not given: so many times what the motion uses.
_AMPLE, _LOOKS_PER_PIECE = 1e3, 20


def path_minimum(robot: RobotModel, trajectory: JointTrajectory) -> float | None:
    """Return the least time [s] in which the path of a motion can be run, from rest to rest.

    Under the limits of velocity, acceleration and effort; jerk, and so smoothness, is not asked
    for. Judged at 1,600 points of the path: good to about 0.1 %.

    Args:
        robot: The arm.
        trajectory: Whose path is meant, in the robot's group order.

    Returns:
        The time, or None if the solver finds none.
    """
    import toppra  # takes a second
    from toppra import algorithm, constraint

    toppra.setup_logging("ERROR")
    way, q = _by_length(trajectory)
    path = toppra.SplineInterpolator(way, q)
    limits, used = robot.limits, trajectory.per_piece(_LOOKS_PER_PIECE)
    tau = robot.inverse_dynamics(used.position, used.velocity, used.acceleration)
    effort = _finite(limits.effort, tau)
    constraints = [
        constraint.JointVelocityConstraint(_finite(limits.velocity, used.velocity)),
        constraint.JointAccelerationConstraint(_finite(limits.acceleration, used.acceleration)),
        constraint.JointTorqueConstraint(
            lambda q, v, a: robot.inverse_dynamics(q[None], v[None], a[None])[0],
            np.column_stack([-effort, effort]),
            np.zeros(robot.joint_count),
        ),
    ]
    solver = algorithm.TOPPRA(constraints, path, gridpoints=way, solver_wrapper="seidel")
    _, speed, _ = solver.compute_parameterization(0.0, 0.0)
    if speed is None or not np.isfinite(speed).all():
        return None
    # At constant acceleration between two points, the mean speed is the mean of both.
    return float((2 * np.diff(way) / (speed[1:] + speed[:-1])).sum())


def _by_length(trajectory: JointTrajectory) -> tuple[FloatArray, FloatArray]:
    """Return the way to points of the path in joint space, from 0 to 1, and the points.

    Equal times apart, so that they are close together wherever the motion rests: there the path
    begins, ends, or has a corner.
    """
    q = trajectory.position(np.linspace(0, trajectory.duration, _GRID_POINTS))
    steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    _, apart = np.unique(np.floor(way / _APART), return_index=True)
    return way[apart], q[apart]


def _finite(limit: FloatArray, used: FloatArray) -> FloatArray:
    """Return limits (n,), those that are not given being ample for what is used, (N, n)."""
    most = np.maximum(abs(used).max(axis=0), 1e-6)
    return np.where(np.isfinite(limit), limit, _AMPLE * most)
