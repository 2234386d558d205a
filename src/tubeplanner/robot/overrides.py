"""LimitOverrides, MotorOverrides: limits and motors of a problem, by joint; their declaration."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import Field

from tubeplanner.checks import are_numbers, in_figures, is_number
from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.fields import (
    DeclaredSection,
    Finite,
    Flag,
    Number,
    Section,
    Vector,
    declaration,
    declared,
    documented,
    is_pair,
    is_plain_number,
    one_of,
    section_of,
)
from tubeplanner.text import short_repr

_MIN, _MAX = 1e-6, 1e9  # limits, speeds and motor values that make sense, in SI units

# ---- Types of values of joints, in Python and in files.

NumberPerJoint: TypeAlias = float | Sequence[float] | Mapping[str, float]
Range: TypeAlias = tuple[float, float]
Effort: TypeAlias = float | tuple[float, float] | Mapping[str, Sequence[float]]
EffortPerJoint: TypeAlias = float | Sequence[float] | Mapping[str, Effort]
Law: TypeAlias = Mapping[str, float | None] | None
Friction: TypeAlias = float | tuple[float, float]
FrictionPerJoint: TypeAlias = float | Sequence[Friction] | Mapping[str, Friction]


class EffortTableFields(Section):
    """An effort limit that depends on the joint's position."""

    position: list[Finite] = Field(description="increasing [rad] or [m]")
    effort: list[Finite] = Field(
        description="there; linear between them, constant beyond [N m] or [N]"
    )


class VelocityByPositionFields(Section):
    """A velocity limit that falls towards the ends of a joint's range, beside `velocity`."""

    deceleration: Finite = Field(description="at which it could still stop [rad/s^2] or [m/s^2]")
    offset: Finite = Field(description="taken off the velocity [rad/s] or [m/s]")
    lower: Finite | None = Field(
        None, description="where it would stop; default: the position limit [rad, m]"
    )
    upper: Finite | None = Field(
        None, description="where it would stop; default: the position limit [rad, m]"
    )


_PER_JOINT = one_of(
    lambda value: is_plain_number(value) or isinstance(value, list | tuple | dict),
    "one number for all joints, a list with one for each, or a map by name",
)
_Numbers: TypeAlias = Annotated[Number | list[Number] | dict[str, Number], _PER_JOINT]
_Friction: TypeAlias = Annotated[
    Number | tuple[Number, Number],
    one_of(
        lambda value: is_plain_number(value) or is_pair(value),
        "a number, or [backwards, forwards]",
    ),
]
_Frictions: TypeAlias = Annotated[Number | list[_Friction] | dict[str, _Friction], _PER_JOINT]
_Effort: TypeAlias = Annotated[
    Number | tuple[Number, Number] | EffortTableFields,
    one_of(
        lambda value: is_plain_number(value) or is_pair(value) or isinstance(value, dict),
        "a number, [backwards, forwards], or a map with position and effort",
    ),
]
_Efforts: TypeAlias = Annotated[Number | list[Number] | dict[str, _Effort], _PER_JOINT]
_Ranges: TypeAlias = dict[str, tuple[Number, Number]] | list[tuple[Number, Number]]
_Law: TypeAlias = VelocityByPositionFields | None


_NO_NUMBER = ("position", "velocity_by_position")  # a single number does not serve for all joints


