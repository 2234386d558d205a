"""Limits of the planned joints: those of the URDF, replaced and scaled by those of the problem."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.options import in_figures, is_number
from tubeplanner.robot.followers import followers_of
from tubeplanner.robot.urdf import Mimic, UrdfDescription, UrdfJoint

_MIN_LIMIT, _MAX_LIMIT = 1e-6, 1e9  # limits that make sense, in SI units
_SCALABLE = ("effort", "velocity", "acceleration")


@dataclass(frozen=True)
class LimitOverrides:
    """Limits that a problem gives, by joint name.

    Attributes:
        effort: Replaces the URDF's effort limit [N m or N]; inf on purpose is allowed.
        velocity: Replaces the URDF's velocity limit [rad/s or m/s]; inf on purpose is allowed.
        position: Replaces the URDF's (lower, upper) position limits [rad or m].
        acceleration: Acceleration limit [rad/s^2 or m/s^2]; a URDF has none.
        jerk: Jerk limit [rad/s^3 or m/s^3]; a URDF has none.
        scale: Commissioning factors (0, 1] on "effort", "velocity" and "acceleration".
        tool_speed: Limit on the speed of the tool centre point [m/s]; None: none.
    """

    effort: Mapping[str, float] = field(default_factory=dict)
    velocity: Mapping[str, float] = field(default_factory=dict)
    position: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    acceleration: Mapping[str, float] = field(default_factory=dict)
    jerk: Mapping[str, float] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    tool_speed: float | None = None

    def __post_init__(self) -> None:
        _require_speed(self.tool_speed)
        for field_ in fields(self):
            given = getattr(self, field_.name)
            if field_.name != "tool_speed" and not isinstance(given, Mapping):
                raise RobotError(
                    f"robot.limits.{field_.name} is {shown(given)}; it must be a map by name, such "
                    "as {'elbow_joint': 1.5}"
                )
        for quantity in (*_SCALABLE, "jerk"):
            for name, value in getattr(self, quantity).items():
                in_range = is_number(value) and (
                    _MIN_LIMIT <= value <= _MAX_LIMIT or value == np.inf
                )
                if not in_range:
                    raise RobotError(
                        f"robot.limits.{quantity}: joint '{name}' at {in_figures(value)}; give a "
                        f"number from {_MIN_LIMIT:g} to {_MAX_LIMIT:g}, or .inf for none"
                    )
        for name, range_ in self.position.items():
            if np.shape(range_) != (2,) or not all(is_number(bound) for bound in range_):
                raise RobotError(
                    f"robot.limits.position: joint '{name}' at {shown(range_)}; give [lower, upper]"
                )
        for name, factor in self.scale.items():
            if name not in _SCALABLE:
                raise RobotError(f"robot.limits.scale: {unknown_name('quantity', name, _SCALABLE)}")
            if not is_number(factor) or not 0 < factor <= 1:
                raise RobotError(
                    f"robot.limits.scale: {name} at {in_figures(factor)} must be in (0, 1]"
                )


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of n joints, in group order; inf where there is none.

    Attributes:
        lower_position: Shape (n,) [rad or m].
        upper_position: Shape (n,) [rad or m].
        velocity: Shape (n,) [rad/s or m/s].
        effort: Shape (n,) [N m or N].
        acceleration: Shape (n,) [rad/s^2 or m/s^2].
        jerk: Shape (n,) [rad/s^3 or m/s^3].
        tool_speed: Of the tool centre point [m/s].
    """

    lower_position: FloatArray
    upper_position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    tool_speed: float = np.inf

    def unlimited(self, quantity: str) -> IntArray:
        """Return which joints nothing limits in a quantity, such as "jerk": int, shape (k,)."""
        return np.flatnonzero(~np.isfinite(getattr(self, quantity)))

    def clip(self, q: FloatArray) -> FloatArray:
        """Return configurations of shape (..., n) moved into the position limits."""
        return np.clip(q, self.lower_position, self.upper_position)


