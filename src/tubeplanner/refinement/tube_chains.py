"""Which tube segments make up a phase: one, or a chain of short ones that turn little.

A switching time is a variable, and its phase needs knots of its own. Of hundreds of short segments,
as paths from scans and drawings have them, only sharp corners are worth that, and where the
conditions on the joints or on the rotation change, or a point is compulsory. Between them lie
chains: there the segment of a sample follows from where the tool is.
"""

from itertools import pairwise

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.polyline import arc_lengths
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.tube.tube import Tube

# What a chain ignores of a corner, in radii: the sag of the path there over one spacing of samples,
# of which there are about this many.
_SAMPLES = 200
_KINK = 0.02
# Up to so many corners all end a phase; of more, only the sharper ones, and at most so many.
_MANY_CORNERS, _SHARP_KINK, _MOST_SHARP = 12, 0.1, 100
# A turn counts as far as the path turns over so many radii on both sides: noise turns back at once.
_WINDOW = 3.0


def tube_chains(problem: PlanningProblem) -> tuple[range, ...]:
    """Return the segments of every phase: one after the other, all of the tube's."""
    is_end = _is_corner(problem.tube) | _conditions_change(problem.tube)
    is_end[problem.tube.compulsory_points - 1] = True
    ends = 1 + np.flatnonzero(is_end)
    bounds = [0, *ends.tolist(), problem.tube.segment_count]
    return tuple(range(begin, end) for begin, end in pairwise(bounds))


def largest_kink(tube: Tube, chains: tuple[range, ...], spacing: float) -> float:
    """Return how far a path leaves the chains' capsules between samples inside, at most, in radii.

    On the inner side of a corner the tool is farthest from both legs where it passes from one to
    the other.

    Args:
        tube: The tube.
        chains: The segments of every phase.
        spacing: Of the samples along the path [m].
    """
    inner = np.ones(tube.segment_count - 1, dtype=bool)
    inner[[chain.stop - 1 for chain in chains[:-1]]] = False
    return float(_kinks(tube, spacing, _turns(tube))[inner].max(initial=0.0))


def sharpest_bend(tube: Tube, chains: tuple[range, ...] = ()) -> float:
    """Return by how much a path turns over the length of a radius, at most [rad].

    To and fro count as one: it is the inverse of the radius of curvature, in radii, or noise.

    Args:
        tube: The tube.
        chains: The segments of every phase, if only what lies within counts.
    """
    turns = _turns(tube)
    turns[[chain.stop - 1 for chain in chains[:-1]]] = 0.0
    so_far = np.concatenate([[0.0], np.cumsum(turns)])
    along, radius = arc_lengths(tube.points)[1:-1], tube.effective_radius
    half = np.minimum(radius[:-1], radius[1:]) / 2
    last = np.searchsorted(along, along + half, side="right")
    first = np.searchsorted(along, along - half)
    return float((so_far[last] - so_far[first]).max(initial=0.0))


def smoothed_turns(tube: Tube) -> FloatArray:
    """Return the angles by which the path turns over some radii, shape (m-1,) [rad]."""
    points, along = tube.points, arc_lengths(tube.points)
    radius = tube.effective_radius
    window = _WINDOW * np.maximum(np.minimum(radius[:-1], radius[1:]), _spacing(tube))
    before, after = (
        np.column_stack([np.interp(s, along, column) for column in points.T])
        for s in (along[1:-1] - window, along[1:-1] + window)
    )
    return _angles(points[1:-1] - before, after - points[1:-1])


def _is_corner(tube: Tube) -> BoolArray:
    """Return whether each inner reference point is a corner that ends a phase, shape (m-1,)."""
    kinks = _kinks(tube, _spacing(tube), np.minimum(_turns(tube), smoothed_turns(tube)))
    is_corner: BoolArray = kinks >= (_KINK if len(kinks) > _MANY_CORNERS else 0.0)
    if is_corner.sum() > _MANY_CORNERS:
        is_corner = kinks >= _SHARP_KINK
        is_corner[np.argsort(-kinks, kind="stable")[_MOST_SHARP:]] = False
    return is_corner


def _conditions_change(tube: Tube) -> BoolArray:
    """Return where the conditions on the arm are others, shape (m-1,)."""
    return np.array([before != after for before, after in pairwise(tube.conditions)], dtype=bool)


def _spacing(tube: Tube) -> float:
    """Return about how far apart samples are [m]."""
    return float(arc_lengths(tube.points)[-1]) / _SAMPLES


def _kinks(tube: Tube, spacing: float, turn: FloatArray) -> FloatArray:
    """Return how far samples cut the inner reference points, in radii, shape (m-1,).

    A chord of a length d over a turn by a small angle passes it at d / 4 times the angle, at most.
    """
    length = np.linalg.norm(np.diff(tube.points, axis=0), axis=1)
    chord = np.minimum(spacing, np.minimum(length[:-1], length[1:]))
    radius = tube.effective_radius
    kinks: FloatArray = chord * turn / 4 / np.minimum(radius[:-1], radius[1:])
    return kinks


def _turns(tube: Tube) -> FloatArray:
    """Return the angles by which the path turns at inner reference points, shape (m-1,) [rad]."""
    axis = np.diff(tube.points, axis=0)
    return _angles(axis[:-1], axis[1:])


def _angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angles between vectors, each (N, 3): shape (N,) [rad]."""
    across = np.linalg.norm(np.cross(a, b), axis=1)
    angles: FloatArray = np.arctan2(across, np.einsum("ni,ni->n", a, b))
    return angles
