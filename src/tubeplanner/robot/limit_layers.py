"""Layers of limits and motors from several sources; the last value holds, its source is kept."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.robot.overrides import (
    MOTOR_QUANTITIES,
    PER_JOINT,
    LimitOverrides,
    MotorOverrides,
    PointSpeed,
)
from tubeplanner.robot.urdf import Mimic, UrdfDescription
from tubeplanner.text import short_repr

# What joints bound that follow others.
_FOLLOWED = ("velocity", "position", "acceleration", "jerk")


@dataclass(frozen=True)
class LimitLayer:
    """Limits and motors from a file.

    Attributes:
        called: What messages write before "limits" and "motors", such as "preset fr3: ".
        limits: The limits.
        joint_count: Number of joints of the arms that they are for; None: any.
        skips_others: Whether joints that are not planned may be among them, which are left out.
        notes: What in the file was not used.
        motors: The motors.
        source: What `info` calls it, such as "preset fr3".
    """

    called: str
    limits: LimitOverrides
    joint_count: int | None = None
    skips_others: bool = False
    notes: tuple[str, ...] = ()
    motors: MotorOverrides = field(default_factory=MotorOverrides)
    source: str = "problem file"

    __repr__ = short_repr


@dataclass(frozen=True)
class MergedLimits:
    """What layers give together.

    Attributes:
        by_joint: Limits by quantity and joint name; quantities are those of `PER_JOINT`.
        sources: Of each of these, the layer that gave it.
        scale: Commissioning factors by quantity.
        tool_speed: Of the tool centre point [m/s], inf where there is no limit.
        point_speed: Limits on the speed of points of the arm.
        notes: What was not used.
    """

    by_joint: Mapping[str, Mapping[str, Any]]
    sources: Mapping[str, Mapping[str, str]]
    scale: Mapping[str, float]
    tool_speed: float
    point_speed: tuple[PointSpeed, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class MergedMotors:
    """What layers give together.

    Attributes:
        by_joint: Values by quantity and joint name; quantities are those of `MOTOR_QUANTITIES`.
        sources: Of each of these, the layer that gave it.
        friction_from_urdf: Whether the URDF's friction is taken where none is given.
        friction_uncertainty: By which share friction may be more or less than that.
    """

    by_joint: Mapping[str, Mapping[str, Any]]
    sources: Mapping[str, Mapping[str, str]]
    friction_from_urdf: bool
    friction_uncertainty: float


_Layer: TypeAlias = LimitOverrides | LimitLayer
GivenLimits: TypeAlias = _Layer | Sequence[_Layer]


def layers_of(given: GivenLimits) -> list[LimitLayer]:
    """Return limits as layers, the later ones above.

    Raises:
        RobotError: They are something else.
    """
    several: Sequence[Any] = given if isinstance(given, list | tuple) else [given]
    layers = []
    for one in several:
        if not isinstance(one, LimitOverrides | LimitLayer):
            raise RobotError(f"limits are {shown(one)}; give LimitOverrides or a LimitLayer")
        layers.append(one if isinstance(one, LimitLayer) else LimitLayer("robot.", one))
    return layers


def merged_limits(
    description: UrdfDescription,
    joint_names: Sequence[str],
    followers: Mapping[str, Mimic],
    layers: Sequence[LimitLayer],
) -> MergedLimits:
    """Return what layers give together.

    Args:
        description: The robot.
        joint_names: Its planning group.
        followers: The joints that follow one of these.
        layers: The later ones above.

    Raises:
        RobotError: A layer is for another number of joints, has another number of values, or names
            a joint or a link that there is not.
    """
    chain = chain_order(description, joint_names)
    by_joint: dict[str, dict[str, Any]] = {quantity: {} for quantity in PER_JOINT}
    sources: dict[str, dict[str, str]] = {quantity: {} for quantity in PER_JOINT}
    for layer in layers:
        _require_fitting(description, layer, chain)
        _require_some(layer, [*joint_names, *followers])
        for quantity, merged in by_joint.items():
            known = [*joint_names, *(followers if quantity in _FOLLOWED else ())]
            where = f"{layer.called}limits.{quantity}"
            values = layer.limits.by_name(quantity, chain, where)
            if not layer.skips_others:
                _require_known(where, values, known)
            merged |= values
            sources[quantity] |= dict.fromkeys(values, layer.source)
    above = [layer.limits for layer in layers][::-1]
    speeds = [limits.tool_speed for limits in above if limits.tool_speed is not None]
    points = [limits.point_speed for limits in above if limits.point_speed]
    return MergedLimits(
        by_joint,
        sources,
        merged_scale(layers),
        float(speeds[0]) if speeds else np.inf,
        tuple(points[0]) if points else (),
        tuple(note for layer in layers for note in layer.notes),
    )


def merged_motors(
    description: UrdfDescription,
    joint_names: Sequence[str],
    followers: Mapping[str, Mimic],
    layers: Sequence[LimitLayer],
) -> MergedMotors:
    """Return what layers give together; arguments as for `merged_limits`.

    Raises:
        RobotError: A layer has another number of values than there are joints, or names a joint
            that there is not, or that has no motor because it follows another.
    """
    chain = chain_order(description, joint_names)
    by_joint: dict[str, dict[str, Any]] = {quantity: {} for quantity in MOTOR_QUANTITIES}
    sources: dict[str, dict[str, str]] = {quantity: {} for quantity in MOTOR_QUANTITIES}
    for layer in layers:
        for quantity, merged in by_joint.items():
            where = f"{layer.called}motors.{quantity}"
            values = layer.motors.by_name(quantity, chain, where)
            _require_motors(where, values, followers)
            _require_known(where, values, joint_names)
            merged |= values
            sources[quantity] |= dict.fromkeys(values, layer.source)
    motors = [layer.motors for layer in layers][::-1]
    taken = [one.friction_from_urdf for one in motors if one.friction_from_urdf is not None]
    shares = [one.friction_uncertainty for one in motors if one.friction_uncertainty is not None]
    uncertainty = float(shares[0]) if shares else 0.0
    return MergedMotors(by_joint, sources, any(taken[:1]), uncertainty)


def merged_scale(layers: Sequence[LimitLayer]) -> dict[str, float]:
    """Return the commissioning factors that layers give together, by quantity."""
    return {name: factor for layer in layers for name, factor in layer.limits.scale.items()}


def chain_order(description: UrdfDescription, joint_names: Sequence[str]) -> list[str]:
    """Return joints in the order of the chain from the root."""
    return sorted(joint_names, key=lambda name: _depth(description, name))


def _depth(description: UrdfDescription, joint: str) -> int:
    """Return how many movable joints are on the chain from the root to a joint, itself included."""
    return len(description.chain(description.joints[joint].child))


def _require_fitting(description: UrdfDescription, layer: LimitLayer, chain: Sequence[str]) -> None:
    """Raise RobotError if a layer is for other arms, or names links that there are not."""
    if layer.joint_count not in (None, len(chain)):
        raise RobotError(
            f"{layer.called}limits and motors are for {layer.joint_count} joints; the planning "
            f"group has {len(chain)}: {', '.join(chain)}"
        )
    for point in layer.limits.point_speed:
        if point.link not in description.links:
            message = unknown_name("link", point.link, description.links)
            raise RobotError(f"{layer.called}limits.point_speed: {message}")


def _require_some(layer: LimitLayer, known: Sequence[str]) -> None:
    """Raise RobotError if a layer that may name other joints names no other than these."""
    maps = [getattr(layer.limits, quantity) for quantity in PER_JOINT] if layer.skips_others else []
    named = {name for given in maps if isinstance(given, Mapping) for name in given}
    if named and named.isdisjoint(known):
        raise RobotError(
            f"{layer.called}limits name no joint of the planning group, which has: "
            f"{', '.join(known)}; they name {', '.join(sorted(named))}"
        )


def _require_known(where: str, values: Mapping[str, Any], known: Sequence[str]) -> None:
    for name in values:
        if name not in known:
            raise RobotError(f"{where}: {unknown_name('joint', name, known)}")


def _require_motors(where: str, values: Mapping[str, Any], followers: Mapping[str, Mimic]) -> None:
    for name in values:
        if name in followers:
            master = followers[name].master
            raise RobotError(
                f"{where}: joint '{name}' follows '{master}' and has no motor of its own; give "
                f"what '{master}' feels of it, or leave it out"
            )
