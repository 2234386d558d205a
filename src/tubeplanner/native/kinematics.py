"""Poses and Jacobians of bodies that hang from each other, compiled.

A table of joints (M, 41) says how each moves the body after it: what carries the body (0 is the
base, joint k moves body k + 1), which of n joints it is or follows, whether it turns, its
multiplier and offset, the body's origin in the parent, the joint's axis in the body and in the
parent, and the three matrices of its rotation (Rodrigues).
"""

from ctypes import c_int, c_int64

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.library import Doubles, Integers, native_function

_TABLE = (Doubles, c_int64)
_POSES = native_function(
    "tubeplanner_body_poses", *_TABLE, Doubles, c_int64, c_int64, Doubles, Doubles
)
_LAST_POSES = native_function(
    "tubeplanner_last_poses",
    *(*_TABLE, Doubles, c_int64, c_int64, Doubles, Doubles, Doubles),
    returns=c_int,
)
_POINT_JACOBIANS = native_function(
    "tubeplanner_point_jacobians",
    *(*_TABLE, Doubles, Doubles, Integers, Doubles, c_int64, c_int64, Doubles),
)


def native_body_poses(table: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotations (N, M + 1, 3, 3) and origins (N, M + 1, 3) [m] at positions (N, n)."""
    assert _POSES is not None
    q, shape = np.ascontiguousarray(q), (len(q), len(table) + 1)
    rotation, position = np.empty((*shape, 3, 3)), np.empty((*shape, 3))
    _POSES(table, len(table), q, q.shape[1], len(q), rotation, position)
    return rotation, position


def native_last_poses(table: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the rotation (N, 3, 3) and origin (N, 3) [m] of the last body at positions (N, n).

    Every body must carry the next.
    """
    rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
    _set_last_poses(table, q, rotation, position, None)
    return rotation, position


def native_last_jacobians(
    table: FloatArray, q: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return `native_last_poses` and their Jacobians (N, 6, n), linear rows first, base frame."""
    rotation, position = np.empty((len(q), 3, 3)), np.empty((len(q), 3))
    jacobian = np.empty((len(q), 6, q.shape[1]))
    _set_last_poses(table, q, rotation, position, jacobian)
    return rotation, position, jacobian


def native_point_jacobians(
    table: FloatArray,
    joint_count: int,
    poses: tuple[FloatArray, FloatArray],
    body: IntArray,
    point: FloatArray,
) -> FloatArray:
    """Return how points move with n joints, shape (N, 3, n).

    Args:
        table: The joints.
        joint_count: Their number n.
        poses: From `native_body_poses`.
        body: Which carries each point, shape (N,).
        point: In the base frame, shape (N, 3) [m].
    """
    assert _POINT_JACOBIANS is not None
    rotation, position, point = (np.ascontiguousarray(values) for values in (*poses, point))
    jacobian = np.empty((len(point), 3, joint_count))
    body = np.ascontiguousarray(body, dtype=np.int64)
    _POINT_JACOBIANS(
        *(table, len(table), rotation, position, body, point, joint_count, len(point), jacobian)
    )
    return jacobian


def _set_last_poses(
    table: FloatArray,
    q: FloatArray,
    rotation: FloatArray,
    position: FloatArray,
    jacobian: FloatArray | None,
) -> None:
    assert _LAST_POSES is not None
    q = np.ascontiguousarray(q)
    if _LAST_POSES(table, len(table), q, q.shape[1], len(q), rotation, position, jacobian):
        raise MemoryError
