"""Polynomials that enclose the position and the orientation of the tool, for all t."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.enclosure import Enclosure, Quantity, enclosed, joint_bounds
from tubeplanner.verification.majorants import tool_majorant


@dataclass(frozen=True, eq=False)
class EnclosedPose:
    """Where the tool is and how it is turned, over the same I intervals.

    Attributes:
        tool: Position of the tool centre point, c = 3 [m].
        rotation: Its rotation matrix, row by row, c = 9; every column is off by at most the error.
        speed: No part of an interval is faster, shape (I,) [m/s].
        acceleration: Bound on the norm, shape (I,) [m/s^2].
        spin: Bound on the angular velocity, shape (I,) [rad/s].
        spin_rate: Bound on the angular acceleration, shape (I,) [rad/s^2].
    """

    tool: Enclosure
    rotation: Enclosure
    speed: FloatArray
    acceleration: FloatArray
    spin: FloatArray
    spin_rate: FloatArray


def enclosed_tool(robot: RobotModel, trajectory: JointTrajectory, tolerance: float) -> Enclosure:
    """Return the tool centre point's position, c = 3 [m].

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        tolerance: How large the error may be [m]: its norm, the same for all components.
    """

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        return np.stack([tool_majorant(robot, joints).position] * 3, axis=2)

    return enclosed(trajectory, Quantity(0, robot.tool_position, majorant), np.full(3, tolerance))


def enclosed_pose(
    robot: RobotModel, trajectory: JointTrajectory, tolerance: float, rotation_tolerance: float
) -> EnclosedPose:
    """Return position and orientation of the tool centre point.

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        tolerance: How large the position's error may be [m].
        rotation_tolerance: How large the error of a column of the rotation matrix may be.
    """

    def values(q: FloatArray) -> FloatArray:
        rotation, position = robot.tool_pose(q)
        return np.hstack([position, rotation.reshape(-1, 9)])

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        tool = tool_majorant(robot, joints)
        return np.stack([tool.position] * 3 + [tool.axis] * 9, axis=2)

    tolerances = np.repeat([tolerance, rotation_tolerance], [3, 9])
    pose = enclosed(trajectory, Quantity(0, values, majorant), tolerances)
    tool, rotation = (
        Enclosure(pose.start, pose.width, pose.coefficients[:, :, part], pose.error[:, part])
        for part in (slice(3), slice(3, 12))
    )
    piece = np.searchsorted(trajectory.breakpoints, pose.start, "right") - 1
    local = pose.start - trajectory.breakpoints[piece]
    rates = tool_majorant(robot, joint_bounds(trajectory, piece, local, pose.width, 3))
    return EnclosedPose(
        tool,
        rotation,
        speed=rates.position[1] / pose.width,
        acceleration=2 * rates.position[2] / pose.width**2,
        spin=rates.spin[0] / pose.width,
        spin_rate=rates.spin[1] / pose.width**2,
    )
