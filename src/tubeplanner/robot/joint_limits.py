"""JointLimits: limits of the planned joints, of the URDF, replaced and scaled by layers."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import in_figures, is_number
from tubeplanner.errors import FormerName, RobotError, shown, unknown_name
from tubeplanner.robot.overrides import (
    FOLLOWED,
    PER_JOINT,
    QUANTITIES,
    SCALABLE,
    JointQuantity,
    LimitOverrides,
    MotorOverrides,
    PointSpeed,
)
from tubeplanner.robot.urdf import Mimic, UrdfDescription, UrdfJoint, followers_of
from tubeplanner.text import short_repr

# ---- Layers of limits and motors from several sources: the last value holds, its source is kept.


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
class MergedValues:
    """The values per joint of all layers."""

    by_joint: dict[str, dict[str, Any]]  # values by quantity and joint name
    sources: dict[str, dict[str, str]]  # the source of each value, by quantity and joint name


_Layer: TypeAlias = LimitOverrides | LimitLayer
GivenLimits: TypeAlias = _Layer | Sequence[_Layer]


def layers_of(value: GivenLimits) -> list[LimitLayer]:
    """Return limits as a list of layers, later layers above."""
    entries: Sequence[Any] = value if isinstance(value, list | tuple) else [value]
    layers = []
    for entry in entries:
        if not isinstance(entry, LimitOverrides | LimitLayer):
            raise RobotError(f"limits are {shown(entry)}; give LimitOverrides or a LimitLayer")
        layers.append(entry if isinstance(entry, LimitLayer) else LimitLayer("robot.", entry))
    return layers


def uppermost(values: Iterable[Any], default: Any) -> Any:
    """Return the last value of layers that is not None, or a default."""
    return next((each for each in list(values)[::-1] if each is not None), default)


def merged_scale(layers: Sequence[LimitLayer]) -> dict[str, float]:
    """Return the commissioning factors of layers, by quantity."""
    return {name: factor for layer in layers for name, factor in layer.limits.scale.items()}


def merged_limits(
    description: UrdfDescription, joint_names: Sequence[str], layers: Sequence[LimitLayer]
) -> MergedValues:
    """Merge the limits of layers for the joints of a planning group."""
    chain = chain_order(description, joint_names)
    followers = followers_of(description, joint_names)
    merged = MergedValues({name: {} for name in PER_JOINT}, {name: {} for name in PER_JOINT})
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
        for quantity in PER_JOINT:
            where = f"{layer.label}limits.{quantity}"
            values = layer.limits.by_name(quantity, chain, where)
            if not layer.skips_others:
                is_followed = quantity in (*FOLLOWED, "position")
                require_known(where, values, joints if is_followed else joint_names)
            merged.by_joint[quantity] |= values
            merged.sources[quantity] |= dict.fromkeys(values, layer.source)
    return merged


def chain_order(description: UrdfDescription, joint_names: Sequence[str]) -> list[str]:
    """Return joints in chain order: by the number of movable joints from the root to each."""
    joints = description.joints
    return sorted(joint_names, key=lambda name: len(description.chain(joints[name].child)))


def require_known(where: str, values: Mapping[str, Any], known: Sequence[str]) -> None:
    """Raise RobotError if values, with a label, are of an unknown joint."""
    for name in values:
        if name not in known:
            raise RobotError(f"{where}: {unknown_name('joint', name, known)}")


# ---- Limits of the planned joints, of the URDF where no layer has others.

_LAW_KEYS = ("deceleration", "offset", "lower", "upper")
# Decelerations that make sense [rad/s^2 or m/s^2].
_MIN_DECELERATION, _MAX_DECELERATION = 1e-6, 1e9

# Limits of the problem, by quantity and joint name.
_Overrides: TypeAlias = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class EffortRange:
    """Effort limits of a joint in both directions: linear between positions, constant beyond."""

    joint: int  # index of the joint in the group
    position: FloatArray  # increasing, shape (K,) [rad or m]
    # limit against the joint's direction at these positions, > 0, shape (K,) [N m or N]
    backwards: FloatArray
    forwards: FloatArray  # limit along the joint's direction, > 0, shape (K,) [N m or N]

    def __post_init__(self) -> None:
        for name in ("position", "backwards", "forwards"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @classmethod
    def of(cls, joint: int, limit: Any) -> "EffortRange":
        """Return the limits of a joint as in `LimitOverrides`: [backwards, forwards], or a map."""
        if isinstance(limit, Mapping):
            return cls(joint, limit["position"], limit["effort"], limit["effort"])
        backwards, forwards = limit
        return cls(joint, np.zeros(1), np.array([backwards]), np.array([forwards]))

    @property
    def most(self) -> float:
        """Largest limit at any position and in either direction [N m or N]."""
        return float(max(self.backwards.max(), self.forwards.max()))

    @property
    def is_constant(self) -> bool:
        """True if the limit is the same at every position and in both directions."""
        return bool((self.backwards == self.most).all() and (self.forwards == self.most).all())

    def scaled(self, factor: float) -> "EffortRange":
        """Return the limits times a factor."""
        return EffortRange(
            self.joint, self.position, factor * self.backwards, factor * self.forwards
        )

    def side(self, sign: float) -> FloatArray:
        """Return the limits along (1) or against (-1) the joint's direction, shape (K,)."""
        return self.forwards if sign > 0 else self.backwards

    def allowed(self, q: FloatArray, sign: float) -> FloatArray:
        """Return the limits in a direction (1 or -1) at positions of the joint, shape (N,)."""
        return np.interp(q, self.position, self.side(sign))

    def slope(self, q: FloatArray, sign: float) -> FloatArray:
        """Return the derivatives of `allowed`, shape (N,); at a corner, the right derivative."""
        slopes = np.diff(self.side(sign)) / np.diff(self.position)
        between = np.concatenate([[0.0], slopes, [0.0]])
        return between[np.searchsorted(self.position, q, side="right")]


