"""Limits that a problem gives, which replace and scale those of the URDF."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.options import in_figures, is_number
from tubeplanner.robot.effort_range import require_effort_range
from tubeplanner.robot.per_joint_values import entries_of, require_per_joint, values_by_name
from tubeplanner.robot.point_speed import PointSpeed
from tubeplanner.short_repr import short_repr

SCALABLE = ("effort", "velocity", "acceleration")
# One number each; a number alone serves for all joints.
_NUMBERS = (*SCALABLE, "jerk", "effort_rate")
PER_JOINT = (*_NUMBERS, "position", "velocity_by_position")

NumberPerJoint: TypeAlias = float | Sequence[float] | Mapping[str, float]
Range: TypeAlias = tuple[float, float]
Effort: TypeAlias = float | tuple[float, float] | Mapping[str, Sequence[float]]
EffortPerJoint: TypeAlias = float | Sequence[float] | Mapping[str, Effort]
Law: TypeAlias = Mapping[str, float | None] | None

_MIN_LIMIT, _MAX_LIMIT = 1e-6, 1e9  # limits that make sense, in SI units


@dataclass(frozen=True)
class LimitOverrides:
    """Limits that a problem gives: maps by joint name, or lists, one per joint in chain order.

    Of effort, velocity, acceleration, jerk and effort rate one number serves for all joints.

    Attributes:
        effort: Replaces the URDF's effort limit [N m or N]; inf on purpose is allowed. In a map a
            value may be [backwards, forwards], two magnitudes by the sign of the effort, or a map
            with increasing positions and efforts there: linear between them, constant beyond.
        velocity: Replaces the URDF's velocity limit [rad/s or m/s]; inf on purpose is allowed.
        position: Replaces the URDF's (lower, upper) position limits [rad or m].
        acceleration: Acceleration limit [rad/s^2 or m/s^2]; a URDF has none.
        jerk: Jerk limit [rad/s^3 or m/s^3]; a URDF has none.
        scale: Commissioning factors (0, 1] on "effort", "velocity" and "acceleration".
        tool_speed: Limit on the speed of the tool centre point [m/s]; None: none.
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
    effort_rate: NumberPerJoint = field(default_factory=dict)
    velocity_by_position: Mapping[str, Law] | Sequence[Law] = field(default_factory=dict)
    point_speed: Sequence[PointSpeed] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        _require_speed(self.tool_speed)
        for quantity in PER_JOINT:
            where, given = f"robot.limits.{quantity}", getattr(self, quantity)
            require_per_joint(where, given, takes_number=quantity in _NUMBERS)
        for quantity in _NUMBERS:
            for where, value in entries_of(f"robot.limits.{quantity}", getattr(self, quantity)):
                if quantity == "effort" and isinstance(self.effort, Mapping):
                    _require_effort(where, value)
                else:
                    _require_limit(where, value)
        for where, range_ in entries_of("robot.limits.position", self.position):
            is_pair = isinstance(range_, list | tuple | np.ndarray) and len(range_) == 2
            if not is_pair or not all(is_number(bound) for bound in range_):
                raise RobotError(f"{where} {shown(range_)}; give [lower, upper]")
        _require_scale(self.scale)
        points = self.point_speed
        if not isinstance(points, list | tuple) or not all(
            isinstance(point, PointSpeed) for point in points
        ):
            raise RobotError(
                f"robot.limits.point_speed is {shown(points)}; give a list of PointSpeed"
            )

    def by_name(self, quantity: str, chain: Sequence[str], where: str) -> Mapping[str, Any]:
        """Return the limits of one quantity by joint name.

        Args:
            quantity: One of `PER_JOINT`.
            chain: The joints of the planning group, in chain order.
            where: What messages call the quantity.

        Raises:
            RobotError: A list has another number of values than there are joints.
        """
        alone = quantity in _NUMBERS
        return values_by_name(where, getattr(self, quantity), chain, takes_number=alone)


def _require_effort(where: str, value: Any) -> None:
    if is_number(value):
        _require_limit(where, value)
    else:
        require_effort_range(where, value)


def _require_limit(where: str, value: Any) -> None:
    in_range = is_number(value) and (_MIN_LIMIT <= value <= _MAX_LIMIT or value == np.inf)
    if not in_range:
        raise RobotError(
            f"{where} {in_figures(value)}; give a number from {_MIN_LIMIT:g} to {_MAX_LIMIT:g}, "
            "or .inf for none"
        )


def _require_scale(scale: Any) -> None:
    if not isinstance(scale, Mapping):
        raise RobotError(
            f"robot.limits.scale is {shown(scale)}; it must be a map by name, such as "
            "{'effort': 0.5}"
        )
    for name, factor in scale.items():
        if name not in SCALABLE:
            raise RobotError(f"robot.limits.scale: {unknown_name('quantity', name, SCALABLE)}")
        if not is_number(factor) or not 0 < factor <= 1:
            raise RobotError(
                f"robot.limits.scale: {name} at {in_figures(factor)} must be in (0, 1]"
            )


def _require_speed(value: Any) -> None:
    if value is not None and not (is_number(value) and value >= _MIN_LIMIT):
        raise RobotError(
            f"robot.limits.tool_speed is {shown(value)}; give a number from {_MIN_LIMIT:g} m/s"
        )
