"""Which reference points the tool must pass: those at which the tube turns back.

Where a tube turns back on itself, the capsules before and after the point overlap along the way: a
tool could turn round long before the point and still be in both.
"""

from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray

PASS_THROUGH = ("all", "corners", "none")
_TURNS_BACK = np.radians(150)
# Points nearer than this share of the radius are skipped when a turn is measured: a corner that is
# divided closely is a corner.
_CLOSE = 0.1


def compulsory_points(points: FloatArray, radius: FloatArray, rule: str) -> IntArray:
    """Return the indices of the inner points that must be passed.

    Args:
        points: Reference points, shape (m+1, 3) [m].
        radius: Of the segments, shape (m,) [m].
        rule: One of `PASS_THROUGH`.
    """
    inner = np.arange(1, len(points) - 1)
    if rule == "all":
        return inner
    if rule == "none":
        return inner[:0]
    close = np.append(0.0, _CLOSE * passing_radius(radius))
    back = [k for k in inner.tolist() if turn_at(points, k, close[k]) > _TURNS_BACK]
    # One after the other, and close, they are one corner: its sharpest point counts.
    steps = np.append(0.0, np.linalg.norm(np.diff(points, axis=0), axis=1))
    starts = [k for k in back if k - 1 not in back or steps[k] > close[k]]
    corners = [
        [k for k in back if begin <= k < end] for begin, end in pairwise([*starts, len(points)])
    ]
    sharpest = [max(corner, key=lambda k: turn_at(points, k, 0.0)) for corner in corners]
    return np.array(sharpest, dtype=np.int64)


def passing_radius(radius: FloatArray) -> FloatArray:
    """Return how near inner points must be passed: the smaller radius beside them, (m-1,) [m]."""
    return np.minimum(radius[:-1], radius[1:])


def turn_at(points: FloatArray, k: int, close: float) -> float:
    """Return by how much a path turns at inner point k [rad], from 0 to pi.

    Args:
        points: Shape (m+1, 3) [m].
        k: Index of the point.
        close: Nearer points than this [m] are skipped, unless there are no others.
    """
    before = _direction(points[k], points[k - 1 :: -1], close)
    after = _direction(points[k], points[k + 1 :], close)
    return float(np.arctan2(np.linalg.norm(np.cross(before, after)), -before @ after))


def _direction(point: FloatArray, others: FloatArray, close: float) -> FloatArray:
    """Return the unit vector to the first of other points that is not close, or to the last."""
    for other in others:
        away = other - point
        if np.linalg.norm(away) > close:
            break
    away = away if np.any(away) else others[0] - point
    direction: FloatArray = away / np.linalg.norm(away)
    return direction