class _JointValues:
    """Fields with values of joints: a number for all, a list in chain order, or a map by name."""

    def by_name(self, quantity: str, chain: Sequence[str], where: str) -> Mapping[str, Any]:
        """Return the values of a quantity by joint name, of a chain in its order."""
        values = getattr(self, quantity)
        if isinstance(values, Mapping):
            return values
        if is_number(values):
            return dict.fromkeys(chain, values)
        if len(values) != len(chain):
            alone = "" if quantity in _NO_NUMBER else "one for all joints, "
            raise RobotError(
                f"{where} has {len(values)} values for {len(chain)} joints; give "
                f"{alone}a map by name, or a list in the order of the chain: {', '.join(chain)}"
            )
        return dict(zip(chain, values, strict=True))

    def _entries(self, section: str, quantity: str) -> Iterator[tuple[str, Any]]:
        """Yield each value of a quantity with its label in messages."""
        where, values = f"{section}.{quantity}", getattr(self, quantity)
        if isinstance(values, Mapping):
            for name, value in values.items():
                yield f"{where}: joint {shown(name)} at", value
        elif isinstance(values, list | tuple) or (
            isinstance(values, np.ndarray) and values.ndim > 0
        ):
            yield from ((f"{where}[{k}] is", value) for k, value in enumerate(values))
        elif quantity in _NO_NUMBER:
            raise RobotError(
                f"{where} is {shown(values)}; it must be a map by name, or a list with one for "
                "each joint"
            )
        elif is_number(values):
            yield f"{where} is", values
        else:
            raise RobotError(
                f"{where} is {shown(values)}; it must be one number for all joints, a list with "
                "one for each, or a map by name, such as {'elbow_joint': 1.5}"
            )


# ---- Limits of a problem, which replace and scale the URDF's.


@dataclass(frozen=True)
class JointQuantity:
    """A quantity with a limit for each joint: a field of `LimitOverrides` and of `JointLimits`."""

    units: tuple[str, str]  # of a turning and of a sliding joint
    # "required", "optional" or "never": such a limit enters the hash only if it is given
    in_urdf: str = "never"
    is_scalable: bool = False  # True if a commissioning factor may scale the limit
    is_followed: bool = False  # True if the limit of a follower bounds its master
    name: str = ""  # of the fields in both

    @property
    def label(self) -> str:
        """The quantity in words."""
        return self.name.replace("_", " ")

    def unit(self, is_revolute: bool) -> str:
        """Return the unit of a turning or a sliding joint."""
        return self.units[0] if is_revolute else self.units[1]


def _limit(description: str, quantity: JointQuantity, kind: Any = _Numbers) -> Any:
    turning, sliding = quantity.units
    text = f"{description} [{turning}] or [{sliding}]"
    return declared({}, text, kind, quantity=quantity)


@documented
@dataclass(frozen=True)
class PointSpeed:
    """A limit on the speed of a point that moves with a link.

    Raises:
        RobotError: The position is not three numbers, or the speed is not from 1e-6 to 1e9 m/s.
    """

    link: str = field(metadata=declaration("any URDF link"))
    position: Vector = field(metadata=declaration("of the point in the link's frame [m]"))
    speed: Finite = field(metadata=declaration("in any direction [m/s]"))

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


@section_of(PointSpeed)
class PointSpeedFields(DeclaredSection):
    """A limit on the speed of a point of the arm."""


