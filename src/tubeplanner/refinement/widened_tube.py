"""A tube as wide as knots are coarse: a few cubics cannot follow a narrow one, and need not yet."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.refinement.phased_spline import KnotGrid
from tubeplanner.tube.tube import Tube

# The radius is at least this share of a knot interval's part of the segment.
_INTERVAL_SHARE = 0.2
# At a corner it is at most this share of what touches both legs at the end of the shorter one.
_CORNER_SHARE = 0.1


def widened_radius(tube: Tube, grid: KnotGrid) -> FloatArray:
    """Return radii (m,) [m] of a tube that splines on some knots can follow.

    Where the tube turns sharply it is hardly widened: else the spline would leave out the turn.
    """
    axis = np.diff(tube.points, axis=0)
    length = np.linalg.norm(axis, axis=1)
    interval = [
        length[chain.start : chain.stop].sum() / (len(shares) - 1)
        for chain, shares in zip(grid.chains, grid.shares, strict=True)
    ]
    interval_of = np.repeat(interval, [len(chain) for chain in grid.chains])
    widest = np.append(np.append(np.inf, _corner_radius(axis, length)), np.inf)
    widest = np.minimum(widest[:-1], widest[1:])
    wanted = np.minimum(_INTERVAL_SHARE * interval_of, widest)
    widened: FloatArray = np.maximum(tube.effective_radius, wanted)
    return widened


def _corner_radius(axis: FloatArray, length: FloatArray) -> FloatArray:
    """Return what the corners between segments (m, 3) allow, shape (m-1,) [m].

    A circle that touches both legs at a distance d from the corner has the radius d tan(phi / 2),
    phi being the angle between the legs.
    """
    along = axis / length[:, None]
    cosine = -np.einsum("mi,mi->m", along[:-1], along[1:])  # of the angle between the legs
    with np.errstate(divide="ignore"):
        tangent = np.sqrt(np.clip(1 - cosine, 0, None) / np.clip(1 + cosine, 0, None))
    radius: FloatArray = _CORNER_SHARE * np.minimum(length[:-1], length[1:]) * tangent
    return radius
