"""The fields of limits and motors, in problem files and in presets."""

from typing import Annotated, TypeAlias

from pydantic import BeforeValidator, Field

from tubeplanner.problem.field_types import Finite, Flag, Number, Range, Section, Vector


def _per_joint(value: object) -> object:
    """Report what a value of joints may be."""
    if not _is_number(value) and not isinstance(value, list | tuple | dict):
        raise ValueError(
            "it must be one number for all joints, a list with one for each, or a map by name"
        )
    return value


def _one_or_both_ways(value: object) -> object:
    """Report what a friction of one joint may be."""
    if not _is_number(value) and not _is_pair(value):
        raise ValueError("it must be a number, or [backwards, forwards]")
    return value


def _effort(value: object) -> object:
    """Report what an effort limit of one joint may be."""
    if not _is_number(value) and not _is_pair(value) and not isinstance(value, dict):
        raise ValueError(
            "it must be a number, [backwards, forwards], or a map with position and effort"
        )
    return value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_pair(value: object) -> bool:
    return isinstance(value, list | tuple) and len(value) == 2 and all(map(_is_number, value))


NumberPerJoint: TypeAlias = Annotated[
    Number | list[Number] | dict[str, Number], BeforeValidator(_per_joint)
]
_Friction: TypeAlias = Annotated[Number | tuple[Number, Number], BeforeValidator(_one_or_both_ways)]
FrictionPerJoint: TypeAlias = Annotated[
    Number | list[_Friction] | dict[str, _Friction], BeforeValidator(_per_joint)
]


class EffortTableFields(Section):
    """An effort limit that depends on the joint's position."""

    position: list[Finite] = Field(description="increasing [rad] or [m]")
    effort: list[Finite] = Field(
        description="there; linear between them, constant beyond [N m] or [N]"
    )


_Effort: TypeAlias = Annotated[
    Number | tuple[Number, Number] | EffortTableFields, BeforeValidator(_effort)
]
EffortPerJoint: TypeAlias = Annotated[
    Number | list[Number] | dict[str, _Effort], BeforeValidator(_per_joint)
]


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
        description="share by which friction may be more or less, in [0, 1); the certificate "
        "judges the worst; default: 0",
    )
