"""Convex hulls by Qhull. scipy is imported when the first is needed: never for known covers."""

from typing import TYPE_CHECKING

from tubeplanner.arrays import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull


def hull(points: FloatArray) -> "ConvexHull":
    """Return the hull of points (N, 3).

    Raises:
        QhullError: They lie in a plane, or nearly; it is a RuntimeError.
    """
    from scipy.spatial import ConvexHull

    return ConvexHull(points)


def hull_unless_flat(points: FloatArray) -> "ConvexHull | None":
    """Return the hull of points (N, 3), or None if they lie in a plane, or nearly."""
    from scipy.spatial import QhullError

    try:
        return hull(points)
    except QhullError:
        return None
