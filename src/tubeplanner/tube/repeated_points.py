"""Reference points that repeat the one before: they are left out, with the segment to them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.errors import ProblemError

MIN_LENGTH = 1e-6  # [m]: reference points nearer to each other are the same; no radius is less
_SAME_ORIENTATION = 1e-6  # [rad]


@dataclass(frozen=True, eq=False)
class DistinctPoints:
    """Which points and segments are left.

    Attributes:
        points: Indices of the points, shape (m+1,).
        segments: Indices of the segments that end at them, shape (m,).
        dropped: Indices of the points left out.
    """

    points: IntArray
    segments: IntArray
    dropped: IntArray


def distinct_points(
    points: FloatArray, asked: Sequence[object], turn: FloatArray | None
) -> DistinctPoints:
    """Return the points that are apart from the one before.

    Args:
        points: Reference points, shape (m+1, 3) [m].
        asked: What each of m segments asks, to be compared.
        turn: How far the reference orientation turns in each segment, shape (m,) [rad]; None: it
            is free.

    Raises:
        ProblemError: All points are the same, or a segment of no length asks what neither of its
            neighbours does, so that it would be lost.
    """
    kept = [0]
    for k in range(1, len(points)):
        if np.linalg.norm(points[k] - points[kept[-1]]) >= MIN_LENGTH:
            kept.append(k)
    if len(kept) < 2:
        raise ProblemError(
            f"tube.points: points 0 and {len(points) - 1} are the same within {MIN_LENGTH:g} m, "
            "and so are all between; at least two points that are apart are needed"
        )
    found = np.array(kept)
    dropped = np.setdiff1d(np.arange(len(points)), found)
    for k in dropped.tolist():
        _require_nothing_lost(k, found[1:] - 1, asked, turn)
    return DistinctPoints(found, found[1:] - 1, dropped)


def _require_nothing_lost(
    point: int, segments: IntArray, asked: Sequence[object], turn: FloatArray | None
) -> None:
    """Raise if the segment to a point that is left out asks what no segment beside it does."""
    lost = point - 1
    after = int(np.searchsorted(segments, lost))
    beside = [int(segments[k]) for k in (after - 1, after) if 0 <= k < len(segments)]
    same = f"tube.points: points {lost} and {point} are the same within {MIN_LENGTH:g} m"
    if all(asked[lost] != asked[k] for k in beside):
        raise ProblemError(
            f"{same}; segment {lost} between them would be left out, but its radius, joint signs, "
            f"tolerances or speed are those of neither segment beside it ({_listed(beside)}): "
            "remove one of the points, or give them what a neighbour has"
        )
    if turn is not None and turn[lost] > _SAME_ORIENTATION:
        raise ProblemError(
            f"{same}, but tube.orientations turn by {turn[lost]:.3g} rad between them: a tool "
            "cannot turn on the spot here; move one of the points, or give both one orientation"
        )


def _listed(segments: Sequence[int]) -> str:
    return " and ".join(str(k) for k in segments)
