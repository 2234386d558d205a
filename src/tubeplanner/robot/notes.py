"""Notes on a robot: unused URDF values, implausible friction."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError, shown
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.motors import URDF_FRICTION, urdf_friction

# ---- What friction takes of the effort limits: at full speed, where it is most.

_IMPLAUSIBLE = 1 / 3  # geared arms lose up to 27 % (UR10, identified)
_SAME = 1e-3  # relative


@dataclass(frozen=True)
class FrictionShare:
    """The most that friction takes of an effort limit.

    Attributes:
        share: Of the effort limit, at the velocity limit.
        joints: Names of the joints of which it takes so much; empty: of every joint.
    """

    share: float
    joints: tuple[str, ...]

    @property
    def is_implausible(self) -> bool:
        """Whether no gear loses as much."""
        return self.share > _IMPLAUSIBLE

    def __str__(self) -> str:
        whose = ", ".join(self.joints) or "every joint"
        percent = 100 * self.share
        figures = f"{percent:.0f}" if percent >= 10 else f"{percent:.2g}"
        return f"{figures} % of the effort limit ({whose})"


def friction_share(
    robot: RobotModel, viscous: FloatArray, coulomb: FloatArray
) -> FrictionShare | None:
    """Return the most that friction takes; None if there is none, or nothing that it could take.

    Args:
        robot: The arm, whose limits count.
        viscous: Viscous friction of its joints, shape (n,) [N m s/rad or N s/m].
        coulomb: Coulomb friction, likewise [N m or N].
    """
    limits = robot.limits
    is_bounded = np.isfinite(limits.velocity) & np.isfinite(limits.effort)
    velocity = np.where(is_bounded, limits.velocity, 0.0)
    shares = np.where(is_bounded, (viscous * velocity + coulomb) / limits.effort, 0.0)
    if not shares.any():
        return None
    is_worst = shares >= (1 - _SAME) * shares.max()
    worst = () if is_worst.all() else np.flatnonzero(is_worst)
    return FrictionShare(float(shares.max()), tuple(robot.joint_names[joint] for joint in worst))


# ---- A sentence on what a URDF says of the planned joints and planning does not use.

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


# ---- Notes on a robot: what its URDF says in vain, and what of its motors is hard to believe.

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
