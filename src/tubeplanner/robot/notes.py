"""Notes on a robot: unused parts of its files, limits by direction, implausible friction."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError, shown
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import URDF_FRICTION, urdf_friction

_MAX_NAMES = 8  # under a prefix
_IMPLAUSIBLE = 1 / 3  # geared arms lose up to 27 % (UR10, identified)
_EQUAL = 1e-3  # relative: joints of equal fractions are named together
# Fields of the problem by the URDF's names; a value given there makes the URDF's irrelevant.
_FIELDS = {
    "acceleration": "robot.limits.acceleration",
    "deceleration": "robot.limits.acceleration",
    "jerk": "robot.limits.jerk",
    "deceleration_limit": "robot.limits.velocity_by_position",
    "velocity_offset": "robot.limits.velocity_by_position",
    "limit lower": "robot.limits.position",
    "limit upper": "robot.limits.position",
    **dict.fromkeys(URDF_FRICTION, "robot.motors.friction_from_urdf: true"),
}


def robot_notes(robot: RobotModel) -> tuple[str, ...]:
    """Return sentences for the user; none if all is well."""
    prefix_notes = []
    for prefix, names in robot.urdf.undeclared.items():
        named = ", ".join(shown(f"{prefix}:{name}").strip("'") for name in names[:_MAX_NAMES])
        more = len(names) - _MAX_NAMES
        prefix_notes.append(
            f"the URDF does not declare the prefix '{prefix}'; it is read all the same, and "
            f"nothing here uses what stands under it: {named}"
            + (f" and {more} more" if more > 0 else "")
        )
    kinds = (_passive_note, unused_note, _acceleration_note, _friction_note)
    notes = [kind(robot) for kind in kinds]
    read = (*prefix_notes, *robot.urdf.notes, *robot.limits.notes)
    return (*read, *(note for note in notes if note is not None))


def _passive_note(robot: RobotModel) -> str | None:
    """Return a sentence on planned joints that the SRDF calls passive."""
    srdf = robot.urdf.srdf
    passive = [] if srdf is None else [j for j in srdf.passive_joints if j in robot.joint_names]
    if not passive:
        return None
    return (
        f"the SRDF calls {', '.join(passive)} passive, so without a motor; planned all the same "
        "unless robot.joints names the others alone"
    )


def _acceleration_note(robot: RobotModel) -> str | None:
    """Return a sentence on joints that the URDF lets slow down otherwise than speed up."""
    joints: dict[tuple[float, ...], list[str]] = {}
    for name, limit in zip(robot.joint_names, robot.limits.acceleration, strict=True):
        both = robot.urdf.joints[name].accelerations
        if both and limit <= min(both):  # else the problem has its own
            joints.setdefault(both, []).append(name)
    if not joints:
        return None
    listed = "; ".join(
        f"acceleration {up:g}, deceleration {down:g} ({_whose(names, robot)})"
        for (up, down), names in joints.items()
    )
    return (
        f"the URDF limits {listed}; a limit holds in both directions here, so the smaller counts; "
        "robot.limits.acceleration replaces it"
    )


def _friction_note(robot: RobotModel) -> str | None:
    motors = robot.motors
    coulomb = np.maximum(motors.backwards_friction, motors.forwards_friction)
    largest = friction_share(robot, motors.viscous_friction, coulomb)
    if largest is None or not largest.is_implausible:
        return None
    return (
        f"at full speed friction takes {largest}, more than a third: implausible for a geared arm; "
        "have it identified, or leave it out of robot.motors"
    )


# ---- Values of the planned joints in the URDF that planning does not use.


def unused_note(robot: RobotModel) -> str | None:
    """Return a sentence that names unused values with their joints; None if there are none."""
    joints: dict[str, dict[str, list[str]]] = {}
    for column, name in enumerate(robot.joint_names):
        for key, value in robot.urdf.joints[name].unused.items():
            if not _is_given(robot, column, key):
                joints.setdefault(key, {}).setdefault(value, []).append(name)
    if not joints:
        return None
    listed = []
    for key, by_value in joints.items():
        whose = [f"{value} ({_whose(names, robot)})" for value, names in by_value.items()]
        listed.append(f"<{key}> {', '.join(whose)}")
    friction = ""
    largest = _unused_friction(robot, joints)
    if largest is not None:
        doubt = ", more than a third: rather a placeholder" if largest.is_implausible else ""
        friction = f"; that friction would at full speed take {largest}{doubt}"
    fields = dict.fromkeys(field for key in joints if (field := _field(key)) is not None)
    remedy = "".join(f"; to keep it, give {field}" for field in fields)
    return f"the URDF says, and nothing here uses: {'; '.join(listed)}{friction}{remedy}"


def _whose(names: Sequence[str], robot: RobotModel) -> str:
    return "every joint" if len(names) == robot.joint_count else ", ".join(names)


def _is_given(robot: RobotModel, column: int, key: str) -> bool:
    """Return True if the problem has its own value of a joint."""
    motors, limits = robot.motors, robot.limits
    if key == "dynamics damping":
        return bool(motors.viscous_friction[column])
    if key == "dynamics friction":
        return bool(motors.backwards_friction[column] or motors.forwards_friction[column])
    quantity = (_field(key) or "").rpartition(".")[2]
    if quantity == "velocity_by_position":
        return any(law.joint == column for law in limits.velocity_by_position)
    if quantity == "position":
        return bool(np.isfinite(limits.lower_position[column]))
    return bool(quantity) and bool(np.isfinite(getattr(limits, quantity)[column]))


def _field(key: str) -> str | None:
    return next((field for word, field in _FIELDS.items() if key.endswith(word)), None)


def _unused_friction(robot: RobotModel, unused: Mapping[str, object]) -> "FrictionShare | None":
    """Return the largest fraction of an effort limit that the unused friction would take."""
    try:
        urdf_values = urdf_friction(robot.urdf, robot.joint_names)
    except RobotError:  # the URDF's values are no friction
        return None
    friction = {}
    for key, values in zip(URDF_FRICTION, urdf_values, strict=True):
        is_given = [_is_given(robot, column, key) for column in range(robot.joint_count)]
        friction[key] = np.where(is_given, 0.0, values) if key in unused else np.zeros(len(values))
    return friction_share(robot, *friction.values())


# ---- The fraction of the effort limits that friction takes at the velocity limits.


@dataclass(frozen=True)
class FrictionShare:
    """The largest fraction of an effort limit that friction takes.

    Attributes:
        share: Of the effort limit, at the velocity limit.
        joints: Names of the joints with this fraction; empty: every joint.
    """

    share: float
    joints: tuple[str, ...]

    @property
    def is_implausible(self) -> bool:
        """True if no geared arm loses as much."""
        return self.share > _IMPLAUSIBLE

    def __str__(self) -> str:
        whose = ", ".join(self.joints) or "every joint"
        percent = 100 * self.share
        figures = f"{percent:.0f}" if percent >= 10 else f"{percent:.2g}"
        return f"{figures} % of the effort limit ({whose})"


def friction_share(
    robot: RobotModel, viscous: FloatArray, coulomb: FloatArray
) -> FrictionShare | None:
    """Return the largest fraction of an effort limit that friction takes.

    Args:
        robot: The arm, whose limits count.
        viscous: Viscous friction of its joints, shape (n,) [N m s/rad or N s/m].
        coulomb: Coulomb friction of its joints, shape (n,) [N m or N].

    Returns:
        None without friction, or if no joint has finite limits of velocity and effort.
    """
    limits = robot.limits
    is_bounded = np.isfinite(limits.velocity) & np.isfinite(limits.effort)
    velocity = np.where(is_bounded, limits.velocity, 0.0)
    fractions = np.where(is_bounded, (viscous * velocity + coulomb) / limits.effort, 0.0)
    if not fractions.any():
        return None
    is_largest = fractions >= (1 - _EQUAL) * fractions.max()
    largest = () if is_largest.all() else np.flatnonzero(is_largest)
    names = tuple(robot.joint_names[joint] for joint in largest)
    return FrictionShare(float(fractions.max()), names)
