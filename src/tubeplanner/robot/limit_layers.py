"""Layers of limits and motors from several sources; the last value holds, its source is kept.

Later layers in a sequence are above: their values replace values of earlier layers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.errors import FormerName, RobotError, shown, unknown_name
from tubeplanner.robot.overrides import (
    MOTOR_QUANTITIES,
    PER_JOINT,
    LimitOverrides,
    MotorOverrides,
    PointSpeed,
)
from tubeplanner.robot.urdf import Mimic, UrdfDescription
from tubeplanner.text import short_repr

# Quantities whose limits of a follower bound its master.
_FOLLOWED = ("velocity", "position", "acceleration", "jerk")


@dataclass(frozen=True)
class LimitLayer:
    """Limits and motors from a file.

    Attributes:
        label: Label in messages before "limits" and "motors", such as "preset fr3: ".
        limits: The limits.
        joint_count: Number of joints of the arms that the layer is for; None: any.
        skips_others: True if limits of joints that are not planned are allowed, and ignored.
        notes: Parts of the file that were not used.
        motors: The motors.
        source: Label in `info`, such as "preset fr3".
    """

    label: str
    limits: LimitOverrides
    joint_count: int | None = None
    skips_others: bool = False
    notes: tuple[str, ...] = ()
    motors: MotorOverrides = field(default_factory=MotorOverrides)
    source: str = "problem file"

    __repr__ = short_repr

    called = FormerName("label")


@dataclass(frozen=True)
class MergedLimits:
    """The limits of all layers.

    Attributes:
        by_joint: Limits by quantity (of `PER_JOINT`) and joint name.
        sources: The source of each limit, by quantity and joint name.
        scale: Commissioning factors by quantity.
        tool_speed: Of the tool centre point [m/s], inf where there is no limit.
        velocity_tolerance: As of `LimitOverrides`.
        point_speed: Limits on the speed of points of the arm.
        notes: Parts of files that were not used.
    """

    by_joint: Mapping[str, Mapping[str, Any]]
    sources: Mapping[str, Mapping[str, str]]
    scale: Mapping[str, float]
    tool_speed: float
    velocity_tolerance: float | None
    point_speed: tuple[PointSpeed, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class MergedMotors:
    """The motors of all layers.

    Attributes:
        by_joint: Values by quantity (of `MOTOR_QUANTITIES`) and joint name.
        sources: The source of each value, by quantity and joint name.
        friction_from_urdf: True if the URDF's friction holds where no layer has any.
        friction_uncertainty: Fraction by which friction may be more or less.
    """

    by_joint: Mapping[str, Mapping[str, Any]]
    sources: Mapping[str, Mapping[str, str]]
    friction_from_urdf: bool
    friction_uncertainty: float


_Layer: TypeAlias = LimitOverrides | LimitLayer
GivenLimits: TypeAlias = _Layer | Sequence[_Layer]


def layers_of(value: GivenLimits) -> list[LimitLayer]:
    """Return limits as a list of layers.

    Raises:
        RobotError: An entry is neither LimitOverrides nor a LimitLayer.
    """
    entries: Sequence[Any] = value if isinstance(value, list | tuple) else [value]
    layers = []
    for entry in entries:
        if not isinstance(entry, LimitOverrides | LimitLayer):
            raise RobotError(f"limits are {shown(entry)}; give LimitOverrides or a LimitLayer")
        layers.append(entry if isinstance(entry, LimitLayer) else LimitLayer("robot.", entry))
    return layers


def merged_limits(
    description: UrdfDescription,
    joint_names: Sequence[str],
    followers: Mapping[str, Mimic],
    layers: Sequence[LimitLayer],
) -> MergedLimits:
    """Merge the limits of layers.

    Args:
        description: The robot.
        joint_names: Its planning group.
        followers: The followers of the group's joints, by name.
        layers: The layers.

    Raises:
        RobotError: A layer is for another number of joints, has another number of values, or names
            an unknown joint or link.
    """
    chain = chain_order(description, joint_names)
    by_joint: dict[str, dict[str, Any]] = {quantity: {} for quantity in PER_JOINT}
    sources: dict[str, dict[str, str]] = {quantity: {} for quantity in PER_JOINT}
    for layer in layers:
        if layer.joint_count not in (None, len(chain)):
            raise RobotError(
                f"{layer.label}limits and motors are for {layer.joint_count} joints; the planning "
                f"group has {len(chain)}: {', '.join(chain)}"
            )
        for point in layer.limits.point_speed:
            if point.link not in description.links:
                message = unknown_name("link", point.link, description.links)
                raise RobotError(f"{layer.label}limits.point_speed: {message}")
        maps = [getattr(layer.limits, each) for each in PER_JOINT] if layer.skips_others else []
        named = {name for values in maps if isinstance(values, Mapping) for name in values}
        joints = [*joint_names, *followers]
        if named and named.isdisjoint(joints):
            raise RobotError(
                f"{layer.label}limits name no joint of the planning group, which has: "
                f"{', '.join(joints)}; they name {', '.join(sorted(named))}"
            )
        for quantity, merged in by_joint.items():
            where = f"{layer.label}limits.{quantity}"
            values = layer.limits.by_name(quantity, chain, where)
            if not layer.skips_others:
                extra = followers if quantity in _FOLLOWED else ()
                _require_known(where, values, [*joint_names, *extra])
            merged |= values
            sources[quantity] |= dict.fromkeys(values, layer.source)
    above = [layer.limits for layer in layers][::-1]
    speeds = [limits.tool_speed for limits in above if limits.tool_speed is not None]
    tolerances = [each.velocity_tolerance for each in above if each.velocity_tolerance is not None]
    points = [limits.point_speed for limits in above if limits.point_speed]
    return MergedLimits(
        by_joint,
        sources,
        merged_scale(layers),
        float(speeds[0]) if speeds else np.inf,
        float(tolerances[0]) if tolerances else None,
        tuple(points[0]) if points else (),
        tuple(note for layer in layers for note in layer.notes),
    )


def merged_motors(
    description: UrdfDescription,
    joint_names: Sequence[str],
    followers: Mapping[str, Mimic],
    layers: Sequence[LimitLayer],
) -> MergedMotors:
    """Merge the motors of layers; arguments as for `merged_limits`.

    Raises:
        RobotError: A layer has another number of values than there are joints, or names an unknown
            joint, or a follower, which has no motor.
    """
    chain = chain_order(description, joint_names)
    by_joint: dict[str, dict[str, Any]] = {quantity: {} for quantity in MOTOR_QUANTITIES}
    sources: dict[str, dict[str, str]] = {quantity: {} for quantity in MOTOR_QUANTITIES}
    for layer in layers:
        for quantity, merged in by_joint.items():
            where = f"{layer.label}motors.{quantity}"
            values = layer.motors.by_name(quantity, chain, where)
            for name in values:
                if name in followers:
                    master = followers[name].master
                    raise RobotError(
                        f"{where}: joint '{name}' follows '{master}' and has no motor of its own; "
                        f"give what '{master}' feels of it, or leave it out"
                    )
            _require_known(where, values, joint_names)
            merged |= values
            sources[quantity] |= dict.fromkeys(values, layer.source)
    above = [layer.motors for layer in layers][::-1]
    from_urdf = [m.friction_from_urdf for m in above if m.friction_from_urdf is not None]
    fractions = [m.friction_uncertainty for m in above if m.friction_uncertainty is not None]
    uncertainty = float(fractions[0]) if fractions else 0.0
    return MergedMotors(by_joint, sources, any(from_urdf[:1]), uncertainty)


def merged_scale(layers: Sequence[LimitLayer]) -> dict[str, float]:
    """Return the commissioning factors of layers, by quantity."""
    return {name: factor for layer in layers for name, factor in layer.limits.scale.items()}


def chain_order(description: UrdfDescription, joint_names: Sequence[str]) -> list[str]:
    """Return joints in chain order: by the number of movable joints from the root to each."""
    joints = description.joints
    return sorted(joint_names, key=lambda name: len(description.chain(joints[name].child)))


def _require_known(where: str, values: Mapping[str, Any], known: Sequence[str]) -> None:
    for name in values:
        if name not in known:
            raise RobotError(f"{where}: {unknown_name('joint', name, known)}")
