"""Effort limits that differ by direction, or with the joint's position."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import RobotError, shown, unknown_name
from tubeplanner.options import in_figures, is_number

_KEYS = ("position", "effort")
_LEAST, _MOST = 1e-6, 1e9  # efforts that make sense [N m or N]


@dataclass(frozen=True, eq=False)
class EffortRange:
    """What the motor of one joint has each way: linear between positions, constant beyond them.

    Attributes:
        joint: Index of the joint in the group.
        position: Increasing, shape (K,) [rad or m].
        backwards: The most against the joint's direction at these positions, > 0, shape (K,)
            [N m or N].
        forwards: The most along it, likewise.
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
        """The most at any position and in any direction [N m or N]."""
        return float(max(self.backwards.max(), self.forwards.max()))

    @property
    def is_constant(self) -> bool:
        """Whether it is the same everywhere and both ways."""
        return bool((self.backwards == self.most).all() and (self.forwards == self.most).all())

    def scaled(self, factor: float) -> "EffortRange":
        """Return a share of it."""
        return EffortRange(
            self.joint, self.position, factor * self.backwards, factor * self.forwards
        )

    def side(self, way: float) -> FloatArray:
        """Return the most along (1) or against (-1) the joint's direction, shape (K,)."""
        return self.forwards if way > 0 else self.backwards

    def allowed(self, q: FloatArray, way: float) -> FloatArray:
        """Return that at positions of the joint, shape (N,)."""
        return np.interp(q, self.position, self.side(way))

    def slope(self, q: FloatArray, way: float) -> FloatArray:
        """Return how that changes with the position, shape (N,); at a corner, as it does beyond."""
        slopes = np.diff(self.side(way)) / np.diff(self.position)
        between = np.concatenate([[0.0], slopes, [0.0]])
        return between[np.searchsorted(self.position, q, side="right")]


def effort_range(joint: int, given: Any) -> EffortRange:
    """Return the limit of one joint that differs by direction, or with its position.

    Args:
        joint: Index of the joint in the group.
        given: As `require_effort_range` has it.
    """
    if isinstance(given, Mapping):
        return EffortRange(joint, given["position"], given["effort"], given["effort"])
    backwards, forwards = given
    return EffortRange(joint, np.zeros(1), np.array([backwards]), np.array([forwards]))


def require_effort_range(where: str, given: Any) -> None:
    """Raise unless a limit is [backwards, forwards], or a map with positions and efforts there.

    Args:
        where: What messages call it.
        given: The limit.

    Raises:
        RobotError: It is neither, a magnitude is out of its bounds, or positions do not increase.
    """
    if not isinstance(given, Mapping):
        if not _is_list(given) or len(given) != 2:
            raise RobotError(
                f"{where} {shown(given)}; give a number from {_LEAST:g} to {_MOST:g}, [backwards, "
                "forwards], or a map with position and effort"
            )
        return _require_magnitudes(where, given)
    for key in given:
        if key not in _KEYS:
            raise RobotError(f"{where} {shown(given)}: {unknown_name('key', key, _KEYS)}")
    position, effort = given.get("position", ()), given.get("effort", ())
    if not _is_list(position) or not _is_list(effort) or not 0 < len(position) == len(effort):
        raise RobotError(
            f"{where} {shown(given)}; give as many numbers in position as in effort, at least one"
        )
    if not all(is_number(q) and np.isfinite(q) for q in position) or any(np.diff(position) <= 0):
        raise RobotError(f"{where} position {shown(position)}; give finite numbers that increase")
    return _require_magnitudes(f"{where} effort", effort)


def _is_list(given: Any) -> bool:
    return isinstance(given, list | tuple) or (isinstance(given, np.ndarray) and given.ndim == 1)


def _require_magnitudes(where: str, given: Any) -> None:
    for value in given:
        if not is_number(value) or not _LEAST <= value <= _MOST:
            raise RobotError(
                f"{where} {shown(given)} has {in_figures(value)}; give magnitudes from {_LEAST:g} "
                f"to {_MOST:g}"
            )
