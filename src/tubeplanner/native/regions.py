"""Points and planes about the axes of convex regions, compiled.

Every function returns None if the library is left out.
"""

from ctypes import c_double, c_int64

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import Doubles, Integers, native_function

_away = native_function(
    *("away_from_axes", c_int64, Doubles, Doubles, Doubles, c_int64, Integers, c_double),
    *(Doubles, Doubles),
)
_slack = native_function(
    *("plane_slack", c_int64, Integers, Doubles, Doubles, Doubles, Doubles, Integers, Integers),
    *(Doubles, Doubles, Doubles, Doubles),
)


def away_from_axes(
    p: FloatArray, axes: tuple[FloatArray, FloatArray], segment: IntArray, no_length: float
) -> tuple[FloatArray, FloatArray] | None:
    """Return vectors from the nearest points of axes to points, (..., R, 3), and their lengths.

    Args:
        p: The points, shape (..., R, 3) or, for all R, (..., 1, 3) [m].
        axes: Where they begin and end, both of shape (m, 3) [m].
        segment: Whose axis is meant, shape (R,).
        no_length: Shorter axes count as points [m].
    """
    if _away is None:
        return None
    rows = len(segment)
    if rows not in (1, p.shape[-2]):  # one point for all of them
        p = np.broadcast_to(p, (*p.shape[:-2], rows, 3))
    points = np.ascontiguousarray(p, dtype=np.float64)
    away, distance = np.empty(p.shape), np.empty(p.shape[:-1])
    ends = (np.ascontiguousarray(end) for end in axes)
    of_rows = (rows, np.ascontiguousarray(segment), no_length**2)
    _away(distance.size, points, *ends, *of_rows, away, distance)
    return away, distance


def plane_slack(
    planes: tuple[IntArray, FloatArray, IntArray],
    points: FloatArray,
    axes: tuple[FloatArray, FloatArray],
    segment: IntArray,
    margin: FloatArray,
    extents: tuple[FloatArray, FloatArray],
) -> FloatArray | None:
    """Return how far behind planes points are, as a share of regions' extents, shape (P,).

    Args:
        planes: Their samples (P,), normals (P, 3), and the segments whose regions they hold too.
        points: At N samples, shape (N, 3).
        axes: Where the regions' axes begin and end, both of shape (m, 3).
        segment: The samples' own, shape (N,).
        margin: The share of the extents that stays unused, shape (N,).
        extents: How far the regions of the samples' segments, and those of the planes', reach
            beyond their axes, both of shape (P,).
    """
    if _slack is None:
        return None
    sample, normal, other = (np.ascontiguousarray(part) for part in planes)
    slack = np.empty(len(sample))
    own = [np.ascontiguousarray(part) for part in (points, *axes, segment)]
    rest = [np.ascontiguousarray(part) for part in (margin, *extents)]
    _slack(len(sample), sample, normal, *own, other, *rest, slack)
    return slack
