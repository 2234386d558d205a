"""Limits on a joint's velocity that fall towards the ends of its range."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.options import in_figures, is_number

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
