"""A sentence on what a URDF says of the planned joints and planning does not use."""

from collections.abc import Mapping

import numpy as np

from tubeplanner.errors import RobotError
from tubeplanner.robot.friction_share import FrictionShare, friction_share
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.robot.urdf_friction import URDF_FRICTION, urdf_friction

# What the problem may give itself, by what a URDF calls it; then the URDF's does not matter.
_FIELDS = {
    "acceleration": "robot.limits.acceleration",
    "jerk": "robot.limits.jerk",
    "deceleration_limit": "robot.limits.velocity_by_position",
    "velocity_offset": "robot.limits.velocity_by_position",
    **dict.fromkeys(URDF_FRICTION, "robot.motors.friction_from_urdf: true"),
}


def unused_note(robot: RobotModel) -> str | None:
    """Return a sentence that names unused values with their joints; None if there are none."""
    joints: dict[str, dict[str, list[str]]] = {}
    for column, name in enumerate(robot.joint_names):
        for what, value in robot.urdf.joints[name].unused.items():
            if not _is_given(robot, column, what):
                joints.setdefault(what, {}).setdefault(value, []).append(name)
    if not joints:
        return None
    listed = [
        f"<{what}> " + ", ".join(_of(robot, *pair) for pair in found.items())
        for what, found in joints.items()
    ]
    fields = dict.fromkeys(field for what in joints if (field := _field(what)) is not None)
    remedy = "".join(f"; to keep it, give {field}" for field in fields)
    return (
        f"the URDF says, and nothing here uses: {'; '.join(listed)}{_share(robot, joints)}{remedy}"
    )


def _share(robot: RobotModel, unused: Mapping[str, object]) -> str:
    """Return a clause on how much unused friction would take; empty if nothing is known of it."""
    most = _unused_friction(robot, unused)
    if most is None:
        return ""
    doubt = ", more than a third: rather a placeholder" if most.is_implausible else ""
    return f"; that friction would at full speed take {most}{doubt}"


def _unused_friction(robot: RobotModel, unused: Mapping[str, object]) -> FrictionShare | None:
    try:
        stated = urdf_friction(robot.urdf, robot.joint_names)
    except RobotError:  # it states what is no friction
        return None
    friction = {}
    for what, values in zip(URDF_FRICTION, stated, strict=True):
        given = [_is_given(robot, column, what) for column in range(robot.joint_count)]
        friction[what] = np.where(given, 0.0, values) if what in unused else np.zeros(len(values))
    return friction_share(robot, *friction.values())


def _field(what: str) -> str | None:
    """Return the field that serves instead of a URDF's value, if there is one."""
    return next((field for word, field in _FIELDS.items() if what.endswith(word)), None)


def _is_given(robot: RobotModel, column: int, what: str) -> bool:
    """Return whether the problem itself gives a value of a joint."""
    motors, limits = robot.motors, robot.limits
    if what == "dynamics damping":
        return bool(motors.viscous_friction[column])
    if what == "dynamics friction":
        return bool(motors.backwards_friction[column] or motors.forwards_friction[column])
    quantity = (_field(what) or "").rpartition(".")[2]
    if quantity == "velocity_by_position":
        return any(law.joint == column for law in limits.velocity_by_position)
    return bool(quantity) and bool(np.isfinite(getattr(limits, quantity)[column]))


def _of(robot: RobotModel, value: str, names: list[str]) -> str:
    return f"{value} ({'every joint' if len(names) == robot.joint_count else ', '.join(names)})"
