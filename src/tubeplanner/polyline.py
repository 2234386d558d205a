"""Points joined by straight lines: arc length along them, and points between."""

from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray


def arc_lengths(points: FloatArray) -> FloatArray:
    """Return the arc length up to each of P points (P, d): shape (P,), from 0, in their unit."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def densified(points: FloatArray, max_step: float) -> FloatArray:
    """Return points (P, d) with others evenly between them: no coordinate steps farther.

    Args:
        points: Shape (P, d).
        max_step: In any coordinate, in the unit of the points.
    """
    parts = [points[:1]]
    for begin, end in pairwise(points):
        steps = max(1, int(np.ceil(abs(end - begin).max() / max_step)))
        share = np.linspace(0, 1, steps + 1)[1:, None]
        parts.append((1 - share) * begin + share * end)
    return np.concatenate(parts)
