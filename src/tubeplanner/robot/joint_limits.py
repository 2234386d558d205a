"""JointLimits, resolved: position, velocity, acceleration, jerk, effort, effort rate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import in_figures, is_number
from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.robot.limit_layers import GivenLimits, layers_of, merged_limits
from tubeplanner.robot.overrides import SCALABLE, EffortRange, PointSpeed, effort_range
from tubeplanner.robot.urdf import Mimic, UrdfDescription, UrdfJoint, followers_of
from tubeplanner.text import short_repr

# ---- Limits on a joint's velocity that fall towards the ends of its range.

_KEYS = ("deceleration", "offset", "lower", "upper")
_LEAST, _MOST = 1e-6, 1e9  # decelerations that make sense [rad/s^2 or m/s^2]


@dataclass(frozen=True)
class VelocityByPosition:
    """How fast a joint may move towards each end of its range, beside its velocity limit v_max.

    v <= min(v_max, max(0, -offset + sqrt(2 deceleration max(0, upper - q)))) and
    -v <= min(v_max, max(0, -offset + sqrt(2 deceleration max(0, q - lower)))).

    Attributes:
        joint: Index of the joint in the group.
        deceleration: At which it could still stop [rad/s^2 or m/s^2].
        offset: Taken off the velocity [rad/s or m/s].
        lower: Where it would stop backwards [rad or m].
        upper: Where it would stop forwards [rad or m].
    """

    joint: int
    deceleration: float
    offset: float
    lower: float
    upper: float


def velocity_by_position(
    where: str, joint: int, given: Any, range_: FloatArray
) -> VelocityByPosition:
    """Return the law of one joint.

    Args:
        where: What messages call it.
        joint: Index of the joint in the group.
        given: A map with deceleration and offset, and lower and upper where they are not the
            position limits.
        range_: The joint's position limits, shape (2,) [rad or m].

    Raises:
        RobotError: A key is unknown or missing, a number is out of its bounds, or there is no
            finite lower and upper.
    """
    if not isinstance(given, Mapping):
        raise RobotError(f"{where} is {shown(given)}; give a map with {', '.join(_KEYS)}")
    for key in given:
        if key not in _KEYS:
            raise RobotError(f"{where}: {unknown_name('key', key, _KEYS)}")
    values: dict[str, Any] = dict(zip(("lower", "upper"), range_, strict=True))
    values |= {key: value for key, value in given.items() if value is not None}
    for key, least in (("deceleration", _LEAST), ("offset", 0.0)):
        value: Any = values.get(key)
        if not is_number(value) or not least <= value <= _MOST:
            raise RobotError(
                f"{where}.{key} is {in_figures(value)}; give a number from {least:g} to {_MOST:g}"
            )
    lower, upper = values["lower"], values["upper"]
    if not all(is_number(end) and np.isfinite(end) for end in (lower, upper)) or lower >= upper:
        raise RobotError(
            f"{where} has lower {in_figures(lower)} and upper {in_figures(upper)}; give finite "
            "ones, lower below upper"
        )
    return VelocityByPosition(joint, **{key: float(values[key]) for key in _KEYS})


# ---- Limits of the planned joints: those of the URDF, replaced and scaled by those of the problem.

# Limits that are given, by quantity and joint name.
_Given: TypeAlias = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of n joints, in group order; inf where there is none.

    Attributes:
        lower_position: Shape (n,) [rad or m].
        upper_position: Shape (n,) [rad or m].
        velocity: Shape (n,) [rad/s or m/s].
        effort: The most at any position and in any direction, shape (n,) [N m or N].
        acceleration: Shape (n,) [rad/s^2 or m/s^2].
        jerk: Shape (n,) [rad/s^3 or m/s^3].
        effort_rate: Shape (n,) [N m/s or N/s].
        tool_speed: Of the tool centre point [m/s].
        velocity_by_position: Of those joints that have such a limit, in group order.
        point_speed: Limits on the speed of points of the arm.
        effort_ranges: Of those joints that have not the same effort everywhere and both ways.
        notes: What in files of limits was not used.
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

    __repr__ = short_repr

    def unlimited(self, quantity: str) -> IntArray:
        """Return which joints nothing limits in a quantity, such as "jerk": int, shape (k,)."""
        return np.flatnonzero(~np.isfinite(getattr(self, quantity)))

    def effort_at(self, q: FloatArray, way: float) -> FloatArray:
        """Return the effort that motors have at configurations (..., n), forwards or not (-1)."""
        allowed = np.broadcast_to(self.effort, np.shape(q)).copy()
        for each in self.effort_ranges:
            allowed[..., each.joint] = each.allowed(q[..., each.joint], way)
        return allowed

    def clip(self, q: FloatArray) -> FloatArray:
        """Return configurations of shape (..., n) moved into the position limits."""
        return np.clip(q, self.lower_position, self.upper_position)


def resolve_limits(
    description: UrdfDescription, joint_names: Sequence[str], limits: GivenLimits
) -> JointLimits:
    """Return the limits of the joints of a planning group: the URDF's, and above them those given.

    Position, velocity, acceleration and jerk of joints that follow one of them bound it too,
    divided by their multipliers; limits that the URDF does not give do not. A follower has no
    motor: its effort limit is not asked, its master's holds for all they take together.

    Raises:
        RobotError: A limit is missing, zero, negative or reversed and not replaced, a joint has no
            finite limit that bounds its speed, a follower leaves it no position, or an override
            names a joint that is neither in the group nor follows one of it, a link that does not
            exist, or has not one value per joint.
    """
    followers = followers_of(description, joint_names)
    merged = merged_limits(description, joint_names, followers, layers_of(limits))
    efforts = _effort_ranges(joint_names, merged.by_joint["effort"])
    largest = {joint_names[one.joint]: one.most for one in efforts}
    given = {**merged.by_joint, "effort": {**merged.by_joint["effort"], **largest}}
    joints = [description.joints[name] for name in joint_names]
    positions = np.array([_position(description, joint, given) for joint in joints])
    values = {
        quantity: [_required(description, joint, quantity, given[quantity]) for joint in joints]
        for quantity in ("effort", "velocity")
    }
    for quantity in ("acceleration", "jerk", "effort_rate"):
        values[quantity] = [given[quantity].get(name, np.inf) for name in joint_names]
    for name, rule in followers.items():
        column = list(joint_names).index(rule.master)
        _bound_by_follower(description.joints[name], rule, given, positions[column])
        for quantity, bound in _rates_of(description.joints[name], given).items():
            values[quantity][column] = min(values[quantity][column], bound / abs(rule.multiplier))
    scaled = {
        quantity: read_only(np.array(row) * merged.scale.get(quantity, 1.0))
        for quantity, row in values.items()
    }
    _require_bounded_speed(joint_names, scaled)
    return JointLimits(
        read_only(positions[:, 0]),
        read_only(positions[:, 1]),
        scaled["velocity"],
        scaled["effort"],
        scaled["acceleration"],
        scaled["jerk"],
        scaled["effort_rate"],
        tool_speed=merged.tool_speed,
        velocity_by_position=_laws(joint_names, given["velocity_by_position"], positions),
        point_speed=merged.point_speed,
        effort_ranges=tuple(
            one.scaled(merged.scale.get("effort", 1.0)) for one in efforts if not one.is_constant
        ),
        notes=merged.notes,
    )


def _require_bounded_speed(joint_names: Sequence[str], limits: Mapping[str, FloatArray]) -> None:
    bounded = np.array([limits[quantity] for quantity in SCALABLE])
    for name, column in zip(joint_names, bounded.T, strict=True):
        if not np.isfinite(column).any():
            raise RobotError(
                f"joint '{name}' has no finite limit among effort, velocity and acceleration, so "
                "its speed is unbounded; give one in robot.limits"
            )


def _effort_ranges(joint_names: Sequence[str], given: Mapping[str, Any]) -> list[EffortRange]:
    """Return the effort limits that are more than a number each."""
    return [
        effort_range(column, given[name])
        for column, name in enumerate(joint_names)
        if name in given and not is_number(given[name])
    ]


def _laws(
    joint_names: Sequence[str], given: Mapping[str, Any], positions: FloatArray
) -> tuple[VelocityByPosition, ...]:
    """Return the velocity limits that depend on the position, position limits (n, 2) given."""
    return tuple(
        velocity_by_position(
            f"robot.limits.velocity_by_position.{name}", column, given[name], positions[column]
        )
        for column, name in enumerate(joint_names)
        if given.get(name) is not None
    )


def _bound_by_follower(follower: UrdfJoint, rule: Mimic, given: _Given, bounds: FloatArray) -> None:
    """Cut a master's position limits (2,) with those of a joint that follows it, in place."""
    lower, upper = given["position"].get(follower.name, (follower.lower, follower.upper))
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


