"""Configurations moved until the tool is where it is wanted, compiled."""

from ctypes import c_int, c_int64

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.native.library import Bytes, Doubles, native_function

_MOVE = native_function(
    "tubeplanner_move_tools",
    *(Doubles, c_int64, c_int64, Doubles, Doubles, Doubles, Doubles, c_int64),
    *(Doubles, Doubles, Doubles, Bytes, Doubles),
    returns=c_int,
)


def native_moved_tools(
    table: FloatArray,
    settings: FloatArray,
    close: FloatArray,
    joints: tuple[FloatArray, FloatArray, FloatArray],
    position: FloatArray,
    rotation: tuple[FloatArray, FloatArray, BoolArray] | None,
) -> FloatArray:
    """Return configurations (N, n) whose tools are where they are wanted, or near.

    Args:
        table: The joints that move the tool, the last body of all; see `native.kinematics`.
        settings: Of `measurement.tool_moves`, in the order in which the sources have them.
        close: How near is near enough, to a position [m] and to a rotation [rad], shape (2,).
        joints: Configurations (N, n) to start from, lower and upper bounds (n,).
        position: Wanted, shape (N, 3) [m].
        rotation: References (N, 3, 3), wanted rotation vectors (N, 3) and which of their components
            count (3,); None: any rotation.
    """
    assert _MOVE is not None
    q, lower, upper = (np.array(values, dtype=float, order="C") for values in joints)
    position = np.ascontiguousarray(position)
    wanted = (None, None, None) if rotation is None else map(np.ascontiguousarray, rotation)
    bounds = close, lower, upper
    if _MOVE(table, len(table), q.shape[1], settings, *bounds, len(q), position, *wanted, q):
        raise MemoryError
    return q