@documented
@dataclass(frozen=True)
class LimitOverrides(_JointValues):
    """Limits of a problem: maps by joint name, or lists with a value per joint in chain order.

    A single number serves for all joints, but of position and velocity by position.

    Infinite: no limit. In a map of efforts a value may be [backwards, forwards], two magnitudes by
    the sign of the effort, or a map with increasing positions and efforts there: linear between
    them, constant beyond. Maps of velocity_by_position have deceleration, offset, and lower and
    upper where they are not the position limits, as in `VelocityByPosition`; None: none.
    """

    effort: EffortPerJoint = _limit(
        "either way; in a map also [backwards, forwards], or by position",
        JointQuantity(("N m", "N"), "required", is_scalable=True),
        _Efforts,
    )
    velocity: NumberPerJoint = _limit(
        "either way",
        JointQuantity(("rad/s", "m/s"), "required", is_scalable=True, is_followed=True),
    )
    position: Mapping[str, Range] | Sequence[Range] = declared(
        {}, "[lower, upper] [rad, m]", _Ranges
    )
    acceleration: NumberPerJoint = _limit(
        "default: none",
        JointQuantity(("rad/s^2", "m/s^2"), "optional", is_scalable=True, is_followed=True),
    )
    jerk: NumberPerJoint = _limit(
        "default: none",
        JointQuantity(("rad/s^3", "m/s^3"), "optional", is_followed=True),
    )
    scale: Mapping[str, float] = declared(
        {}, "factors in (0, 1] on effort, velocity, acceleration", dict[str, Finite]
    )
    tool_speed: float | None = declared(None, "of the tool centre point [m/s]", Number | None)
    tool_acceleration: float | None = declared(
        None, "of the tool centre point, gravity not counted [m/s^2]", Number | None
    )
    velocity_tolerance: float | None = declared(
        None, "fraction of a velocity limit beyond it at which the controller stops", Number | None
    )
    effort_rate: NumberPerJoint = _limit("default: none", JointQuantity(("N m/s", "N/s")))
    velocity_by_position: Mapping[str, Law] | Sequence[Law] = declared(
        {}, "velocity limits that fall towards the ends of the range", dict[str, _Law] | list[_Law]
    )
    point_speed: Sequence[PointSpeed] = declared([], "of points of the arm", list[PointSpeedFields])
    position_margin: NumberPerJoint = declared(
        {}, "taken off both position limits; default: 0 [rad, m]", _Numbers
    )

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name, unit in (("tool_speed", "m/s"), ("tool_acceleration", "m/s^2")):
            value = getattr(self, name)
            if value is not None and not (is_number(value) and value >= _MIN):
                raise RobotError(
                    f"robot.limits.{name} is {shown(value)}; give a number from {_MIN:g} {unit}"
                )
        tolerance = self.velocity_tolerance
        if tolerance is not None and not (is_number(tolerance) and 0 <= tolerance <= 1):
            raise RobotError(
                f"robot.limits.velocity_tolerance is {shown(tolerance)}; give a number from 0 to 1"
            )
        for _ in self._entries("robot.limits", "velocity_by_position"):
            pass  # the values are checked beside the limits of the joints
        for quantity in QUANTITIES:
            for where, value in self._entries("robot.limits", quantity):
                takes_range = quantity == "effort" and isinstance(self.effort, Mapping)
                if takes_range and not is_number(value):
                    _require_effort_range(where, value)
                elif not _is_limit(value):
                    raise RobotError(
                        f"{where} {in_figures(value)}; give a number from {_MIN:g} to {_MAX:g}, "
                        "or .inf for none"
                    )
        for where, range_ in self._entries("robot.limits", "position"):
            if not _is_pair(range_) or not all(map(is_number, range_)):
                raise RobotError(f"{where} {shown(range_)}; give [lower, upper]")
        for where, margin in self._entries("robot.limits", "position_margin"):
            if not _is_amount(margin):
                raise RobotError(f"{where} {in_figures(margin)}; give a number from 0 to {_MAX:g}")
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


# All that depends on which scalar limits there are follows from the fields above.
QUANTITIES: dict[str, JointQuantity] = {
    each.name: replace(each.metadata["quantity"], name=each.name)
    for each in fields(LimitOverrides)
    if "quantity" in each.metadata
}
SCALABLE = tuple(name for name, quantity in QUANTITIES.items() if quantity.is_scalable)
FOLLOWED = tuple(name for name, quantity in QUANTITIES.items() if quantity.is_followed)
PER_JOINT = (*QUANTITIES, *_NO_NUMBER, "position_margin")


@section_of(LimitOverrides)
class LimitFields(DeclaredSection):
    """Limits by joint name, or lists in chain order; a number serves for all. `.inf`: none.

    They replace those of the URDF.
    """


def limits_of(section: LimitFields) -> LimitOverrides:
    """Return the limits of a section of a file."""
    values = section.model_dump()
    points = tuple(PointSpeed(**point) for point in values["point_speed"])
    return LimitOverrides(**(values | {"point_speed": points}))


# ---- Motors of a problem.

CURVE = ("saturation_effort", "no_load_velocity")  # the ends of a torque-speed line


