"""Polynomials that enclose the joint efforts and their rates, for all t.

The terms of the effort law are listed once. Its values and the bounds on what lies between them are
sums over that list, so that no term can be in the one and not in the other.
"""

from collections.abc import Mapping

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.enclosure import Enclosure, Quantity, enclosed, enclosed_rate, total
from tubeplanner.verification.majorants import motor_majorant, rigid_body_majorant


def effort_terms(robot: RobotModel) -> Mapping[str, Quantity]:
    """Return the smooth terms of the effort law by name, c = n each [N m or N].

    Their values add up to `inverse_dynamics`: all that the motors give, but for Coulomb friction.
    """

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        moved = rigid_body_majorant(robot, joints, width)
        return moved + motor_majorant(robot, joints, width)

    return {"rigid bodies and motors": Quantity(2, robot.inverse_dynamics, majorant)}


def enclosed_efforts(
    robot: RobotModel, trajectory: JointTrajectory, tolerance: FloatArray
) -> Enclosure:
    """Return the joint efforts, c = n [N m or N].

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        tolerance: How large the errors may be, shape (n,) [N m or N].
    """
    return enclosed(trajectory, total(effort_terms(robot).values()), tolerance)


def enclosed_effort_rates(
    robot: RobotModel, trajectory: JointTrajectory, tolerance: FloatArray
) -> Enclosure:
    """Return how fast the joint efforts change inside the pieces, c = n [N m/s or N/s].

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        tolerance: How large the errors may be, shape (n,) [N m/s or N/s].
    """
    return enclosed_rate(trajectory, total(effort_terms(robot).values()), tolerance)
