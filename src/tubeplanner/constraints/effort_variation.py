"""How much the motors' efforts swing during a motion."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_SAMPLES_PER_PIECE = 20


def effort_variation(
    robot: RobotModel, trajectory: JointTrajectory, beside: JointTrajectory | None = None
) -> FloatArray:
    """Return the total variation of each joint's effort: how far it moves up and down in all.

    Coulomb friction is left out: no motion spares the joints its jumps where they reverse. From 20
    samples per polynomial piece. What an effort needs for a start and an end counts too, but not
    the hold before and after.

    Args:
        robot: The arm.
        trajectory: Of its joints, in their order.
        beside: The motion that it is compared with; None: itself.

    Returns:
        In limits; of joints without a limit on the effort, in their largest efforts of the motion
        that it is compared with, shape (n,).
    """
    effort = _efforts(robot, trajectory)
    most = abs(effort if beside is None else _efforts(robot, beside)).max(axis=0)
    limit = robot.limits.effort
    nominal = np.where(np.isfinite(limit), limit, np.maximum(most, np.finfo(float).tiny))
    variation: FloatArray = abs(np.diff(effort, axis=0)).sum(axis=0) / nominal
    return variation


def _efforts(robot: RobotModel, trajectory: JointTrajectory) -> FloatArray:
    samples = trajectory.per_piece(_SAMPLES_PER_PIECE)
    return robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
