"""What is known of the joints of an arm, limit by limit, and where each number comes from.

It never fails because a limit is missing: stand-ins below all that is given take its place, and
are shown as what they are, nothing.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.robot.followers import followers_of
from tubeplanner.robot.joint_limits import JointLimits, resolve_limits
from tubeplanner.robot.joint_motors import JointMotors, resolve_motors
from tubeplanner.robot.limit_layers import (
    LimitLayer,
    MergedLimits,
    chain_order,
    merged_limits,
    merged_motors,
)
from tubeplanner.robot.limit_overrides import LimitOverrides
from tubeplanner.robot.motor_overrides import CURVE
from tubeplanner.robot.urdf import UrdfDescription, UrdfJoint

NOWHERE, URDF = "none", "URDF"
LIMITS = ("position", "velocity", "effort", "acceleration", "jerk", "effort_rate")
_REQUIRED = ("velocity", "effort")
_STAND_IN_RANGE = {"prismatic": (-1.0, 1.0), "revolute": (-np.pi, np.pi)}
_STAND_IN_RATE = 1e9  # bounds the speed of a joint of which nothing else does


@dataclass(frozen=True)
class SourcedValue:
    """A number and where it comes from.

    Attributes:
        value: A number, or (lower, upper); None: there is none, or it is infinite.
        source: "URDF", "problem file", "preset NAME", "limits_file NAME", the joint that follows
            and bounds it, or "none"; with the factor of limits.scale.
    """

    value: Any
    source: str

    @property
    def is_missing(self) -> bool:
        """Whether nothing gives it."""
        return self.source == NOWHERE


@dataclass(frozen=True)
class JointInfo:
    """One planned joint.

    Attributes:
        name: Its name.
        type: As in the URDF.
        parent: The link that carries it.
        child: The link that it moves.
        limits: By quantity, those of `LIMITS`.
        motor: By quantity, what is given of the motor.
    """

    name: str
    type: str
    parent: str
    child: str
    limits: Mapping[str, SourcedValue]
    motor: Mapping[str, SourcedValue]


def joint_infos(
    description: UrdfDescription, group: Sequence[str], layers: Sequence[LimitLayer]
) -> tuple[tuple[JointInfo, ...], JointLimits]:
    """Return what is known of planned joints in chain order, and their limits with stand-ins.

    Args:
        description: The robot.
        group: Its planning group.
        layers: Limits and motors, the later ones above.

    Raises:
        RobotError: What is given is wrong, such as a joint that there is not.
    """
    standing = [_stand_ins(description, group), *layers]
    limits = resolve_limits(description, group, standing)
    merged = merged_limits(description, group, followers_of(description, group), standing)
    motors = _motors(description, group, layers)
    infos = []
    for name in chain_order(description, group):
        joint, column = description.joints[name], list(group).index(name)
        known = {
            quantity: _sourced(
                description, joint, quantity, _value(limits, quantity, column), merged
            )
            for quantity in LIMITS
        }
        infos.append(JointInfo(name, joint.type, joint.parent, joint.child, known, motors[name]))
    return tuple(infos), limits


def _stand_ins(description: UrdfDescription, group: Sequence[str]) -> LimitLayer:
    """Return limits for what a URDF lacks, to be put below all others."""
    joints = [description.joints[name] for name in group]
    lacking = {
        quantity: {j.name: np.inf for j in joints if not _is_usable(getattr(j, quantity))}
        for quantity in _REQUIRED
    }
    ranges = {joint.name: _STAND_IN_RANGE[joint.type] for joint in joints if not _has_range(joint)}
    rates = dict.fromkeys(group, _STAND_IN_RATE)
    overrides = LimitOverrides(lacking["effort"], lacking["velocity"], ranges, rates)
    return LimitLayer("stand-in ", overrides, source=NOWHERE)


def _is_usable(value: float | None) -> bool:
    return value is not None and 0 < value < np.inf


def _has_range(joint: UrdfJoint) -> bool:
    endless = not np.isfinite([joint.lower, joint.upper]).all()
    return joint.lower < joint.upper and not (joint.type == "prismatic" and endless)


def _value(limits: JointLimits, quantity: str, column: int) -> tuple[float, float] | float:
    if quantity == "position":
        return float(limits.lower_position[column]), float(limits.upper_position[column])
    return float(getattr(limits, quantity)[column])


def _sourced(
    description: UrdfDescription,
    joint: UrdfJoint,
    quantity: str,
    value: tuple[float, float] | float,
    merged: MergedLimits,
) -> SourcedValue:
    """Return a limit that holds with the source of it."""
    default = URDF if quantity in ("position", *_REQUIRED) else NOWHERE
    source = merged.sources[quantity].get(joint.name, default)
    factor = merged.scale.get(quantity, 1.0)
    own = merged.by_joint[quantity].get(joint.name)
    if own is None and default == URDF:
        own = (joint.lower, joint.upper) if quantity == "position" else getattr(joint, quantity)
    if isinstance(own, Sequence | Mapping) and quantity == "effort":
        source = f"{source}, most of a range"
    elif _is_tighter(value, own, factor):
        names = [n for n, rule in followers_of(description, [joint.name]).items()]
        return SourcedValue(value, f"follower {' or '.join(names)}")
    if source == NOWHERE or not np.isfinite(value).all():
        return SourcedValue(None, source)
    return SourcedValue(value, source if factor == 1.0 else f"{source} x {factor:g}")


def _is_tighter(value: tuple[float, float] | float, own: Any, factor: float) -> bool:
    """Return whether a limit that holds is tighter than the joint's own."""
    if own is None:
        return bool(np.isfinite(value).all())
    if isinstance(value, tuple):
        return bool(value[0] > own[0] or value[1] < own[1])
    return bool(value < float(own) * factor * (1 - 1e-12))


def _motors(
    description: UrdfDescription, group: Sequence[str], layers: Sequence[LimitLayer]
) -> dict[str, dict[str, SourcedValue]]:
    """Return what is given of the motors, by joint and quantity."""
    motors = resolve_motors(description, group, layers)
    merged = merged_motors(description, group, followers_of(description, group), layers)
    found: dict[str, dict[str, SourcedValue]] = {name: {} for name in group}
    for column, name in enumerate(group):
        for quantity, given in merged.sources.items():
            value = _motor_value(motors, quantity, column)
            if name in given:
                found[name][quantity] = SourcedValue(
                    value if np.isfinite(value).all() else None, given[name]
                )
            elif quantity not in CURVE and np.any(value):
                found[name][quantity] = SourcedValue(value, URDF)
    return found


def _motor_value(motors: JointMotors, quantity: str, column: int) -> tuple[float, float] | float:
    if quantity != "coulomb_friction":
        return float(getattr(motors, quantity)[column])
    backwards = float(motors.backwards_friction[column])
    forwards = float(motors.forwards_friction[column])
    return backwards if backwards == forwards else (backwards, forwards)
