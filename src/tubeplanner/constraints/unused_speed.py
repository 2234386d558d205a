"""How much of the speed that the limits allow a trajectory does not use."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.time_scaling import scaling_factor
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_SAMPLES = 2000


def unused_speed(robot: RobotModel, trajectory: JointTrajectory) -> float:
    """Return the mean over time of 1 - 1/b(t), from 0 to 1.

    b(t) is how many times faster the limits, jerk included, would let the trajectory run at that
    instant (Suh & Bishop 1988, property 2). Where it is 1, some limit is fully used; the fastest
    trajectory of a tube uses one nearly everywhere.

    Args:
        robot: The arm.
        trajectory: Within its limits.
    """
    time = (np.arange(_SAMPLES) + 0.5) * trajectory.duration / _SAMPLES
    at = trajectory.at(time)
    factor = scaling_factor(robot, at.position, at.velocity, at.acceleration).min(axis=1)
    factor = np.minimum(factor, _jerk_factor(robot, trajectory, time))
    with np.errstate(divide="ignore"):
        return float(np.mean(1 - 1 / np.maximum(factor, 1.0)))


def _jerk_factor(robot: RobotModel, trajectory: JointTrajectory, time: FloatArray) -> FloatArray:
    """Return what limits of jerk allow at times (N,), shape (N,)."""
    limited = np.isfinite(robot.limits.jerk)
    if not limited.any():
        return np.full(len(time), np.inf)
    used = abs(trajectory.jerk(time)[:, limited]) / robot.limits.jerk[limited]
    with np.errstate(divide="ignore"):
        factor: FloatArray = used.max(axis=1) ** (-1 / 3)
    return factor