def resolve_limits(
    description: UrdfDescription, joint_names: Sequence[str], overrides: LimitOverrides
) -> JointLimits:
    """Return the limits of the joints of a planning group.

    Position, velocity, acceleration and jerk of joints that follow one of them bound it too,
    divided by their multipliers; limits that the URDF does not give do not. A follower has no
    motor: its effort limit is not asked, its master's holds for all they take together.

    Raises:
        RobotError: A limit is missing, zero, negative or reversed and not replaced, a joint has no
            finite limit that bounds its speed, a follower leaves it no position, or an override
            names a joint that is neither in the group nor follows one of it.
    """
    followers = followers_of(description, joint_names)
    for quantity in ("effort", "velocity", "position", "acceleration", "jerk"):
        known = [*joint_names, *(followers if quantity != "effort" else ())]
        for name in getattr(overrides, quantity):
            if name not in known:
                raise RobotError(f"robot.limits.{quantity}: {unknown_name('joint', name, known)}")
    joints = [description.joints[name] for name in joint_names]
    positions = np.array([_position(description, joint, overrides) for joint in joints])
    values = {
        "effort": [_required(description, joint, "effort", overrides.effort) for joint in joints],
        "velocity": [
            _required(description, joint, "velocity", overrides.velocity) for joint in joints
        ],
        "acceleration": [overrides.acceleration.get(name, np.inf) for name in joint_names],
        "jerk": [overrides.jerk.get(name, np.inf) for name in joint_names],
    }
    for name, rule in followers.items():
        column = list(joint_names).index(rule.master)
        _bound_by_follower(description.joints[name], rule, overrides, positions[column])
        for quantity, bound in _rates_of(description.joints[name], overrides).items():
            values[quantity][column] = min(values[quantity][column], bound / abs(rule.multiplier))
    scaled = {
        quantity: read_only(np.array(row) * overrides.scale.get(quantity, 1.0))
        for quantity, row in values.items()
    }
    bounded = np.array([scaled[quantity] for quantity in _SCALABLE])
    for name, column in zip(joint_names, bounded.T, strict=True):
        if not np.isfinite(column).any():
            raise RobotError(
                f"joint '{name}' has no finite limit among effort, velocity and acceleration, so "
                "its speed is unbounded; give one in robot.limits"
            )
    tool_speed = np.inf if overrides.tool_speed is None else float(overrides.tool_speed)
    lower, upper = read_only(positions[:, 0]), read_only(positions[:, 1])
    return JointLimits(lower, upper, **scaled, tool_speed=tool_speed)


def _require_speed(value: Any) -> None:
    if value is not None and not (is_number(value) and value >= _MIN_LIMIT):
        raise RobotError(
            f"robot.limits.tool_speed is {shown(value)}; give a number from {_MIN_LIMIT:g} m/s"
        )


def _bound_by_follower(
    follower: UrdfJoint, rule: Mimic, overrides: LimitOverrides, bounds: FloatArray
) -> None:
    """Cut a master's position limits (2,) with those of a joint that follows it, in place."""
    lower, upper = overrides.position.get(follower.name, (follower.lower, follower.upper))
    if lower == upper == 0.0:  # the URDF gives no limits
        lower, upper = -np.inf, np.inf
    ends = sorted((end - rule.offset) / rule.multiplier for end in (lower, upper))
    given = bounds.copy()
    bounds[:] = max(bounds[0], ends[0]), min(bounds[1], ends[1])
    where = f"joint '{follower.name}', which follows '{rule.master}'"
    if not lower <= upper or not bounds[0] < bounds[1]:
        raise RobotError(
            f"{where}, has position limits [{lower:g}, {upper:g}]; they leave its master, whose "
            f"own are [{given[0]:g}, {given[1]:g}], no range; give either in robot.limits.position"
        )
    if follower.type == "prismatic" and not np.isfinite(bounds).all():
        raise RobotError(
            f"{where}, slides without end; give finite limits in robot.limits.position"
        )


def _rates_of(follower: UrdfJoint, overrides: LimitOverrides) -> dict[str, float]:
    """Return the limits that a follower has on velocity, acceleration and jerk, by quantity."""
    name, velocity = follower.name, follower.velocity
    rates = {
        quantity: getattr(overrides, quantity)[name]
        for quantity in ("velocity", "acceleration", "jerk")
        if name in getattr(overrides, quantity)
    }
    if velocity is not None and 0 < velocity < np.inf:
        rates.setdefault("velocity", velocity)
    return rates


def _position(
    description: UrdfDescription, joint: UrdfJoint, overrides: LimitOverrides
) -> tuple[float, float]:
    lower, upper = overrides.position.get(joint.name, (joint.lower, joint.upper))
    if joint.type == "prismatic" and not np.isfinite([lower, upper]).all():
        raise RobotError(
            f"{description.path}: joint '{joint.name}' slides without end, position limits "
            f"[{lower:g}, {upper:g}]; give finite ones in robot.limits.position"
        )
    if not lower < upper:
        source = (
            "robot.limits.position" if joint.name in overrides.position else str(description.path)
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
