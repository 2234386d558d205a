"""JointLimits: limits of the planned joints, of the URDF, replaced and scaled by the problem."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import in_figures, is_number
from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.robot.limit_layers import GivenLimits, layers_of, merged_limits
from tubeplanner.robot.overrides import SCALABLE, EffortRange, PointSpeed, effort_range
from tubeplanner.robot.urdf import Mimic, UrdfDescription, UrdfJoint, followers_of
from tubeplanner.text import short_repr

_OPTIONAL = ("acceleration", "jerk")  # limits that a URDF need not have
_LAW_KEYS = ("deceleration", "offset", "lower", "upper")
# Decelerations that make sense [rad/s^2 or m/s^2].
_MIN_DECELERATION, _MAX_DECELERATION = 1e-6, 1e9

# Limits of the problem, by quantity and joint name.
_Overrides: TypeAlias = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class VelocityByPosition:
    """A velocity limit that falls towards each end of a joint's range, beside its limit v_max.

    v <= min(v_max, max(0, -offset + sqrt(2 deceleration max(0, upper - q)))) and
    -v <= min(v_max, max(0, -offset + sqrt(2 deceleration max(0, q - lower)))).

    Attributes:
        joint: Index of the joint in the group.
        deceleration: With which it could still stop at the end [rad/s^2 or m/s^2].
        offset: Subtracted from the velocity [rad/s or m/s].
        lower: End of the range backwards [rad or m].
        upper: End of the range forwards [rad or m].
    """

    joint: int
    deceleration: float
    offset: float
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of n joints, in group order; inf where there is none.

    Attributes:
        lower_position: Shape (n,) [rad or m].
        upper_position: Shape (n,) [rad or m].
        velocity: Shape (n,) [rad/s or m/s].
        effort: The largest at any position and in either direction, shape (n,) [N m or N].
        acceleration: Shape (n,) [rad/s^2 or m/s^2].
        jerk: Shape (n,) [rad/s^3 or m/s^3].
        effort_rate: Shape (n,) [N m/s or N/s].
        tool_speed: Of the tool centre point [m/s].
        velocity_by_position: Of the joints that have a law of this kind, in group order.
        point_speed: Limits on the speed of points of the arm.
        effort_ranges: Of the joints whose effort limit differs by position or by direction.
        notes: Parts of limit files that were not used.
        velocity_tolerance: Fraction by which the maker's controller lets joints pass their velocity
            limits, of a preset; None: not known.
        sources: Source of each limit that is not the URDF's, by quantity and joint name.
    """

    lower_position: FloatArray
    upper_position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    effort_rate: FloatArray
    tool_speed: float = np.inf
    velocity_by_position: tuple[VelocityByPosition, ...] = ()
    point_speed: tuple[PointSpeed, ...] = ()
    effort_ranges: tuple[EffortRange, ...] = ()
    notes: tuple[str, ...] = ()
    velocity_tolerance: float | None = None
    sources: Mapping[str, Mapping[str, str]] = field(default_factory=dict, repr=False)

    __repr__ = short_repr

    def unlimited(self, quantity: str) -> IntArray:
        """Return the joints without a limit in a quantity, such as "jerk": indices, shape (k,)."""
        return np.flatnonzero(~np.isfinite(getattr(self, quantity)))

    def effort_at(self, q: FloatArray, sign: float) -> FloatArray:
        """Return the effort limits at configurations q, both (..., n), forwards or not (-1)."""
        allowed = np.broadcast_to(self.effort, np.shape(q)).copy()
        for each in self.effort_ranges:
            allowed[..., each.joint] = each.allowed(q[..., each.joint], sign)
        return allowed

    def clip(self, q: FloatArray) -> FloatArray:
        """Return configurations (..., n), each value clipped to its position limits."""
        return np.clip(q, self.lower_position, self.upper_position)


