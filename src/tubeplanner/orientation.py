"""Rotation matrices from how people write orientations: quaternions, and roll, pitch, yaw."""

import numpy as np

from tubeplanner.arrays import FloatArray

_UPRIGHT = 1e-9  # how long the shadow of x is on the plane of x and y, at most


def matrix_of_quaternion(quaternion: FloatArray) -> FloatArray:
    """Return rotation matrices of quaternions x y z w of any length: (..., 4) gives (..., 3, 3)."""
    length = np.linalg.norm(quaternion, axis=-1)
    x, y, z, w = np.moveaxis(quaternion / length[..., None], -1, 0)
    columns = [
        [x * x - y * y - z * z + w * w, 2 * (x * y + z * w), 2 * (x * z - y * w)],
        [2 * (x * y - z * w), y * y - x * x - z * z + w * w, 2 * (y * z + x * w)],
        [2 * (x * z + y * w), 2 * (y * z - x * w), z * z - x * x - y * y + w * w],
    ]
    return np.moveaxis(np.array(columns), (0, 1), (-1, -2))


def matrix_of_rpy(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Return the rotation matrix (3, 3) of turns about fixed x, then y, then z [rad]."""
    x = _turn(roll, 1, 2)
    y = _turn(pitch, 2, 0)
    z = _turn(yaw, 0, 1)
    matrix: FloatArray = z @ y @ x
    return matrix


def rpy_of_matrix(matrix: FloatArray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of a rotation matrix (3, 3), as `matrix_of_rpy` takes them.

    Where the pitch is a quarter turn, so that roll and yaw turn about one axis, the roll is 0.
    """
    flat = np.hypot(matrix[0, 0], matrix[1, 0])
    pitch = np.arctan2(-matrix[2, 0], flat)
    if flat < _UPRIGHT:
        return 0.0, float(pitch), float(np.arctan2(-matrix[0, 1], matrix[1, 1]))
    roll = np.arctan2(matrix[2, 1], matrix[2, 2])
    return float(roll), float(pitch), float(np.arctan2(matrix[1, 0], matrix[0, 0]))


def _turn(angle: float, first: int, second: int) -> FloatArray:
    """Return the rotation that turns one axis towards another."""
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = np.cos(angle)
    matrix[second, first] = np.sin(angle)
    matrix[first, second] = -np.sin(angle)
    return matrix
