"""A sentence on what a URDF says of the planned joints and planning does not use."""

import numpy as np

from tubeplanner.robot.robot_model import RobotModel

# What the problem may give itself, by what a URDF calls it; then the URDF's does not matter.
_FIELDS = {
    "acceleration": "acceleration",
    "jerk": "jerk",
    "deceleration_limit": "velocity_by_position",
    "velocity_offset": "velocity_by_position",
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
    remedy = "".join(f"; to keep it, give robot.limits.{field}" for field in fields)
    return f"the URDF says, and nothing here uses: {'; '.join(listed)}{remedy}"


def _field(what: str) -> str | None:
    """Return the field of `robot.limits` that serves instead of a URDF's value, if there is one."""
    return next((field for word, field in _FIELDS.items() if what.endswith(word)), None)


def _is_given(robot: RobotModel, column: int, what: str) -> bool:
    """Return whether the problem itself gives a limit of a joint."""
    field = _field(what)
    if field == "velocity_by_position":
        return any(law.joint == column for law in robot.limits.velocity_by_position)
    return field is not None and bool(np.isfinite(getattr(robot.limits, field)[column]))


def _of(robot: RobotModel, value: str, names: list[str]) -> str:
    return f"{value} ({'every joint' if len(names) == robot.joint_count else ', '.join(names)})"