def _rates_of(follower: UrdfJoint, given: _Given) -> dict[str, float]:
    """Return the limits that a follower has on velocity, acceleration and jerk, by quantity."""
    name, velocity = follower.name, follower.velocity
    rates = {
        quantity: given[quantity][name]
        for quantity in ("velocity", "acceleration", "jerk")
        if name in given[quantity]
    }
    if velocity is not None and 0 < velocity < np.inf:
        rates.setdefault("velocity", velocity)
    return rates


def _position(description: UrdfDescription, joint: UrdfJoint, given: _Given) -> tuple[float, float]:
    lower, upper = given["position"].get(joint.name, (joint.lower, joint.upper))
    if joint.type == "prismatic" and not np.isfinite([lower, upper]).all():
        raise RobotError(
            f"{description.path}: joint '{joint.name}' slides without end, position limits "
            f"[{lower:g}, {upper:g}]; give finite ones in robot.limits.position"
        )
    if not lower < upper:
        source = (
            "robot.limits.position" if joint.name in given["position"] else str(description.path)
        )
        raise RobotError(
            f"{source}: joint '{joint.name}' has position limits [{lower:g}, {upper:g}], an empty "
            "range; give them in robot.limits.position"
        )
    return lower, upper


def _required(
    description: UrdfDescription, joint: UrdfJoint, quantity: str, override: Mapping[str, float]
) -> float:
    """Return a limit that a URDF should have: positive and finite, or given by the problem."""
    if joint.name in override:
        return override[joint.name]
    value: float | None = getattr(joint, quantity)
    if value is None or not 0 < value < np.inf:
        found = "none" if value is None else f"{value:g}"
        raise RobotError(
            f"{description.path}: joint '{joint.name}' has {quantity} limit {found}; "
            f"give a positive one in robot.limits.{quantity}, or .inf if there is none"
        )
    return value