@dataclass(frozen=True)
class VelocityByPosition:
    """A velocity limit that falls towards each end of a joint's range, beside its limit v_max.

    v <= min(v_max, max(0, -offset + sqrt(2 deceleration max(0, upper - q)))) and
    -v <= min(v_max, max(0, -offset + sqrt(2 deceleration max(0, q - lower)))).
    """

    joint: int  # index of the joint in the group
    deceleration: float  # with which it could still stop at the end [rad/s^2 or m/s^2]
    offset: float  # subtracted from the velocity [rad/s or m/s]
    lower: float  # end of the range backwards [rad or m]
    upper: float  # end of the range forwards [rad or m]

    @classmethod
    def of(cls, where: str, joint: int, law: Any, range_: FloatArray) -> "VelocityByPosition":
        """Return the law of a joint of `LimitOverrides`, its range (2,) [rad or m] the default."""
        if not isinstance(law, Mapping):
            raise RobotError(f"{where} is {shown(law)}; give a map with {', '.join(_LAW_KEYS)}")
        for key in law:
            if key not in _LAW_KEYS:
                raise RobotError(f"{where}: {unknown_name('key', key, _LAW_KEYS)}")
        values: dict[str, Any] = dict(zip(("lower", "upper"), range_, strict=True))
        values |= {key: value for key, value in law.items() if value is not None}
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
        return cls(joint, **{key: float(values[key]) for key in _LAW_KEYS})


@dataclass(frozen=True, eq=False)
class JointLimits:
    """Limits of n joints, in group order; inf where there is none."""

    lower_position: FloatArray  # shape (n,), the margin included [rad or m]
    upper_position: FloatArray  # shape (n,), the margin included [rad or m]
    velocity: FloatArray  # shape (n,) [rad/s or m/s]
    effort: FloatArray  # the largest at any position and in either direction, shape (n,) [N m or N]
    acceleration: FloatArray  # shape (n,) [rad/s^2 or m/s^2]
    jerk: FloatArray  # shape (n,) [rad/s^3 or m/s^3]
    effort_rate: FloatArray  # shape (n,) [N m/s or N/s]
    tool_speed: float = np.inf  # of the tool centre point [m/s]
    tool_acceleration: float = np.inf  # likewise, gravity not counted [m/s^2]
    # one for each joint whose velocity limit depends on its position, in group order
    velocity_by_position: tuple[VelocityByPosition, ...] = ()
    point_speed: tuple[PointSpeed, ...] = ()  # limits on the speed of points of the arm
    # one for each joint whose effort limit depends on position or direction
    effort_ranges: tuple[EffortRange, ...] = ()
    notes: tuple[str, ...] = ()  # parts of limit files that were not used
    # fraction by which the maker's controller lets joints exceed velocity limits; None: not known
    velocity_tolerance: float | None = None
    # source of each limit that is not the URDF's, by quantity and joint name
    sources: Mapping[str, Mapping[str, str]] = field(default_factory=dict, repr=False)
    # taken off both position limits, shape (n,) [rad or m]; 0: none
    position_margin: FloatArray | float = 0.0

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

    def range_text(self, joint: int) -> str:
        """Return the position limits of a joint as text, less the margin from them."""
        text = f"[{self.lower_position[joint]:g}, {self.upper_position[joint]:g}]"
        margin = np.broadcast_to(self.position_margin, self.lower_position.shape)[joint]
        return text + (f", less position_margin {margin:g}" if margin > 0 else "")

    def clip(self, q: FloatArray) -> FloatArray:
        """Return configurations (..., n), each value clipped to its position limits."""
        return np.clip(q, self.lower_position, self.upper_position)


