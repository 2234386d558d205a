"""How the speed of a point changes with an arm's path."""

import numpy as np

from tubeplanner.arrays import FloatArray

# A point's velocity at a speed of 1, (N, 3), and its derivatives by q and q', each (N, 3, n).
PointRate = tuple[FloatArray, FloatArray, FloatArray]


def speed_by_path(rate: PointRate, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how multiples of a point's speed change with q and q'; not where it rests.

    Args:
        rate: Of the point.
        scale: What its speed is multiplied by, shape (N,).

    Returns:
        Each of shape (N, n).
    """
    velocity, by_position, by_rate = rate
    size = np.linalg.norm(velocity, axis=1, keepdims=True)
    direction = velocity / np.maximum(size, np.finfo(float).tiny)
    gradient = direction * scale[:, None]
    first, second = (np.einsum("ni,nij->nj", gradient, by) for by in (by_position, by_rate))
    return first, second
