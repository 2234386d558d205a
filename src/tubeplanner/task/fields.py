"""Fields common to several file kinds: poses, clearances, limits, motors."""

from collections.abc import Callable
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from tubeplanner.errors import ProblemError
from tubeplanner.robot.overrides import LimitOverrides, MotorOverrides, PointSpeed
from tubeplanner.task.demands import ENDS, GOAL, START, Contact

# ---- Types of fields: strict, so that text is no number.


class Section(BaseModel):
    """A map with known keys."""

    # Built once, as part of the file's model, rather than for each section at import.
    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


def one_of(is_accepted: Callable[[Any], bool], kinds: str) -> BeforeValidator:
    """Return a validator with one message for all alternatives of a field.

    Args:
        is_accepted: Returns True for a value of an accepted kind.
        kinds: The accepted kinds, for the message.
    """

    def validated(value: Any) -> Any:
        if not is_accepted(value):
            raise ValueError(f"it must be {kinds}")
        return value

    return BeforeValidator(validated)


def no_flag(value: object) -> object:
    """Raise if a number is true or false: in Python these are 1 and 0."""
    if isinstance(value, bool):
        raise ValueError("true and false are no numbers")
    return value


def is_plain_number(value: object) -> bool:
    """Return True if a value of a file is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


Finite: TypeAlias = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Number: TypeAlias = Annotated[float, Field(strict=True)]
Vector: TypeAlias = tuple[Finite, Finite, Finite]
Quaternion: TypeAlias = tuple[Finite, Finite, Finite, Finite]
Range: TypeAlias = tuple[Number, Number]
Flag: TypeAlias = Annotated[bool, Field(strict=True)]
Version: TypeAlias = Annotated[Literal[1], BeforeValidator(no_flag)]


# ---- Poses.


class PoseFields(Section):
    """A pose of the tool centre point; exactly one of rpy, quaternion."""

    position: Vector = Field(description="base frame [m]")
    rpy: Vector | None = Field(None, description="fixed x, y, z as in URDF [rad]")
    quaternion: Quaternion | None = Field(None, description="x y z w, instead of rpy")


class ToolOffsetFields(Section):
    """The tool centre point in the tool frame."""

    position: Vector = Field((0.0, 0.0, 0.0), description="where it is in tool_frame [m]")
    rpy: Vector = Field((0.0, 0.0, 0.0), description="fixed x, y, z as in URDF [rad]")


class BaseFields(Section):
    """The pose of the root link in the cell; at most one of rpy, quaternion."""

    position: Vector = Field((0.0, 0.0, 0.0), description="of its origin [m]")
    rpy: Vector | None = Field(None, description="fixed x, y, z as in URDF [rad]")
    quaternion: Quaternion | None = Field(None, description="x y z w, instead of rpy")


# ---- Clearances and contacts, and their values in a problem.


class PairClearanceFields(Section):
    """A clearance of two solids."""

    links: tuple[str, str] = Field(description="links, attached solids or obstacles")
    clearance: Finite = Field(description="least distance between them [m]")


class ClearanceFields(Section):
    """Clearances; the more specific holds: of a pair, else of a segment, else the default."""

    default: Finite = Field(0.0, description="least distance of links to obstacles [m]")
    pairs: list[PairClearanceFields] = Field(
        [], description="of single pairs, also of links from each other"
    )
    segments: list[Finite | None] | None = Field(
        None, description="m distances of links to obstacles, null where it is the default [m]"
    )


Clearance: TypeAlias = Annotated[
    Finite | ClearanceFields,
    one_of(
        lambda value: isinstance(value, int | float | dict | ClearanceFields),
        "a number, or a map with default, pairs, segments",
    ),
    BeforeValidator(no_flag),  # the last validator comes first
]


class ContactFields(Section):
    """Two solids that may be nearer than their clearance where the motion begins or ends."""

    links: tuple[str, str] = Field(description="links, attached solids or obstacles")
    segments: list[Annotated[int, Field(strict=True)]] | None = Field(
        None,
        description="0, the first, where it begins, or the last (also -1), where it ends; left "
        "out: both",
    )
    within: Finite = Field(description="distance of the tool from where it is there [m]")


def clearances_of(fields: float | ClearanceFields) -> dict[str, Any]:
    """Return the arguments `clearance` and `pair_clearances` of a problem [m]."""
    if not isinstance(fields, ClearanceFields):
        return {"clearance": fields}
    pairs = {pair.links: pair.clearance for pair in fields.pairs}
    return {"clearance": fields.default, "pair_clearances": pairs}


def segment_clearances(fields: float | ClearanceFields) -> list[float | None] | None:
    """Return the `clearance` of a tube [m], None for the problem's."""
    return fields.segments if isinstance(fields, ClearanceFields) else None


def contacts_of(fields: list[ContactFields], segments: int | None) -> tuple[Contact, ...]:
    """Return the contacts of a problem.

    Args:
        fields: Contacts of a file.
        segments: Number of segments of the file's tube; None: not known yet.

    Raises:
        ProblemError: A segment is neither the first nor the last.
    """
    return tuple(
        Contact(each.links, each.within, _ends(k, each.segments, segments))
        for k, each in enumerate(fields)
    )


