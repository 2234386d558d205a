"""Effort limits that differ by direction, or with the joint's position."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, read_only


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
