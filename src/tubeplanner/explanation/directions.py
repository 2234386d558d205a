"""Directions in which something may be moved, in words and as vectors."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.explanation.change import exact

AXES: tuple[tuple[str, FloatArray], ...] = tuple(
    (f"in {sign}{axis}", factor * np.eye(3)[k])
    for k, axis in enumerate("xyz")
    for sign, factor in (("+", 1.0), ("-", -1.0))
)


def along(position: FloatArray, way: FloatArray, size: float) -> list[float]:
    """Return a position (3,) moved along a unit vector by a size [m]."""
    return [exact(value) for value in (np.asarray(position) + size * way).tolist()]
