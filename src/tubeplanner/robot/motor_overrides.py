"""Motors that a problem gives: rotor inertia, friction, torque-speed lines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.errors import RobotError, shown
from tubeplanner.options import in_figures, is_number
from tubeplanner.robot.limit_overrides import NumberPerJoint
from tubeplanner.robot.per_joint_values import entries_of, require_per_joint, values_by_name
from tubeplanner.short_repr import short_repr

# One value each; a number alone serves for all joints.
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

_MIN, _MAX = 1e-6, 1e9  # numbers that make sense, in SI units


@dataclass(frozen=True)
class MotorOverrides:
    """Motors that a problem gives: one number for all joints, lists in chain order, or by name.

    Attributes:
        armature: Inertia of the rotors as felt at the joints [kg m^2 or kg].
        viscous_friction: Friction that grows with the velocity [N m s/rad or N s/m].
        coulomb_friction: Friction that does not [N m or N]; in a list or a map a value may be
            [backwards, forwards], by the direction of motion.
        saturation_effort: Stall effort of a torque-speed line [N m or N]; inf: no line.
        no_load_velocity: Velocity at which that line reaches zero [rad/s or m/s]; inf: no line.
        friction_from_urdf: Whether the URDF's friction is taken where none is given; None: not
            said.
        friction_uncertainty: By which share friction may be more or less, in [0, 1); None: not
            said.
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
            where, given = f"robot.motors.{quantity}", getattr(self, quantity)
            require_per_joint(where, given)
            for entry, value in entries_of(where, given):
                _REQUIRED[quantity](entry, value)
        if not isinstance(self.friction_from_urdf, bool | None):
            raise RobotError(
                f"robot.motors.friction_from_urdf is {shown(self.friction_from_urdf)}; it must be "
                "true or false"
            )
        share = self.friction_uncertainty
        if share is not None and not (is_number(share) and 0 <= share < 1):
            raise RobotError(
                f"robot.motors.friction_uncertainty is {in_figures(share)}; give a share from 0, "
                "below 1"
            )

    def by_name(self, quantity: str, chain: Sequence[str], where: str) -> Mapping[str, Any]:
        """Return the values of one quantity by joint name.

        Args:
            quantity: One of `MOTOR_QUANTITIES`.
            chain: The joints of the planning group, in chain order.
            where: What messages call the quantity.

        Raises:
            RobotError: A list has another number of values than there are joints.
        """
        return values_by_name(where, getattr(self, quantity), chain)


def _require_amount(where: str, value: Any) -> None:
    if not _is_amount(value):
        raise RobotError(f"{where} {in_figures(value)}; give a number from 0 to {_MAX:g}")


def _require_friction(where: str, value: Any) -> None:
    is_pair = isinstance(value, list | tuple | np.ndarray) and len(value) == 2
    if not _is_amount(value) and not (is_pair and all(_is_amount(one) for one in value)):
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
