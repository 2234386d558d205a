"""From where to look: a direction in which the tool's path is spread out and not hidden."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.views.surface import shape_points

_CELLS = 8  # at most, along the longer side of what the grid is under
# Never along an axis of the base: walls and shelves seen edge on look like nothing.
_AZIMUTHS = np.radians([25.0, -25.0, 65.0, -65.0, 115.0, -115.0, 155.0, -155.0])
# Views from higher up show less of what an arm does, unless it moves in a plane.
_ELEVATIONS = ((0.35, 1.0), (0.6, 0.95), (1.1, 0.92))
_FLAT = 0.02  # of the longest side


def best_direction(
    path: FloatArray, solids: Sequence[ConvexShape], arms: Sequence[Sequence[ConvexShape]] = ()
) -> FloatArray:
    """Return the unit vector (3,) from the path towards the viewer, never from below.

    Args:
        path: Where the tool passes, shape (N, 3) [m].
        solids: Solids that may hide the path, in the base frame; they count as translucent.
        arms: Hulls that hide the path at some times, one after the other; they count as opaque.
    """
    standing = _hulls(solids)
    moving = [_hulls(arm) for arm in arms]
    scored = []
    for elevation, weight in _ELEVATIONS:
        for azimuth in _AZIMUTHS:
            flat = np.cos(elevation)
            direction = np.array(
                [flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)]
            )
            seen = 0.5 + 0.5 * _visible_share(path, direction, standing)
            if moving:
                shares = [_visible_share(path, direction, hulls) for hulls in moving]
                seen *= sum(shares) / len(shares)
            scored.append((weight * seen * _spread(path, direction), direction))
    return max(scored, key=lambda pair: pair[0])[1]


def _hulls(shapes: Sequence[ConvexShape]) -> list[ConvexHull]:
    return [ConvexHull(shape_points(shape)) for shape in shapes]


def _spread(path: FloatArray, direction: FloatArray) -> float:
    """Return how far apart a path's points look: its extent along and, twice, across."""
    offset = path - path.mean(axis=0)
    seen = offset - np.outer(offset @ direction, direction)
    major, minor = np.sqrt(abs(np.linalg.eigvalsh(seen.T @ seen))[:0:-1])
    return float(major + 2 * minor)


def _visible_share(path: FloatArray, direction: FloatArray, hulls: Sequence[ConvexHull]) -> float:
    """Return which share of a path is not behind a hull, seen from far away."""
    hidden = np.zeros(len(path), dtype=bool)
    for hull in hulls:
        normal, offset = hull.equations[:, :3], hull.equations[:, 3]
        # Along the line of sight p + s direction every face bounds s from one side.
        height, slope = path @ normal.T + offset, normal @ direction
        with np.errstate(divide="ignore", invalid="ignore"):
            s = -height / slope
        first = np.where(slope < 0, s, -np.inf).max(axis=1)
        last = np.where(slope > 0, s, np.inf).min(axis=1)
        beside = ((slope == 0) & (height > 0)).any(axis=1)
        hidden |= (np.maximum(first, 0.0) < last) & ~beside
    return float(1 - hidden.mean())


def outline(points: FloatArray) -> FloatArray:
    """Return the few of points (N, 3) that a picture must hold for all to be in it."""
    low, high = points.min(axis=0), points.max(axis=0)
    if (high - low).min() < _FLAT * (high - low).max():
        corners = np.meshgrid(*np.column_stack([low, high]))
        return np.stack(corners, axis=-1).reshape(-1, 3)
    return points[ConvexHull(points).vertices]


def floor_grid(points: FloatArray) -> tuple[FloatArray, float]:
    """Return a grid under points (N, 3), at height 0 or lower: its edges, and their length.

    Returns:
        Ends of edges, shape (E, 2, 3) [m], and the length 0.1, 0.5, 1, 5, ... [m].
    """
    size = float(np.ptp(points[:, :2], axis=0).max())
    step = next(s for k in range(-1, 9) for s in (10.0**k, 5 * 10.0**k) if size <= _CELLS * s)
    low = np.floor(points[:, :2].min(axis=0) / step) - 1
    high = np.ceil(points[:, :2].max(axis=0) / step) + 1
    x, y = (np.arange(a, b + 1) for a, b in zip(low, high, strict=True))
    height = np.full((len(y), len(x)), min(0.0, float(points[:, 2].min())))
    nodes = np.stack([*(step * line for line in np.meshgrid(x, y)), height], axis=-1)
    # Edge by edge: lines that pass behind the eye are dropped whole by some renderers.
    rows = np.stack([nodes[:, :-1], nodes[:, 1:]], axis=2).reshape(-1, 2, 3)
    columns = np.stack([nodes[:-1], nodes[1:]], axis=2).reshape(-1, 2, 3)
    return np.vstack([rows, columns]), step
