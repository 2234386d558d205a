"""Configurations in which the tool has given positions and rotations, compiled."""

from ctypes import c_int, c_int64

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.native.library import Bytes, Doubles, native_function

_SOLVE = native_function(
    "tubeplanner_solve_positions",
    *(Doubles, c_int64, c_int64, Doubles, c_int64),
    *(Doubles, Doubles, Doubles, Doubles, Doubles, Doubles, Doubles, Bytes, Doubles, Doubles),
    returns=c_int,
)


def native_solve_positions(
    table: FloatArray,
    settings: FloatArray,
    position: FloatArray,
    joints: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    rotation: tuple[FloatArray, FloatArray, BoolArray] | None,
) -> tuple[FloatArray, FloatArray]:
    """Return configurations (N, n) and their errors (N, 2), of position [m] and rotation [rad].

    Without the axis of N there is one of each.

    Args:
        table: The joints that move the tool, the last body of all; see `native.kinematics`.
        settings: Of `branches.inverse_kinematics`, in the order in which the sources have them.
        position: Wanted, shape (N, 3) [m].
        joints: Seeds, lower bounds, upper bounds and preferred configurations, each (N, n).
        rotation: References (N, 3, 3), wanted rotation vectors (N, 3) and which of their components
            count (N, 3); None: any rotation.
    """
    assert _SOLVE is not None
    *many, joint_count = joints[0].shape
    count = many[0] if many else 1
    q, errors = np.empty((*many, joint_count)), np.empty((*many, 2))
    given = [np.ascontiguousarray(values, dtype=np.float64) for values in (position, *joints)]
    turned: tuple[FloatArray | BoolArray | None, ...] = (None, None, None)
    if rotation is not None:
        reference, vector, components = rotation
        turned = np.ascontiguousarray(reference), np.ascontiguousarray(vector, dtype=np.float64)
        turned = *turned, np.ascontiguousarray(components)
    if _SOLVE(table, len(table), joint_count, settings, count, *given, *turned, q, errors):
        raise MemoryError
    return q, errors