def resolve_limits(
    description: UrdfDescription, joint_names: Sequence[str], limits: GivenLimits
) -> JointLimits:
    """Return the limits of the joints of a planning group: the URDF's, replaced by the problem's.

    Position, velocity, acceleration and jerk limits of a follower bound its master too, divided by
    the multiplier; limits that the URDF does not give do not. A follower has no motor: its effort
    limit is not read, its master's holds for the efforts of both.

    Raises:
        RobotError: A limit is missing, zero, negative or reversed and not replaced, a joint has no
            finite limit that bounds its speed, a follower leaves its master no range, or a layer
            names a joint that is neither in the group nor a follower, or an unknown link, or has
            not one value per joint.
    """
    followers = followers_of(description, joint_names)
    merged = merged_limits(description, joint_names, followers, layers_of(limits))
    effort_limits = merged.by_joint["effort"]
    effort_ranges = [
        effort_range(column, effort_limits[name])
        for column, name in enumerate(joint_names)
        if name in effort_limits and not is_number(effort_limits[name])
    ]
    largest = {joint_names[each.joint]: each.most for each in effort_ranges}
    overrides = {**merged.by_joint, "effort": {**effort_limits, **largest}}
    joints = [description.joints[name] for name in joint_names]
    positions = np.array([_position(description, joint, overrides) for joint in joints])
    values = {
        quantity: [_required(description, joint, quantity, overrides[quantity]) for joint in joints]
        for quantity in ("effort", "velocity", *_OPTIONAL)
    }
    effort_rates = overrides["effort_rate"]
    values["effort_rate"] = [effort_rates.get(name, np.inf) for name in joint_names]
    for name, rule in followers.items():
        column = list(joint_names).index(rule.master)
        follower = description.joints[name]
        _bound_by_follower(follower, rule, overrides, positions[column])
        for quantity in ("velocity", *_OPTIONAL):
            bound = overrides[quantity].get(name, getattr(follower, quantity))
            if name in overrides[quantity] or (bound is not None and 0 < bound < np.inf):
                bound /= abs(rule.multiplier)
                values[quantity][column] = min(values[quantity][column], bound)
    scaled = {
        quantity: read_only(np.array(row) * merged.scale.get(quantity, 1.0))
        for quantity, row in values.items()
    }
    _require_bounded_speed(joint_names, scaled)
    laws = overrides["velocity_by_position"]
    return JointLimits(
        read_only(positions[:, 0]),
        read_only(positions[:, 1]),
        scaled["velocity"],
        scaled["effort"],
        scaled["acceleration"],
        scaled["jerk"],
        scaled["effort_rate"],
        tool_speed=merged.tool_speed,
        velocity_by_position=tuple(
            velocity_by_position(
                f"robot.limits.velocity_by_position.{name}", column, laws[name], positions[column]
            )
            for column, name in enumerate(joint_names)
            if laws.get(name) is not None
        ),
        point_speed=merged.point_speed,
        effort_ranges=tuple(
            each.scaled(merged.scale.get("effort", 1.0))
            for each in effort_ranges
            if not each.is_constant
        ),
        notes=merged.notes,
        velocity_tolerance=merged.velocity_tolerance,
        sources=merged.sources,
    )


def _position(
    description: UrdfDescription, joint: UrdfJoint, overrides: _Overrides
) -> tuple[float, float]:
    lower, upper = overrides["position"].get(joint.name, (joint.lower, joint.upper))
    if joint.type == "prismatic" and not np.isfinite([lower, upper]).all():
        raise RobotError(
            f"{description.path}: joint '{joint.name}' slides without end, position limits "
            f"[{lower:g}, {upper:g}]; give finite ones in robot.limits.position"
        )
    if not lower < upper:
        is_replaced = joint.name in overrides["position"]
        source = "robot.limits.position" if is_replaced else str(description.path)
        raise RobotError(
            f"{source}: joint '{joint.name}' has position limits [{lower:g}, {upper:g}], an empty "
            "range; give them in robot.limits.position"
        )
    return lower, upper