LIMITS = tuple(name for name in JointLimits.__dataclass_fields__ if name in QUANTITIES)


def resolve_limits(
    description: UrdfDescription, joint_names: Sequence[str], limits: GivenLimits
) -> JointLimits:
    """Return the limits of the joints of a planning group: the URDF's, replaced by the problem's.

    Position, velocity, acceleration and jerk limits of a follower bound its master too, divided by
    the multiplier; limits that the URDF does not give do not. A follower has no motor: its effort
    limit is not read, its master's holds for the efforts of both.
    """
    layers, names = layers_of(limits), list(joint_names)
    merged, scale = merged_limits(description, names, layers), merged_scale(layers)
    user_efforts = merged.by_joint["effort"]
    effort_ranges = [
        EffortRange.of(column, user_efforts[name])
        for column, name in enumerate(names)
        if name in user_efforts and not is_number(user_efforts[name])
    ]
    largest = {names[each.joint]: each.most for each in effort_ranges}
    overrides = {**merged.by_joint, "effort": {**user_efforts, **largest}}
    joints = [description.joints[name] for name in names]
    positions = np.array([_position(description, joint, overrides) for joint in joints])
    values = {
        quantity: [_limit(description, joint, each, overrides[quantity]) for joint in joints]
        for quantity, each in QUANTITIES.items()
    }
    for name, rule in followers_of(description, names).items():
        column = names.index(rule.master)
        follower = description.joints[name]
        _bound_by_follower(follower, rule, overrides, positions[column])
        for quantity in FOLLOWED:
            bound: Any = overrides[quantity].get(name, getattr(follower, quantity, None))
            if name in overrides[quantity] or (bound is not None and 0 < bound < np.inf):
                bound /= abs(rule.multiplier)
                values[quantity][column] = min(values[quantity][column], bound)
    scaled = {
        quantity: read_only(np.array(row) * scale.get(quantity, 1.0))
        for quantity, row in values.items()
    }
    for column, name in enumerate(names):
        if not np.isfinite([scaled[quantity][column] for quantity in SCALABLE]).any():
            raise RobotError(
                f"joint '{name}' has no finite limit among effort, velocity and acceleration, so "
                "its speed is unbounded; give one in robot.limits"
            )
    margin = np.array([overrides["position_margin"].get(name, 0.0) for name in names])
    _require_range(names, positions, margin)
    laws = overrides["velocity_by_position"]
    above = [layer.limits for layer in layers]
    tolerance = uppermost((each.velocity_tolerance for each in above), None)
    return JointLimits(
        read_only(positions[:, 0] + margin),
        read_only(positions[:, 1] - margin),
        **scaled,
        tool_speed=float(uppermost((each.tool_speed for each in above), np.inf)),
        tool_acceleration=float(uppermost((each.tool_acceleration for each in above), np.inf)),
        velocity_by_position=tuple(
            VelocityByPosition.of(
                f"robot.limits.velocity_by_position.{name}", column, laws[name], positions[column]
            )
            for column, name in enumerate(names)
            if laws.get(name) is not None
        ),
        point_speed=tuple(uppermost((each.point_speed or None for each in above), ())),
        effort_ranges=tuple(
            each.scaled(scale.get("effort", 1.0)) for each in effort_ranges if not each.is_constant
        ),
        notes=tuple(note for layer in layers for note in layer.notes),
        velocity_tolerance=None if tolerance is None else float(tolerance),
        sources=merged.sources,
        position_margin=read_only(margin),
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


def _limit(
    description: UrdfDescription,
    joint: UrdfJoint,
    quantity: JointQuantity,
    overrides: Mapping[str, float],
) -> float:
    """Return a limit of a joint, the URDF's unless the problem replaces it."""
    if joint.name in overrides:
        return overrides[joint.name]
    value: float | None = getattr(joint, quantity.name, None)
    if value is None and quantity.in_urdf != "required":
        return np.inf
    if value is None or not 0 < value < np.inf:
        stated = "none" if value is None else f"{value:g}"
        raise RobotError(
            f"{description.path}: joint '{joint.name}' has {quantity.name} limit {stated}; "
            f"give a positive one in robot.limits.{quantity.name}, or .inf if there is none"
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


def _require_range(names: Sequence[str], positions: FloatArray, margin: FloatArray) -> None:
    """Raise RobotError if margins (n,) leave a joint nothing of its position limits (n, 2)."""
    for name, (lower, upper), own in zip(names, positions, margin, strict=True):
        if not lower + own < upper - own:
            raise RobotError(
                f"robot.limits.position_margin: joint '{name}' at {own:g} has nothing left of its "
                f"range [{lower:g}, {upper:g}]; give less than {(upper - lower) / 2:g}"
            )
