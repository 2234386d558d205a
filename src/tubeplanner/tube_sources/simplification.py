"""Few corners of a path in space (Ramer 1972; Douglas & Peucker 1973)."""

import numpy as np

from tubeplanner.arrays import FloatArray


def simplified(points: FloatArray, deviation: float) -> list[int]:
    """Return which points to keep so that all lie within a deviation of the lines between.

    Args:
        points: Shape (N, 3), N >= 2 [m].
        deviation: [m].
    """
    kept, waiting = [0], [len(points) - 1]
    while waiting:
        middle, distance = farthest_from_line(points, kept[-1], waiting[-1])
        if distance > deviation:
            waiting.append(middle)
        else:
            kept.append(waiting.pop())
    return kept


def farthest_from_line(points: FloatArray, i: int, j: int) -> tuple[int, float]:
    """Return the point between two others that is farthest from their line, and how far [m].

    Where none is between, that is the first of the two, at distance 0.
    """
    if j - i < 2:
        return i, 0.0
    between, axis = points[i + 1 : j] - points[i], points[j] - points[i]
    share = np.clip(between @ axis / max(float(axis @ axis), 1e-300), 0.0, 1.0)
    distance = np.linalg.norm(between - share[:, None] * axis, axis=1)
    worst = int(distance.argmax())
    return i + 1 + worst, float(distance[worst])
