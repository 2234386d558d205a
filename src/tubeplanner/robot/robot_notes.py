"""Notes on a robot: what its URDF says in vain, and what of its motors is hard to believe."""

import numpy as np

from tubeplanner.robot.friction_share import friction_share
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.robot.unused_note import unused_note


def robot_notes(robot: RobotModel) -> tuple[str, ...]:
    """Return sentences for the user; none if all is well."""
    notes = (unused_note(robot), _friction_note(robot))
    return tuple(note for note in notes if note is not None)


def _friction_note(robot: RobotModel) -> str | None:
    motors = robot.motors
    coulomb = np.maximum(motors.backwards_friction, motors.forwards_friction)
    most = friction_share(robot, motors.viscous_friction, coulomb)
    if most is None or not most.is_implausible:
        return None
    return (
        f"at full speed friction takes {most}, more than a third: implausible for a geared arm; "
        "have it identified, or leave it out of robot.motors"
    )
