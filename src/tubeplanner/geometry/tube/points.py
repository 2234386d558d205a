"""Reference points: polylines, corner reduction, checks, repetitions, compulsory points."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.errors import ProblemError, shown


def arc_lengths(points: FloatArray) -> FloatArray:
    """Return arc lengths along straight lines up to each of P points (P, d), from 0: shape (P,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def densified(points: FloatArray, max_step: float) -> FloatArray:
    """Return points (P, d) with evenly spaced points inserted, so that no coordinate steps too far.

    Args:
        points: Shape (P, d).
        max_step: In any coordinate, in the unit of the points.
    """
    parts = [points[:1]]
    for begin, end in pairwise(points):
        steps = max(1, int(np.ceil(abs(end - begin).max() / max_step)))
        fraction = np.linspace(0, 1, steps + 1)[1:, None]
        parts.append((1 - fraction) * begin + fraction * end)
    return np.concatenate(parts)


def simplified(points: FloatArray, deviation: float) -> list[int]:
    """Return the points to keep so that all lie within a deviation of the lines between.

    Ramer 1972; Douglas & Peucker 1973.

    Args:
        points: Shape (N, 3), N >= 2 [m].
        deviation: [m].
    """
    corners, waiting = [0], [len(points) - 1]
    while waiting:
        middle, distance = farthest_from_line(points, corners[-1], waiting[-1])
        if distance > deviation:
            waiting.append(middle)
        else:
            corners.append(waiting.pop())
    return corners


def farthest_from_line(points: FloatArray, i: int, j: int) -> tuple[int, float]:
    """Return the point between two others that is farthest from their line, and its distance [m].

    Without points between, the first of the two, at distance 0.
    """
    if j - i < 2:
        return i, 0.0
    between, axis = points[i + 1 : j] - points[i], points[j] - points[i]
    fraction = np.clip(between @ axis / max(float(axis @ axis), 1e-300), 0.0, 1.0)
    distance = np.linalg.norm(between - fraction[:, None] * axis, axis=1)
    worst = int(distance.argmax())
    return i + 1 + worst, float(distance[worst])


# ---- Reference points that repeat their predecessor: left out, with the segment to them.

MIN_LENGTH = 1e-6  # [m]: reference points nearer to each other are the same; no radius is less
_SAME_ORIENTATION = 1e-6  # [rad]


@dataclass(frozen=True, eq=False)
class DistinctPoints:
    """The remaining points and segments.

    Attributes:
        points: Indices of the points, shape (m+1,).
        segments: Indices of the segments that end at them, shape (m,).
        dropped: Indices of the points left out.
    """

    points: IntArray
    segments: IntArray
    dropped: IntArray


def distinct_points(
    points: FloatArray, values: Sequence[object], angles: FloatArray | None
) -> DistinctPoints:
    """Return the points that are apart from their predecessors.

    Args:
        points: Reference points, shape (m+1, 3) [m].
        values: Conditions of each of m segments, to be compared.
        angles: Rotation of the reference orientation in each segment, shape (m,) [rad]; None: it is
            free.

    Raises:
        ProblemError: All points are the same, or a segment of no length has conditions that neither
            of its neighbours has, so that they would be lost.
    """
    rows = [0]
    for k in range(1, len(points)):
        if np.linalg.norm(points[k] - points[rows[-1]]) >= MIN_LENGTH:
            rows.append(k)
    if len(rows) < 2:
        raise ProblemError(
            f"tube.points: points 0 and {len(points) - 1} are the same within {MIN_LENGTH:g} m, "
            "and so are all between; at least two points that are apart are needed"
        )
    remaining = np.array(rows)
    dropped = np.setdiff1d(np.arange(len(points)), remaining)
    for k in dropped.tolist():
        lost, segments = k - 1, remaining[1:] - 1
        after = int(np.searchsorted(segments, lost))
        beside = [int(segments[i]) for i in (after - 1, after) if 0 <= i < len(segments)]
        same = f"tube.points: points {lost} and {k} are the same within {MIN_LENGTH:g} m"
        if all(values[lost] != values[i] for i in beside):
            neighbours = " and ".join(str(i) for i in beside)
            raise ProblemError(
                f"{same}; segment {lost} between them would be left out, but its radius, joint "
                "signs, tolerances or speed are those of neither segment beside it "
                f"({neighbours}): remove one of the points, or give them what a neighbour has"
            )
        if angles is not None and angles[lost] > _SAME_ORIENTATION:
            raise ProblemError(
                f"{same}, but tube.orientations turn by {angles[lost]:.3g} rad between them: a "
                "tool cannot turn on the spot here; move one of the points, or give "
                "both one orientation"
            )
    return DistinctPoints(remaining, remaining[1:] - 1, dropped)


# ---- Reference points and radii of a tube, checked.

MAX_EXTENT = 1e4  # [m]


def given_points(points: Sequence[Sequence[float]] | FloatArray) -> FloatArray:
    """Return reference points (m+1, 3) [m].

    Raises:
        ProblemError: The points are no points, fewer than two, or too far away.
    """
    try:
        corners = read_only(points)
    except (TypeError, ValueError):
        raise ProblemError(f"tube.points: {shown(points)} is no list of points [x, y, z]") from None
    if corners.ndim != 2 or corners.shape[0] < 2 or corners.shape[1] != 3:
        raise ProblemError(
            f"tube.points has shape {corners.shape}; at least two points [x, y, z] are needed"
        )
    if not (abs(corners) <= MAX_EXTENT).all():
        raise ProblemError(f"tube.points must be finite numbers within {MAX_EXTENT:g} m")
    return corners


def given_radii(radius: float | Sequence[float] | FloatArray, segments: int) -> FloatArray:
    """Return the radius of each segment, (m,) [m].

    Args:
        radius: A radius for all segments, or a radius each.
        segments: Number m of segments.

    Raises:
        ProblemError: A count or a number is wrong.
    """
    try:
        radii = read_only(radius)
    except (TypeError, ValueError):
        raise ProblemError(f"tube.radius {shown(radius)} is no number or list of numbers") from None
    if radii.ndim == 0:
        radii = np.full(segments, float(radii))
    if radii.shape != (segments,):
        raise ProblemError(
            f"tube.radius has {radii.size} values for {segments} segments; give one, or one each"
        )
    for k, value in enumerate(radii):
        if not MIN_LENGTH <= value <= MAX_EXTENT:
            raise ProblemError(
                f"tube.radius[{k}] is {value:g} m; it must be from {MIN_LENGTH:g} to "
                f"{MAX_EXTENT:g} m"
            )
    return read_only(radii)


# ---- Compulsory reference points: those at which the tube turns back.
#
# Where a tube turns back on itself, the capsules before and after the point overlap: a tool could
# turn round long before the point and still be in both.

PASS_THROUGH = ("all", "corners", "none")
_TURNS_BACK = np.radians(150)
# Points nearer than this fraction of the radius are skipped when a turn is measured: a finely
# divided corner is a corner.
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
    back = [k for k in inner.tolist() if angle_at(points, k, close[k]) > _TURNS_BACK]
    # Close points one after the other are a single corner: its sharpest point counts.
    steps = np.append(0.0, np.linalg.norm(np.diff(points, axis=0), axis=1))
    starts = [k for k in back if k - 1 not in back or steps[k] > close[k]]
    corners = [
        [k for k in back if begin <= k < end] for begin, end in pairwise([*starts, len(points)])
    ]
    sharpest = [max(corner, key=lambda k: angle_at(points, k, 0.0)) for corner in corners]
    return np.array(sharpest, dtype=np.int64)


def passing_radius(radius: FloatArray) -> FloatArray:
    """Return the passing distance of inner points, the smaller radius beside them, (m-1,) [m]."""
    return np.minimum(radius[:-1], radius[1:])


def angle_at(points: FloatArray, k: int, close: float) -> float:
    """Return the turn of a path at inner point k [rad], from 0 to pi.

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
