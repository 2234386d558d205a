"""Reference points and radii of a tube, once they are what they must be."""

from collections.abc import Sequence

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import ProblemError, shown
from tubeplanner.tube.repeated_points import MIN_LENGTH

MAX_EXTENT = 1e4  # [m]


def given_points(points: Sequence[Sequence[float]] | FloatArray) -> FloatArray:
    """Return reference points (m+1, 3) [m].

    Raises:
        ProblemError: They are no points, fewer than two, or too far away.
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
        radius: One for all segments, or one each.
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
