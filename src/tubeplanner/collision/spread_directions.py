"""Directions spread evenly over the sphere."""

import numpy as np

from tubeplanner.arrays import FloatArray


def spread_directions(count: int) -> FloatArray:
    """Return unit vectors along a spiral by the golden angle, shape (count, 3)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    wide = np.sqrt(1 - z * z)
    return np.column_stack([wide * np.cos(turn), wide * np.sin(turn), z])
