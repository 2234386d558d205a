"""The friction that a URDF states: <dynamics damping friction>."""

from collections.abc import Sequence

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError
from tubeplanner.robot.followers import followers_of
from tubeplanner.robot.urdf import UrdfDescription, UrdfJoint

# What the file calls them, as `unused_values` does, and the field of `robot.motors` that serves.
URDF_FRICTION = {
    "dynamics damping": "viscous_friction",
    "dynamics friction": "coulomb_friction",
}


def urdf_friction(
    description: UrdfDescription, joint_names: Sequence[str]
) -> tuple[FloatArray, FloatArray]:
    """Return the friction of joints and of what follows them, as felt at these joints.

    Args:
        description: The robot.
        joint_names: Its planning group.

    Returns:
        Viscous friction [N m s/rad or N s/m] and Coulomb friction [N m or N], shape (n,) each.

    Raises:
        RobotError: The file states what is no number, infinite or negative.
    """
    ratios = [(name, column, 1.0) for column, name in enumerate(joint_names)]
    ratios += [
        (name, list(joint_names).index(rule.master), abs(rule.multiplier))
        for name, rule in followers_of(description, joint_names).items()
    ]
    viscous, coulomb = np.zeros((2, len(joint_names)))
    for name, column, ratio in ratios:
        joint = description.joints[name]
        # A follower turns `ratio` times as fast, and its friction has that lever on its master.
        viscous[column] += ratio**2 * _stated(description, joint, "dynamics damping")
        coulomb[column] += ratio * _stated(description, joint, "dynamics friction")
    return viscous, coulomb


def _stated(description: UrdfDescription, joint: UrdfJoint, what: str) -> float:
    text = joint.unused.get(what, "0")
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0 <= value < np.inf:
        raise RobotError(
            f"{description.path}: joint '{joint.name}' has <{what}> {text}; it must be a number "
            f">= 0: mend it, or leave robot.motors.friction_from_urdf out and give "
            f"robot.motors.{URDF_FRICTION[what]}"
        )
    return value