def _ends(k: int, indices: list[int] | None, segments: int | None) -> tuple[str, ...]:
    """Return the ends at which the solids of contact k touch, from indices of segments."""
    if indices is None:
        return ENDS
    last = [-1] if segments is None else [-1, segments - 1]
    for index in indices:
        if index != 0 and index not in last:
            accepted = "-1, the last" if segments is None else f"{segments - 1} (or -1), the last"
            raise ProblemError(
                f"contacts[{k}].segments has {index}; solids may touch where the motion begins "
                f"or ends: give 0, the first, or {accepted}"
            )
    ends = ((START, 0 in indices), (GOAL, any(index in last for index in indices)))
    return tuple(end for end, is_present in ends if is_present)


# ---- Limits and motors, in problem files and in presets.


def _is_pair(value: object) -> bool:
    return isinstance(value, list | tuple) and len(value) == 2 and all(map(is_plain_number, value))


_PER_JOINT = one_of(
    lambda value: is_plain_number(value) or isinstance(value, list | tuple | dict),
    "one number for all joints, a list with one for each, or a map by name",
)
NumberPerJoint: TypeAlias = Annotated[Number | list[Number] | dict[str, Number], _PER_JOINT]
_Friction: TypeAlias = Annotated[
    Number | tuple[Number, Number],
    one_of(
        lambda value: is_plain_number(value) or _is_pair(value),
        "a number, or [backwards, forwards]",
    ),
]
FrictionPerJoint: TypeAlias = Annotated[Number | list[_Friction] | dict[str, _Friction], _PER_JOINT]


class EffortTableFields(Section):
    """An effort limit that depends on the joint's position."""

    position: list[Finite] = Field(description="increasing [rad] or [m]")
    effort: list[Finite] = Field(
        description="there; linear between them, constant beyond [N m] or [N]"
    )


_Effort: TypeAlias = Annotated[
    Number | tuple[Number, Number] | EffortTableFields,
    one_of(
        lambda value: is_plain_number(value) or _is_pair(value) or isinstance(value, dict),
        "a number, [backwards, forwards], or a map with position and effort",
    ),
]
EffortPerJoint: TypeAlias = Annotated[Number | list[Number] | dict[str, _Effort], _PER_JOINT]


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


class PointSpeedFields(Section):
    """A limit on the speed of a point of the arm."""

    link: str = Field(description="any URDF link")
    position: Vector = Field(description="of the point in the link's frame [m]")
    speed: Finite = Field(description="in any direction [m/s]")


class LimitFields(Section):
    """Limits by joint name, or lists in chain order; a number serves for all. `.inf`: none.

    They replace those of the URDF.
    """

    effort: EffortPerJoint = Field(
        {},
        description="either way; in a map also [backwards, forwards], or by position [N m] or [N]",
    )
    velocity: NumberPerJoint = Field({}, description="either way [rad/s] or [m/s]")
    position: dict[str, Range] | list[Range] = Field({}, description="[lower, upper] [rad, m]")
    acceleration: NumberPerJoint = Field({}, description="default: none [rad/s^2] or [m/s^2]")
    jerk: NumberPerJoint = Field({}, description="default: none [rad/s^3] or [m/s^3]")
    scale: dict[str, Finite] = Field(
        {}, description="factors in (0, 1] on effort, velocity, acceleration"
    )
    tool_speed: Number | None = Field(None, description="of the tool centre point [m/s]")
    velocity_tolerance: Number | None = Field(
        None,
        description="fraction of a velocity limit beyond it at which the controller stops",
    )
    effort_rate: NumberPerJoint = Field({}, description="default: none [N m/s] or [N/s]")
    velocity_by_position: (
        dict[str, VelocityByPositionFields | None] | list[VelocityByPositionFields | None]
    ) = Field({}, description="velocity limits that fall towards the ends of the range")
    point_speed: list[PointSpeedFields] = Field([], description="of points of the arm")


class MotorFields(Section):
    """Motors as felt at the joints, by joint name, or lists in chain order.

    A number serves for all. What is not given is ideal.
    """

    armature: NumberPerJoint = Field(
        {}, description="inertia of the rotor as felt at the joint [kg m^2] or [kg]"
    )
    viscous_friction: NumberPerJoint = Field(
        {}, description="friction in proportion to the velocity [N m s/rad] or [N s/m]"
    )
    coulomb_friction: FrictionPerJoint = Field(
        {},
        description="friction whatever the velocity; in a list or map also [backwards, forwards], "
        "by the direction of motion [N m] or [N]",
    )
    saturation_effort: NumberPerJoint = Field(
        {}, description="stall effort of a torque-speed line; .inf: no line [N m] or [N]"
    )
    no_load_velocity: NumberPerJoint = Field(
        {}, description="where that line reaches zero; .inf: no line [rad/s] or [m/s]"
    )
    friction_from_urdf: Flag | None = Field(
        None, description="take the URDF's damping and friction where none is given; default: false"
    )
    friction_uncertainty: Finite | None = Field(
        None,
        description="fraction by which friction may be more or less, in [0, 1); the certificate "
        "judges the worst; default: 0",
    )


def limits_of(fields: LimitFields) -> LimitOverrides:
    """Return the limits of fields of a file.

    Raises:
        RobotError: A number is out of its bounds.
    """
    points = tuple(PointSpeed(**point.model_dump()) for point in fields.point_speed)
    return LimitOverrides(**(fields.model_dump() | {"point_speed": points}))


def motors_of(fields: MotorFields) -> MotorOverrides:
    """Return the motors of fields of a file.

    Raises:
        RobotError: A number is out of its bounds.
    """
    return MotorOverrides(**fields.model_dump())
