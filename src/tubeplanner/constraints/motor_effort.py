"""What the motors of an arm give along a trajectory, friction included."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.directed_stretches import STILL_SHARE, directed_stretches
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples


def motor_effort(
    robot: RobotModel, trajectory: JointTrajectory, samples: TrajectorySamples
) -> FloatArray:
    """Return the efforts of the motors, shape (N, n) [N m or N].

    Args:
        robot: The arm.
        trajectory: Of its joints, in their order.
        samples: Of the trajectory.
    """
    smooth = robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
    return smooth + coulomb_effort(robot, trajectory, samples)


def coulomb_effort(
    robot: RobotModel, trajectory: JointTrajectory, samples: TrajectorySamples
) -> FloatArray:
    """Return what Coulomb friction takes of that, likewise.

    Where a joint reverses, for the direction that it takes; at the goal, for that of its approach.
    """
    velocity = samples.velocity
    if not robot.motors.has_coulomb_friction:
        return np.zeros_like(velocity)
    starts, widths = trajectory.breakpoints, trajectory.widths
    piece = np.searchsorted(starts[1:-1], samples.time, side="right")
    share = (samples.time - starts[piece]) / widths[piece]
    beside = directed_stretches(trajectory).at(piece, share)
    moves = abs(velocity) > STILL_SHARE * abs(velocity).max()
    return robot.motors.coulomb_effort(np.where(moves, velocity, beside))
