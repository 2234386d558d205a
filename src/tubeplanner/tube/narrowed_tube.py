"""Tubes that lie inside others by given distances and angles."""

from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.tube.rotational_tube import RotationBound
from tubeplanner.tube.tube import Tube


def narrowed_tube(tube: Tube, by: FloatArray, turned: FloatArray) -> Tube:
    """Return a tube whose every tool position is inside another by given distances.

    Args:
        tube: The other tube.
        by: What is taken off radii, and off boxes at every side, shape (m,) [m].
        turned: What is taken off rotation tolerances, shape (m,) [rad].

    Raises:
        ProblemError: Nothing is left of a radius or of a tolerance.
    """
    tolerance, sections = tube.rotation_tolerance, tube.cross_section
    if tolerance is not None:
        tolerance = tuple(map(_narrowed_bound, tolerance, turned.tolist()))
    if sections is None:
        return replace(tube, radius=tube.radius - by, rotation_tolerance=tolerance)
    taken = np.zeros_like(sections)
    taken[:, :2] = 2 * by[:, None]
    sections = np.where(tube.is_box[:, None], sections - taken, sections)
    sides = sections[:, :2].min(axis=1)
    radius = np.where(tube.is_box, sides / 2, tube.radius - by)
    return replace(tube, radius=radius, rotation_tolerance=tolerance, cross_section=sections)


def _narrowed_bound(bound: RotationBound, by: float) -> RotationBound:
    if isinstance(bound, int | float):
        return bound - by
    x, y, z = bound
    return x - by, y - by, z - by