def _required(
    description: UrdfDescription, joint: UrdfJoint, quantity: str, override: Mapping[str, float]
) -> float:
    """Return a limit of a joint, the URDF's unless the problem replaces it."""
    if joint.name in override:
        return override[joint.name]
    value: float | None = getattr(joint, quantity)
    if value is None and quantity in _OPTIONAL:
        return np.inf
    if value is None or not 0 < value < np.inf:
        stated = "none" if value is None else f"{value:g}"
        raise RobotError(
            f"{description.path}: joint '{joint.name}' has {quantity} limit {stated}; "
            f"give a positive one in robot.limits.{quantity}, or .inf if there is none"
        )
    return value


def _bound_by_follower(
    follower: UrdfJoint, rule: Mimic, overrides: _Overrides, bounds: FloatArray
) -> None:
    """Cut a master's position limits (2,) by the limits of a follower, in place."""
    lower, upper = overrides["position"].get(follower.name, (follower.lower, follower.upper))
    if lower == upper == 0.0:  # the URDF gives no limits
        lower, upper = -np.inf, np.inf
    ends = sorted((end - rule.offset) / rule.multiplier for end in (lower, upper))
    own = bounds.copy()
    bounds[:] = max(bounds[0], ends[0]), min(bounds[1], ends[1])
    where = f"joint '{follower.name}', which follows '{rule.master}'"
    if not lower <= upper or not bounds[0] < bounds[1]:
        raise RobotError(
            f"{where}, has position limits [{lower:g}, {upper:g}]; they leave its master, whose "
            f"own are [{own[0]:g}, {own[1]:g}], no range; give either in robot.limits.position"
        )
    if follower.type == "prismatic" and not np.isfinite(bounds).all():
        raise RobotError(
            f"{where}, slides without end; give finite limits in robot.limits.position"
        )


def _require_bounded_speed(joint_names: Sequence[str], limits: Mapping[str, FloatArray]) -> None:
    bounds = np.array([limits[quantity] for quantity in SCALABLE])
    for name, column in zip(joint_names, bounds.T, strict=True):
        if not np.isfinite(column).any():
            raise RobotError(
                f"joint '{name}' has no finite limit among effort, velocity and acceleration, so "
                "its speed is unbounded; give one in robot.limits"
            )


def velocity_by_position(
    where: str, joint: int, user_value: Any, range_: FloatArray
) -> VelocityByPosition:
    """Return the velocity law of a joint.

    Args:
        where: Label in messages.
        joint: Index of the joint in the group.
        user_value: A map with deceleration and offset, and lower and upper where they are not the
            position limits.
        range_: The joint's position limits, shape (2,) [rad or m].

    Raises:
        RobotError: A key is unknown or missing, a number is out of its bounds, or there is no
            finite lower and upper.
    """
    if not isinstance(user_value, Mapping):
        raise RobotError(f"{where} is {shown(user_value)}; give a map with {', '.join(_LAW_KEYS)}")
    for key in user_value:
        if key not in _LAW_KEYS:
            raise RobotError(f"{where}: {unknown_name('key', key, _LAW_KEYS)}")
    values: dict[str, Any] = dict(zip(("lower", "upper"), range_, strict=True))
    values |= {key: value for key, value in user_value.items() if value is not None}
    for key, least in (("deceleration", _MIN_DECELERATION), ("offset", 0.0)):
        value: Any = values.get(key)
        if not is_number(value) or not least <= value <= _MAX_DECELERATION:
            raise RobotError(
                f"{where}.{key} is {in_figures(value)}; give a number from {least:g} to "
                f"{_MAX_DECELERATION:g}"
            )
    lower, upper = values["lower"], values["upper"]
    if not all(is_number(end) and np.isfinite(end) for end in (lower, upper)) or lower >= upper:
        raise RobotError(
            f"{where} has lower {in_figures(lower)} and upper {in_figures(upper)}; give finite "
            "ones, lower below upper"
        )
    return VelocityByPosition(joint, **{key: float(values[key]) for key in _LAW_KEYS})
