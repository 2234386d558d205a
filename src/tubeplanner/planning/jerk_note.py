"""What a trajectory's jerk is, where nothing limits it."""

import numpy as np

from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


def largest_jerk(
    robot: RobotModel, trajectory: JointTrajectory, *, unlimited: bool = False
) -> tuple[float, str]:
    """Return a trajectory's largest jerk, and in words, with its joint.

    Args:
        robot: The arm.
        trajectory: A cubic of its joints, in their order.
        unlimited: Of joints alone whose jerk and effort rate nothing limits.
    """
    peak = abs(trajectory.derivative_coefficients(3)).max(axis=(0, 1))
    if unlimited:
        limit = np.minimum(robot.limits.jerk, robot.limits.effort_rate)
        peak = np.where(np.isfinite(limit), 0.0, peak)
    joint = int(peak.argmax())
    unit = "rad/s^3" if robot.revolute[joint] else "m/s^3"
    return float(peak[joint]), f"{peak[joint]:.2g} {unit} ('{robot.joint_names[joint]}')"


def jerk_note(robot: RobotModel, trajectory: JointTrajectory) -> tuple[str, ...]:
    """Return a note on the jerk of a shortest motion, where neither it nor effort rate is limited.

    Args:
        robot: The arm.
        trajectory: A cubic of its joints, in their order.
    """
    peak, words = largest_jerk(robot, trajectory, unlimited=True)
    if not peak > 0:
        return ()
    return (
        "without a jerk limit, the shortest motion's jerk grows with the square of the number of "
        f"knots ({len(trajectory.widths)}): here up to {words}",
    )
