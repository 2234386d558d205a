"""Segments of a tube that are one: on one line, and asking the same.

A point between them asks nothing, so that a tube is the same however its straight parts are
divided. Segments that were visited one after the other would ask more: the tool would have to come
near every point between them.
"""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.tube.rotational_tube import RotationalTube
from tubeplanner.tube.rotations import rotation_matrix, rotation_vector
from tubeplanner.tube.tube import Tube

_ON_LINE = 1e-9  # [m], [rad]
_HALF_TURN = np.pi - 1e-6  # [rad]: beyond it the short way round would be another one


def joined_segments(tube: Tube) -> Tube:
    """Return a tube with its segments joined where they are one; the same if none are.

    Its points keep their numbers, and `Tube.parts` is the tube given.
    """
    if tube.pass_through_points == "all":
        return tube
    firsts = [0]
    for k in range(1, tube.segment_count):
        if not _are_one(tube, firsts[-1], k):
            firsts.append(k)
    if len(firsts) == tube.segment_count:
        return tube
    kept = [*firsts, tube.segment_count]
    joined = tube.with_points(kept, firsts)
    object.__setattr__(joined, "parts", tube)
    return joined


def _are_one(tube: Tube, first: int, last: int) -> bool:
    """Return whether a segment is one with those before it, which are one from `first` on."""
    if tube.radius[last] != tube.radius[first] or tube.conditions[last] != tube.conditions[first]:
        return False
    shares = _shares_on_line(tube.points[first : last + 2])
    if shares is None:
        return False
    return tube.rotation is None or _turns_evenly(tube.rotation, first, last, shares)


def _shares_on_line(points: FloatArray) -> FloatArray | None:
    """Return where points (P, 3) are on the line from the first to the last, from 0 to 1: (P,).

    None if one is off the line or behind the one before.
    """
    axis = points[-1] - points[0]
    square = float(axis @ axis)
    if square <= _ON_LINE**2:
        return None
    shares: FloatArray = (points - points[0]) @ axis / square
    off = np.linalg.norm(points - points[0] - shares[:, None] * axis, axis=1)
    return shares if off.max() <= _ON_LINE and (np.diff(shares) > 0).all() else None


def _turns_evenly(rotation: RotationalTube, first: int, last: int, shares: FloatArray) -> bool:
    """Return whether segments turn at one rate about one axis.

    Args:
        rotation: The reference orientations.
        first: The first segment.
        last: The last one.
        shares: Of the points from the start of the first to the end of the last, shape (P,).
    """
    part = slice(first, last + 1)
    if np.linalg.norm(rotation.turn[part], axis=1).sum() >= _HALF_TURN:
        return False
    end = rotation.begin[last] @ rotation_matrix(rotation.turn[last])
    turn = rotation_vector(rotation.begin[first].T @ end)
    even = rotation.begin[first] @ rotation_matrix(shares[:-1, None] * turn)
    off = rotation_vector(even.transpose(0, 2, 1) @ rotation.begin[part])
    return bool(np.linalg.norm(off, axis=1).max() <= _ON_LINE)
