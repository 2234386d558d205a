"""Limits that a problem gives, which replace and scale those of the URDF."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.options import in_figures, is_number
from tubeplanner.robot.point_speed import PointSpeed

SCALABLE = ("effort", "velocity", "acceleration")
# One number each; a number alone serves for all joints.
_NUMBERS = (*SCALABLE, "jerk", "effort_rate")
PER_JOINT = (*_NUMBERS, "position", "velocity_by_position")

NumberPerJoint: TypeAlias = float | Sequence[float] | Mapping[str, float]
Range: TypeAlias = tuple[float, float]
Law: TypeAlias = Mapping[str, float | None]

_MIN_LIMIT, _MAX_LIMIT = 1e-6, 1e9  # limits that make sense, in SI units


@dataclass(frozen=True)
class LimitOverrides:
    """Limits that a problem gives: maps by joint name, or lists, one per joint in chain order.

    Of effort, velocity, acceleration, jerk and effort rate one number serves for all joints.

    Attributes:
        effort: Replaces the URDF's effort limit [N m or N]; inf on purpose is allowed.
        velocity: Replaces the URDF's velocity limit [rad/s or m/s]; inf on purpose is allowed.
        position: Replaces the URDF's (lower, upper) position limits [rad or m].
        acceleration: Acceleration limit [rad/s^2 or m/s^2]; a URDF has none.
        jerk: Jerk limit [rad/s^3 or m/s^3]; a URDF has none.
        scale: Commissioning factors (0, 1] on "effort", "velocity" and "acceleration".
        tool_speed: Limit on the speed of the tool centre point [m/s]; None: none.
        effort_rate: Limit on the rate of the effort [N m/s or N/s]; a URDF has none.
        velocity_by_position: Velocity limits that fall towards the ends of a joint's range: maps
            with deceleration, offset, and lower and upper where they are not the position limits,
            as in `VelocityByPosition`; None in a list: none.
        point_speed: Limits on the speed of points of the arm.
    """

    effort: NumberPerJoint = field(default_factory=dict)
    velocity: NumberPerJoint = field(default_factory=dict)
    position: Mapping[str, Range] | Sequence[Range] = field(default_factory=dict)
    acceleration: NumberPerJoint = field(default_factory=dict)
    jerk: NumberPerJoint = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    tool_speed: float | None = None
    effort_rate: NumberPerJoint = field(default_factory=dict)
    velocity_by_position: Mapping[str, Law] | Sequence[Law | None] = field(default_factory=dict)
    point_speed: Sequence[PointSpeed] = ()

    def __post_init__(self) -> None:
        _require_speed(self.tool_speed)
        for quantity in PER_JOINT:
            _require_kind(quantity, getattr(self, quantity))
        for quantity in _NUMBERS:
            for where, value in _entries(quantity, getattr(self, quantity)):
                _require_limit(where, value)
        for where, range_ in _entries("position", self.position):
            if np.shape(range_) != (2,) or not all(is_number(bound) for bound in range_):
                raise RobotError(f"{where} {shown(range_)}; give [lower, upper]")
        _require_scale(self.scale)
        points = self.point_speed
        if not isinstance(points, list | tuple) or not all(
            isinstance(point, PointSpeed) for point in points
        ):
            raise RobotError(
                f"robot.limits.point_speed is {shown(points)}; give a list of PointSpeed"
            )

    def by_name(self, quantity: str, chain: Sequence[str]) -> Mapping[str, Any]:
        """Return the limits of one quantity by joint name.

        Args:
            quantity: One of `PER_JOINT`.
            chain: The joints of the planning group, in chain order.

        Raises:
            RobotError: A list has another number of values than there are joints.
        """
        given: Any = getattr(self, quantity)
        if isinstance(given, Mapping):
            return given
        if is_number(given):
            return dict.fromkeys(chain, given)
        if len(given) != len(chain):
            alone = "one for all joints, " if quantity in _NUMBERS else ""
            raise RobotError(
                f"robot.limits.{quantity} has {len(given)} values for {len(chain)} joints; give "
                f"{alone}a map by name, or a list in the order of the chain: {', '.join(chain)}"
            )
        return {name: value for name, value in zip(chain, given, strict=True) if value is not None}


def _require_kind(quantity: str, given: Any) -> None:
    is_list = isinstance(given, list | tuple | np.ndarray) and np.ndim(given) > 0
    if not isinstance(given, Mapping) and not is_list and quantity not in _NUMBERS:
        raise RobotError(
            f"robot.limits.{quantity} is {shown(given)}; it must be a map by name, or a list with "
            "one for each joint"
        )
    if not isinstance(given, Mapping) and not is_list and not is_number(given):
        raise RobotError(
            f"robot.limits.{quantity} is {shown(given)}; it must be one number for all joints, a "
            "list with one for each, or a map by name, such as {'elbow_joint': 1.5}"
        )


def _entries(quantity: str, given: Any) -> Iterator[tuple[str, Any]]:
    """Yield the values of a quantity, each after what messages call it."""
    where = f"robot.limits.{quantity}"
    if isinstance(given, Mapping):
        yield from ((f"{where}: joint '{name}' at", value) for name, value in given.items())
    elif is_number(given):
        yield f"{where} is", given
    else:
        yield from ((f"{where}[{k}] is", value) for k, value in enumerate(given))


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
