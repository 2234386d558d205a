"""Directions that separate two convex shapes, in many configurations at once."""

import numpy as np

from tubeplanner.arrays import FloatArray

_NO_LENGTH = 1e-9  # [m]


def separating_directions(
    first: FloatArray,
    second: FloatArray,
    turned: FloatArray,
    moved: FloatArray,
    gap: FloatArray,
    *,
    max_steps: int,
    enough: float = np.inf,
    loose: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return how far apart the hulls of two sets of points are, and along which directions.

    Gilbert's iteration ("An iterative procedure for computing the minimum of a quadratic form on a
    convex set", 1966) towards the shortest vector between both hulls, on all configurations
    together; each ends as soon as it has enough.

    Args:
        first: Points of the first set, shape (V, 3) [m].
        second: Points of the second set, in its frame, shape (W, 3) [m].
        turned: Rotations of the first set into the frame of the second, shape (N, 3, 3).
        moved: Where the origin of the first set then is, shape (N, 3) [m].
        gap: From any point of the first hull to any of the second, to begin with, (N, 3) [m].
        max_steps: Of the iteration.
        enough: A distance beyond which it does not matter [m].
        loose: By how much distances may fall short of what they could be [m].

    Returns:
        Distances (N,) [m], never above the true ones, except by rounding, and unit vectors (N, 3)
        from the first towards the second hull, in the frame of the second. Where hulls overlap a
        distance is negative, and says nothing about the depth.
    """
    bound, found = np.full(len(gap), -np.inf), np.zeros_like(gap)
    live, known = np.arange(len(gap)), np.full(len(gap), np.inf)
    for _ in range(max_steps):
        length = np.linalg.norm(gap, axis=1)
        unsettled = (length > _NO_LENGTH) & (bound[live] < np.minimum(enough, known - loose))
        live, gap, length = live[unsettled], gap[unsettled], length[unsettled]
        known = length
        if len(live) == 0:
            break
        direction = gap / length[:, None]
        local = np.einsum("nij,ni->nj", turned[live], direction)
        support = first[(local @ first.T).argmax(axis=1)]
        behind = second[(direction @ second.T).argmin(axis=1)]
        end = behind - moved[live] - np.einsum("nij,nj->ni", turned[live], support)
        apart = np.sum(direction * end, axis=1)
        better = apart > bound[live]
        bound[live[better]], found[live[better]] = apart[better], direction[better]
        gap = _nearest_to_origin(gap, end)
    return bound, found


def _nearest_to_origin(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the points of straight lines between points (N, 3) that are nearest to the origin."""
    edge = end - start
    squared = np.maximum(np.sum(edge**2, axis=1), _NO_LENGTH**2)
    share = np.clip(-np.sum(start * edge, axis=1) / squared, 0.0, 1.0)
    return start + share[:, None] * edge
