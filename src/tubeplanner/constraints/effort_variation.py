"""How much the motors' efforts swing during a motion."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_SAMPLES_PER_PIECE = 20


def effort_variation(robot: RobotModel, trajectory: JointTrajectory) -> FloatArray:
    """Return the total variation of each joint's effort: how far it moves up and down in all.

    From 20 samples per polynomial piece. What an effort needs for a start and an end counts too,
    but not the hold before and after.

    Args:
        robot: The arm.
        trajectory: Of its joints, in their order.

    Returns:
        In limits; of joints without a limit on the effort, in their largest efforts, shape (n,).
    """
    samples = trajectory.per_piece(_SAMPLES_PER_PIECE)
    effort = robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
    limit = robot.limits.effort
    largest = np.maximum(abs(effort).max(axis=0), np.finfo(float).tiny)
    nominal = np.where(np.isfinite(limit), limit, largest)
    variation: FloatArray = abs(np.diff(effort, axis=0)).sum(axis=0) / nominal
    return variation
