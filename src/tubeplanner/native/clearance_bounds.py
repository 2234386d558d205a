"""Lower bounds on how far pairs of convex shapes are apart in many configurations, compiled.

A table of shapes (S, 23) says where each is: its body, the first of its vertices and their number,
by how much they are grown, the radius of the bounding sphere and its centre, and the bounding box:
axes as rows, centre along these and half lengths; all in the frame of the body.
"""

from ctypes import c_double, c_int, c_int64

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import Doubles, Integers, native_function

_BOUNDS = native_function(
    "tubeplanner_clearance_bounds",
    *(Doubles, c_int64, Doubles, c_int64, Integers, Doubles, c_int64, Doubles),
    *(Doubles, Doubles, c_int64, c_int64, c_double, Doubles, Doubles),
    returns=c_int,
)


def native_clearance_bounds(
    shapes: tuple[FloatArray, FloatArray],
    pairs: IntArray,
    required: FloatArray,
    settings: FloatArray,
    poses: tuple[FloatArray, FloatArray],
    near: float,
) -> tuple[FloatArray, FloatArray]:
    """Return bounds (N, P) on clearances [m], infinite from `near` on, and each row's least (N,).

    Args:
        shapes: Their table (S, 23), and the vertices of all by coordinate, shape (3, V) [m].
        pairs: As rows of the table, shape (P, 2).
        required: The least distance of each, shape (P,) [m].
        settings: Of `measurement.clearance_bounds`, in the order in which the sources have them.
        poses: Rotations (N, B, 3, 3) and origins (N, B, 3) [m] of B bodies.
        near: From where on clearances do not matter [m].
    """
    assert _BOUNDS is not None
    table, vertices = shapes
    rotation, position = (np.ascontiguousarray(values) for values in poses)
    samples, bodies = position.shape[:2]
    bound, least = np.empty((samples, len(pairs))), np.empty(samples)
    if _BOUNDS(
        *(table, len(table), vertices, vertices.shape[1], pairs, required, len(pairs), settings),
        *(rotation, position, bodies, samples, near, bound, least),
    ):
        raise MemoryError
    return bound, least
