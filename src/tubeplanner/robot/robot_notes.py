"""Notes on a robot: what its URDF says in vain, and what of its motors is hard to believe."""

import numpy as np

from tubeplanner.errors import shown
from tubeplanner.robot.friction_share import friction_share
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.robot.unused_note import unused_note

_MOST_NAMED = 8  # names under a prefix


def robot_notes(robot: RobotModel) -> tuple[str, ...]:
    """Return sentences for the user; none if all is well."""
    notes = (unused_note(robot), _friction_note(robot))
    return (*_prefix_notes(robot), *(note for note in notes if note is not None))


def _prefix_notes(robot: RobotModel) -> list[str]:
    """Return a sentence for each prefix that the URDF uses and does not declare."""
    return [
        f"the URDF does not declare the prefix '{prefix}'; it is read all the same, and nothing "
        f"here uses what stands under it: {_named_under(prefix, names)}"
        for prefix, names in robot.urdf.undeclared.items()
    ]


def _named_under(prefix: str, names: tuple[str, ...]) -> str:
    named = ", ".join(shown(f"{prefix}:{name}").strip("'") for name in names[:_MOST_NAMED])
    more = len(names) - _MOST_NAMED
    return f"{named} and {more} more" if more > 0 else named


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