@documented
@dataclass(frozen=True)
class MotorOverrides(_JointValues):
    """Motors of a problem: a number for all joints, a list in chain order, or a map by name.

    None: left to lower layers.
    """

    armature: NumberPerJoint = declared(
        {}, "inertia of the rotor as felt at the joint [kg m^2] or [kg]", _Numbers
    )
    viscous_friction: NumberPerJoint = declared(
        {}, "friction in proportion to the velocity [N m s/rad] or [N s/m]", _Numbers
    )
    coulomb_friction: FrictionPerJoint = declared(
        {},
        "friction whatever the velocity; in a list or map also [backwards, forwards], by the "
        "direction of motion [N m] or [N]",
        _Frictions,
    )
    saturation_effort: NumberPerJoint = declared(
        {}, "stall effort of a torque-speed line; .inf: no line [N m] or [N]", _Numbers
    )
    no_load_velocity: NumberPerJoint = declared(
        {}, "where that line reaches zero; .inf: no line [rad/s] or [m/s]", _Numbers
    )
    friction_from_urdf: bool | None = declared(
        None,
        "take the URDF's damping and friction where none is given; default: false",
        Flag | None,
    )
    friction_uncertainty: float | None = declared(
        None,
        "fraction by which friction may be more or less, in [0, 1); the certificate judges the "
        "worst; default: 0",
        Finite | None,
    )

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for quantity in MOTOR_QUANTITIES:
            for where, value in self._entries("robot.motors", quantity):
                self._require(quantity, where, value)
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

    @staticmethod
    def _require(quantity: str, where: str, value: Any) -> None:
        """Raise RobotError unless a motor's value, with a label, is within its bounds."""
        if quantity in CURVE:
            is_valid = _is_limit(value)
            remedy = f"from {_MIN:g} to {_MAX:g}, or .inf where there is no torque-speed line"
        else:
            is_valid, remedy = _is_amount(value), f"from 0 to {_MAX:g}"
            if quantity == "coulomb_friction":
                is_valid |= _is_pair(value) and all(map(_is_amount, value))
                remedy += ", or [backwards, forwards] of such"
        if not is_valid:
            raise RobotError(f"{where} {in_figures(value)}; give a number {remedy}")


MOTOR_QUANTITIES = tuple(MotorOverrides.__dataclass_fields__)[:5]


@section_of(MotorOverrides)
class MotorFields(DeclaredSection):
    """Motors as felt at the joints, by joint name, or lists in chain order.

    A number serves for all. What is not given is ideal.
    """


# ---- Checks of single values of joints.


def _is_limit(value: Any) -> bool:
    return is_number(value) and (_MIN <= value <= _MAX or value == np.inf)


def _is_amount(value: Any) -> bool:
    return is_number(value) and 0 <= value <= _MAX


def _is_pair(value: Any) -> bool:
    return isinstance(value, list | tuple | np.ndarray) and len(value) == 2


def _is_list(value: Any) -> bool:
    return isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim == 1)


_TABLE = ("position", "effort")


def _require_effort_range(where: str, value: Any) -> None:
    """Raise RobotError unless a limit is [backwards, forwards], or a map of positions, efforts."""
    efforts = value
    if isinstance(value, Mapping):
        for key in value:
            if key not in _TABLE:
                raise RobotError(f"{where} {shown(value)}: {unknown_name('key', key, _TABLE)}")
        position, efforts = value.get("position", ()), value.get("effort", ())
        if not _is_list(position) or not _is_list(efforts) or not 0 < len(position) == len(efforts):
            raise RobotError(
                f"{where} {shown(value)}; give as many numbers in position as in effort, at least "
                "one"
            )
        is_finite = all(is_number(q) and np.isfinite(q) for q in position)
        if not is_finite or any(np.diff(position) <= 0):
            raise RobotError(
                f"{where} position {shown(position)}; give finite numbers that increase"
            )
        where = f"{where} effort"
    elif not _is_list(value) or len(value) != 2:
        raise RobotError(
            f"{where} {shown(value)}; give a number from {_MIN:g} to {_MAX:g}, "
            "[backwards, forwards], or a map with position and effort"
        )
    for effort in efforts:
        if not is_number(effort) or not _MIN <= effort <= _MAX:
            raise RobotError(
                f"{where} {shown(efforts)} has {in_figures(effort)}; give magnitudes from "
                f"{_MIN:g} to {_MAX:g}"
            )
