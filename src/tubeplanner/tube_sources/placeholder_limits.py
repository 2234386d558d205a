"""Limits that stand where a URDF has none, until the maker's replace them."""

from typing import Any, TypeAlias

import numpy as np

from tubeplanner.robot.robot_info import RobotInfo
from tubeplanner.robot.typical_configurations import typical_configurations

# By quantity and joint.
Placeholders: TypeAlias = dict[str, Any]

_VELOCITY = {"prismatic": 0.25}  # [m/s]
_TURNING_VELOCITY = 1.0  # [rad/s]
# Efforts are so many times what holds the arm still, and at least so much [N m or N].
_GRAVITY_TIMES, _LEAST_EFFORT = 2.5, 5.0


def placeholder_limits(info: RobotInfo) -> Placeholders:
    """Return limits for what a robot lacks; inf for every effort where masses are missing."""
    missing = {
        quantity: [joint for joint in info.joints if joint.limits[quantity].is_missing]
        for quantity in ("position", "velocity", "effort")
    }
    arm = info.arm
    column = {name: k for k, name in enumerate(arm.joint_names)}
    ranges = np.column_stack([arm.limits.lower_position, arm.limits.upper_position]).round(3)
    weightless = not all(inertia.mass > 0 for inertia in arm.inertias[1:])
    efforts = _efforts(info)
    given: dict[str, dict[str, Any]] = {
        "position": {j.name: ranges[column[j.name]].tolist() for j in missing["position"]},
        "velocity": {j.name: _VELOCITY.get(j.type, _TURNING_VELOCITY) for j in missing["velocity"]},
        "effort": {joint.name: efforts[joint.name] for joint in missing["effort"]},
    }
    if weightless:
        given["effort"] = {joint.name: np.inf for joint in info.joints}
    return {quantity: values for quantity, values in given.items() if values}


def _efforts(info: RobotInfo) -> dict[str, float]:
    """Return efforts that hold an arm in any typical configuration and move it, by joint."""
    held = abs(info.arm.gravity_effort(typical_configurations(info.arm))).max(axis=0)
    rough = np.maximum(_GRAVITY_TIMES * held, _LEAST_EFFORT)
    digits = 10.0 ** np.floor(np.log10(rough) - 1)
    rounded = (np.ceil(rough / digits) * digits).round(6)
    return dict(zip(info.arm.joint_names, rounded.tolist(), strict=True))
