"""LimitOverrides, MotorOverrides: limits and motors of a problem, by joint."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.checks import are_numbers, in_figures, is_number
from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.text import short_repr

# ---- Limits of a problem, which replace and scale the URDF's.

SCALABLE = ("effort", "velocity", "acceleration")
# A single number serves for all joints.
_NUMBERS = (*SCALABLE, "jerk", "effort_rate")
PER_JOINT = (*_NUMBERS, "position", "velocity_by_position")

NumberPerJoint: TypeAlias = float | Sequence[float] | Mapping[str, float]
Range: TypeAlias = tuple[float, float]
Effort: TypeAlias = float | tuple[float, float] | Mapping[str, Sequence[float]]
EffortPerJoint: TypeAlias = float | Sequence[float] | Mapping[str, Effort]
Law: TypeAlias = Mapping[str, float | None] | None

_MIN, _MAX = 1e-6, 1e9  # limits, speeds and motor values that make sense, in SI units


@dataclass(frozen=True)
class PointSpeed:
    """A limit on the speed of a point that moves with a link.

    Attributes:
        link: Any link of the URDF.
        position: The point in the link's frame [m].
        speed: The largest in any direction, in the base frame [m/s].

    Raises:
        RobotError: The position is not three numbers, or the speed is not from 1e-6 to 1e9 m/s.
    """

    link: str
    position: tuple[float, float, float]
    speed: float

    def __post_init__(self) -> None:
        where = f"robot.limits.point_speed of link {shown(self.link)}"
        position = self.position
        if not are_numbers(position, 3):
            raise RobotError(f"{where}: position is {shown(position)}; give [x, y, z] in m")
        if not is_number(self.speed) or not _MIN <= self.speed <= _MAX:
            raise RobotError(
                f"{where}: speed is {in_figures(self.speed)}; give a number from {_MIN:g} to "
                f"{_MAX:g} m/s"
            )
        object.__setattr__(self, "position", tuple(float(value) for value in position))


@dataclass(frozen=True)
class LimitOverrides:
    """Limits of a problem: maps by joint name, or lists with a value per joint in chain order.

    A single number of effort, velocity, acceleration, jerk or effort rate serves for all joints.

    Attributes:
        effort: Replaces the URDF's effort limit [N m or N]; inf: none. In a map a value may be
            [backwards, forwards], two magnitudes by the sign of the effort, or a map with
            increasing positions and efforts there: linear between them, constant beyond.
        velocity: Replaces the URDF's velocity limit [rad/s or m/s]; inf: none.
        position: Replaces the URDF's (lower, upper) position limits [rad or m].
        acceleration: Acceleration limit [rad/s^2 or m/s^2]; a URDF has one from version 1.2 on.
        jerk: Jerk limit [rad/s^3 or m/s^3], likewise.
        scale: Commissioning factors (0, 1] on "effort", "velocity" and "acceleration".
        tool_speed: Limit on the speed of the tool centre point [m/s]; None: none.
        velocity_tolerance: Fraction of a velocity limit beyond it at which the controller stops;
            None: not known.
        effort_rate: Limit on the rate of the effort [N m/s or N/s]; a URDF has none.
        velocity_by_position: Velocity limits that fall towards the ends of a joint's range: maps
            with deceleration, offset, and lower and upper where they are not the position limits,
            as in `VelocityByPosition`; None: none.
        point_speed: Limits on the speed of points of the arm.
    """

    effort: EffortPerJoint = field(default_factory=dict)
    velocity: NumberPerJoint = field(default_factory=dict)
    position: Mapping[str, Range] | Sequence[Range] = field(default_factory=dict)
    acceleration: NumberPerJoint = field(default_factory=dict)
    jerk: NumberPerJoint = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    tool_speed: float | None = None
    velocity_tolerance: float | None = None
    effort_rate: NumberPerJoint = field(default_factory=dict)
    velocity_by_position: Mapping[str, Law] | Sequence[Law] = field(default_factory=dict)
    point_speed: Sequence[PointSpeed] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        speed = self.tool_speed
        if speed is not None and not (is_number(speed) and speed >= _MIN):
            raise RobotError(
                f"robot.limits.tool_speed is {shown(speed)}; give a number from {_MIN:g} m/s"
            )
        tolerance = self.velocity_tolerance
        if tolerance is not None and not (is_number(tolerance) and 0 <= tolerance <= 1):
            raise RobotError(
                f"robot.limits.velocity_tolerance is {shown(tolerance)}; give a number from 0 to 1"
            )
        for quantity in PER_JOINT:
            where, values = f"robot.limits.{quantity}", getattr(self, quantity)
            require_per_joint(where, values, takes_number=quantity in _NUMBERS)
        for quantity in _NUMBERS:
            for where, value in entries_of(f"robot.limits.{quantity}", getattr(self, quantity)):
                takes_range = quantity == "effort" and isinstance(self.effort, Mapping)
                if takes_range and not is_number(value):
                    require_effort_range(where, value)
                elif not is_number(value) or not (_MIN <= value <= _MAX or value == np.inf):
                    raise RobotError(
                        f"{where} {in_figures(value)}; give a number from {_MIN:g} to {_MAX:g}, "
                        "or .inf for none"
                    )
        for where, range_ in entries_of("robot.limits.position", self.position):
            is_pair = isinstance(range_, list | tuple | np.ndarray) and len(range_) == 2
            if not is_pair or not all(is_number(bound) for bound in range_):
                raise RobotError(f"{where} {shown(range_)}; give [lower, upper]")
        if not isinstance(self.scale, Mapping):
            raise RobotError(
                f"robot.limits.scale is {shown(self.scale)}; it must be a map by name, such as "
                "{'effort': 0.5}"
            )
        for name, factor in self.scale.items():
            if name not in SCALABLE:
                raise RobotError(f"robot.limits.scale: {unknown_name('quantity', name, SCALABLE)}")
            if not is_number(factor) or not 0 < factor <= 1:
                raise RobotError(
                    f"robot.limits.scale: {name} at {in_figures(factor)} must be in (0, 1]"
                )
        points = self.point_speed
        if not isinstance(points, list | tuple) or not all(
            isinstance(point, PointSpeed) for point in points
        ):
            raise RobotError(
                f"robot.limits.point_speed is {shown(points)}; give a list of PointSpeed"
            )

    def by_name(self, quantity: str, chain: Sequence[str], where: str) -> Mapping[str, Any]:
        """Return the limits of a quantity by joint name.

        Args:
            quantity: An entry of `PER_JOINT`.
            chain: The joints of the planning group, in chain order.
            where: Label of the quantity in messages.

        Raises:
            RobotError: A list has another number of values than there are joints.
        """
        takes_number = quantity in _NUMBERS
        return values_by_name(where, getattr(self, quantity), chain, takes_number=takes_number)


# A single number serves for all joints.
MOTOR_QUANTITIES = (
    "armature",
    "viscous_friction",
    "coulomb_friction",
    "saturation_effort",
    "no_load_velocity",
)
CURVE = ("saturation_effort", "no_load_velocity")  # the ends of a torque-speed line

Friction: TypeAlias = float | tuple[float, float]
FrictionPerJoint: TypeAlias = float | Sequence[Friction] | Mapping[str, Friction]


@dataclass(frozen=True)
class MotorOverrides:
    """Motors of a problem: a number for all joints, a list in chain order, or a map by name.

    Attributes:
        armature: Inertia of the rotors as felt at the joints [kg m^2 or kg].
        viscous_friction: Friction in proportion to the velocity [N m s/rad or N s/m].
        coulomb_friction: Friction independent of the velocity [N m or N]; in a list or a map a
            value may be [backwards, forwards], by the direction of motion.
        saturation_effort: Stall effort of a torque-speed line [N m or N]; inf: no line.
        no_load_velocity: Velocity at which that line reaches zero [rad/s or m/s]; inf: no line.
        friction_from_urdf: True if the URDF's friction holds where there is no other; None: left to
            lower layers.
        friction_uncertainty: Fraction by which friction may be more or less, in [0, 1); None: left
            to lower layers.
    """

    armature: NumberPerJoint = field(default_factory=dict)
    viscous_friction: NumberPerJoint = field(default_factory=dict)
    coulomb_friction: FrictionPerJoint = field(default_factory=dict)
    saturation_effort: NumberPerJoint = field(default_factory=dict)
    no_load_velocity: NumberPerJoint = field(default_factory=dict)
    friction_from_urdf: bool | None = None
    friction_uncertainty: float | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for quantity in MOTOR_QUANTITIES:
            where, values = f"robot.motors.{quantity}", getattr(self, quantity)
            require_per_joint(where, values)
            for entry, value in entries_of(where, values):
                _REQUIRED[quantity](entry, value)
        if not isinstance(self.friction_from_urdf, bool | None):
            raise RobotError(
                f"robot.motors.friction_from_urdf is {shown(self.friction_from_urdf)}; it must be "
                "true or false"
            )
        fraction = self.friction_uncertainty
        if fraction is not None and not (is_number(fraction) and 0 <= fraction < 1):
            raise RobotError(
                f"robot.motors.friction_uncertainty is {in_figures(fraction)}; give a "
                "fraction from 0, below 1"
            )

    def by_name(self, quantity: str, chain: Sequence[str], where: str) -> Mapping[str, Any]:
        """Return the values of a motor quantity, as `LimitOverrides.by_name`."""
        return values_by_name(where, getattr(self, quantity), chain)


def _require_amount(where: str, value: Any) -> None:
    if not _is_amount(value):
        raise RobotError(f"{where} {in_figures(value)}; give a number from 0 to {_MAX:g}")


def _require_friction(where: str, value: Any) -> None:
    is_pair = isinstance(value, list | tuple | np.ndarray) and len(value) == 2
    if not _is_amount(value) and not (is_pair and all(map(_is_amount, value))):
        raise RobotError(
            f"{where} {in_figures(value)}; give a number from 0 to {_MAX:g}, or [backwards, "
            "forwards] of such"
        )


def _require_end_of_curve(where: str, value: Any) -> None:
    if not (is_number(value) and (_MIN <= value <= _MAX or value == np.inf)):
        raise RobotError(
            f"{where} {in_figures(value)}; give a number from {_MIN:g} to {_MAX:g}, or .inf where "
            "there is no torque-speed line"
        )


def _is_amount(value: Any) -> bool:
    return is_number(value) and 0 <= value <= _MAX


_REQUIRED = {
    "armature": _require_amount,
    "viscous_friction": _require_amount,
    "coulomb_friction": _require_friction,
    **dict.fromkeys(CURVE, _require_end_of_curve),
}


# ---- Effort limits that differ by direction, or with the joint's position.

_KEYS = ("position", "effort")


@dataclass(frozen=True, eq=False)
class EffortRange:
    """Effort limits of a joint in both directions: linear between positions, constant beyond.

    Attributes:
        joint: Index of the joint in the group.
        position: Increasing, shape (K,) [rad or m].
        backwards: Limit against the joint's direction at these positions, > 0, shape (K,)
            [N m or N].
        forwards: Limit along the joint's direction, > 0, shape (K,) [N m or N].
    """

    joint: int
    position: FloatArray
    backwards: FloatArray
    forwards: FloatArray

    def __post_init__(self) -> None:
        for name in ("position", "backwards", "forwards"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

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


def effort_range(joint: int, user_value: Any) -> EffortRange:
    """Return the effort limits of a joint.

    Args:
        joint: Index of the joint in the group.
        user_value: [backwards, forwards], or a map, as `require_effort_range` accepts them.
    """
    if isinstance(user_value, Mapping):
        return EffortRange(
            joint, user_value["position"], user_value["effort"], user_value["effort"]
        )
    backwards, forwards = user_value
    return EffortRange(joint, np.zeros(1), np.array([backwards]), np.array([forwards]))


def require_effort_range(where: str, user_value: Any) -> None:
    """Raise unless a limit is [backwards, forwards], or a map with positions and efforts there.

    Args:
        where: Label in messages.
        user_value: The limit.

    Raises:
        RobotError: The limit is neither, a magnitude is out of its bounds, or positions do not
            increase.
    """
    if not isinstance(user_value, Mapping):
        if not _is_list(user_value) or len(user_value) != 2:
            raise RobotError(
                f"{where} {shown(user_value)}; give a number from {_MIN:g} to {_MAX:g}, "
                "[backwards, forwards], or a map with position and effort"
            )
        return _require_magnitudes(where, user_value)
    for key in user_value:
        if key not in _KEYS:
            raise RobotError(f"{where} {shown(user_value)}: {unknown_name('key', key, _KEYS)}")
    position, effort = user_value.get("position", ()), user_value.get("effort", ())
    if not _is_list(position) or not _is_list(effort) or not 0 < len(position) == len(effort):
        raise RobotError(
            f"{where} {shown(user_value)}; give as many numbers in position as in effort, at least "
            "one"
        )
    if not all(is_number(q) and np.isfinite(q) for q in position) or any(np.diff(position) <= 0):
        raise RobotError(f"{where} position {shown(position)}; give finite numbers that increase")
    return _require_magnitudes(f"{where} effort", effort)


def _is_list(user_value: Any) -> bool:
    return isinstance(user_value, list | tuple) or (
        isinstance(user_value, np.ndarray) and user_value.ndim == 1
    )


def _require_magnitudes(where: str, user_value: Any) -> None:
    for value in user_value:
        if not is_number(value) or not _MIN <= value <= _MAX:
            raise RobotError(
                f"{where} {shown(user_value)} has {in_figures(value)}; give magnitudes from "
                f"{_MIN:g} to {_MAX:g}"
            )


# ---- Values of joints: a number for all, a list in chain order, or a map by name.


def require_per_joint(where: str, user_value: Any, *, takes_number: bool = True) -> None:
    """Raise unless values are a list, a map, or a number for all joints.

    Args:
        where: Label in messages.
        user_value: The values.
        takes_number: True if a number may serve for all joints.

    Raises:
        RobotError: The values have another type.
    """
    is_list = isinstance(user_value, list | tuple) or (
        isinstance(user_value, np.ndarray) and user_value.ndim > 0
    )
    if isinstance(user_value, Mapping) or is_list or (takes_number and is_number(user_value)):
        return
    if not takes_number:
        raise RobotError(
            f"{where} is {shown(user_value)}; it must be a map by name, or a list with one for "
            "each joint"
        )
    raise RobotError(
        f"{where} is {shown(user_value)}; it must be one number for all joints, a list with one "
        "for each, or a map by name, such as {'elbow_joint': 1.5}"
    )


def entries_of(where: str, user_value: Any) -> Iterator[tuple[str, Any]]:
    """Yield pairs of a label in messages and a value."""
    if isinstance(user_value, Mapping):
        yield from (
            (f"{where}: joint {shown(name)} at", value) for name, value in user_value.items()
        )
    elif is_number(user_value):
        yield f"{where} is", user_value
    else:
        yield from ((f"{where}[{k}] is", value) for k, value in enumerate(user_value))


def values_by_name(
    where: str, user_value: Any, chain: Sequence[str], *, takes_number: bool = True
) -> Mapping[str, Any]:
    """Return values by joint name.

    Args:
        where: Label in messages.
        user_value: The values, as `require_per_joint` accepts them.
        chain: The joints of the planning group, in chain order.
        takes_number: True if a number may serve for all joints.

    Raises:
        RobotError: A list has another number of values than there are joints.
    """
    if isinstance(user_value, Mapping):
        return user_value
    if is_number(user_value):
        return dict.fromkeys(chain, user_value)
    if len(user_value) != len(chain):
        alone = "one for all joints, " if takes_number else ""
        raise RobotError(
            f"{where} has {len(user_value)} values for {len(chain)} joints; give "
            f"{alone}a map by name, or a list in the order of the chain: {', '.join(chain)}"
        )
    return dict(zip(chain, user_value, strict=True))
