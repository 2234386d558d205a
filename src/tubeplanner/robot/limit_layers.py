"""Limits from several places, one above the other: where two give the same, the later one holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.robot.limit_overrides import PER_JOINT, LimitOverrides
from tubeplanner.robot.point_speed import PointSpeed
from tubeplanner.robot.urdf import Mimic, UrdfDescription

# What joints bound that follow others.
_FOLLOWED = ("velocity", "position", "acceleration", "jerk")


@dataclass(frozen=True)
class LimitLayer:
    """Limits from a file.

    Attributes:
        called: What messages call the limits.
        limits: The limits.
        joint_count: Number of joints of the arms that they are for; None: any.
        skips_others: Whether joints that are not planned may be among them, which are left out.
        notes: What in the file was not used.
    """

    called: str
    limits: LimitOverrides
    joint_count: int | None = None
    skips_others: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class MergedLimits:
    """What layers give together.

    Attributes:
        by_joint: Limits by quantity and joint name; quantities are those of `PER_JOINT`.
        scale: Commissioning factors by quantity.
        tool_speed: Of the tool centre point [m/s], inf where there is no limit.
        point_speed: Limits on the speed of points of the arm.
        notes: What was not used.
    """

    by_joint: Mapping[str, Mapping[str, Any]]
    scale: Mapping[str, float]
    tool_speed: float
    point_speed: tuple[PointSpeed, ...]
    notes: tuple[str, ...]


_Layer: TypeAlias = LimitOverrides | LimitLayer
GivenLimits: TypeAlias = _Layer | Sequence[_Layer]


def layers_of(given: GivenLimits) -> list[LimitLayer]:
    """Return limits as layers, the later ones above.

    Raises:
        RobotError: They are something else.
    """
    several = [given] if isinstance(given, LimitOverrides | LimitLayer) else given
    layers = []
    for one in several:
        if not isinstance(one, LimitOverrides | LimitLayer):
            raise RobotError(f"limits are {shown(one)}; give LimitOverrides or a LimitLayer")
        layers.append(one if isinstance(one, LimitLayer) else LimitLayer("robot.limits", one))
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
    chain = sorted(joint_names, key=lambda name: _depth(description, name))
    by_joint: dict[str, dict[str, Any]] = {quantity: {} for quantity in PER_JOINT}
    for layer in layers:
        _require_fitting(description, layer, chain)
        _require_some(layer, [*joint_names, *followers])
        for quantity, merged in by_joint.items():
            known = [*joint_names, *(followers if quantity in _FOLLOWED else ())]
            merged |= _of_joints(layer, quantity, chain, known)
    above = [layer.limits for layer in layers][::-1]
    speeds = [limits.tool_speed for limits in above if limits.tool_speed is not None]
    points = [limits.point_speed for limits in above if limits.point_speed]
    return MergedLimits(
        by_joint,
        {name: factor for layer in layers for name, factor in layer.limits.scale.items()},
        float(speeds[0]) if speeds else np.inf,
        tuple(points[0]) if points else (),
        tuple(note for layer in layers for note in layer.notes),
    )


def _depth(description: UrdfDescription, joint: str) -> int:
    """Return how many movable joints are on the chain from the root to a joint, itself included."""
    return len(description.chain(description.joints[joint].child))


def _require_fitting(description: UrdfDescription, layer: LimitLayer, chain: Sequence[str]) -> None:
    """Raise RobotError if a layer is for other arms, or names links that there are not."""
    if layer.joint_count not in (None, len(chain)):
        raise RobotError(
            f"{layer.called} are for {layer.joint_count} joints; the planning group has "
            f"{len(chain)}: {', '.join(chain)}"
        )
    for point in layer.limits.point_speed:
        if point.link not in description.links:
            message = unknown_name("link", point.link, description.links)
            raise RobotError(f"{layer.called}.point_speed: {message}")


def _require_some(layer: LimitLayer, known: Sequence[str]) -> None:
    """Raise RobotError if a layer that may name other joints names no other than these."""
    maps = [getattr(layer.limits, quantity) for quantity in PER_JOINT] if layer.skips_others else []
    named = {name for given in maps if isinstance(given, Mapping) for name in given}
    if named and named.isdisjoint(known):
        raise RobotError(
            f"{layer.called} name no joint of the planning group, which has: {', '.join(known)}; "
            f"they name {', '.join(sorted(named))}"
        )


def _of_joints(
    layer: LimitLayer, quantity: str, chain: Sequence[str], known: Sequence[str]
) -> Mapping[str, Any]:
    """Return the limits that a layer gives on one quantity, by joint name."""
    where = f"{layer.called}.{quantity}"
    given = layer.limits.by_name(quantity, chain, where)
    for name in given:
        if name not in known and not layer.skips_others:
            raise RobotError(f"{where}: {unknown_name('joint', name, known)}")
    return given
