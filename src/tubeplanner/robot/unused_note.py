"""A sentence on what a URDF says of the planned joints and planning does not use."""

import numpy as np

from tubeplanner.robot.robot_model import RobotModel

# The problem may give these itself; then it does not matter what the URDF says.
_LIMITS = ("acceleration", "jerk")


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
    limits = [quantity for quantity in _LIMITS if any(what.endswith(quantity) for what in joints)]
    remedy = "".join(f"; to keep it, give robot.limits.{quantity}" for quantity in limits)
    return f"the URDF says, and nothing here uses: {'; '.join(listed)}{remedy}"


def _is_given(robot: RobotModel, column: int, what: str) -> bool:
    """Return whether the problem itself limits a quantity of a joint."""
    quantity = next((name for name in _LIMITS if what.endswith(name)), None)
    return quantity is not None and bool(np.isfinite(getattr(robot.limits, quantity)[column]))


def _of(robot: RobotModel, value: str, names: list[str]) -> str:
    return f"{value} ({'every joint' if len(names) == robot.joint_count else ', '.join(names)})"
