"""Rotation matrices from quaternions, roll-pitch-yaw and rotation vectors; their rates."""

from itertools import pairwise

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray

# ---- Rotation matrices from quaternions and from roll, pitch and yaw.

# Longest projection of the rotated x on the plane of x and y at which x counts as vertical.
_UPRIGHT = 1e-9
_ALONG_X = 0.9  # cosine of the angle from x at which a z axis counts as along x


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
    """Return the rotation matrix (3, 3) of rotations about fixed x, then y, then z [rad]."""
    x = _plane_rotation(roll, 1, 2)
    y = _plane_rotation(pitch, 2, 0)
    z = _plane_rotation(yaw, 0, 1)
    matrix: FloatArray = z @ y @ x
    return matrix


def rpy_of_matrix(matrix: FloatArray) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of a rotation matrix (3, 3), as in `matrix_of_rpy`.

    The roll is 0 where the pitch is a quarter turn: roll and yaw then have one axis.
    """
    flat = np.hypot(matrix[0, 0], matrix[1, 0])
    pitch = np.arctan2(-matrix[2, 0], flat)
    if flat < _UPRIGHT:
        return 0.0, float(pitch), float(np.arctan2(-matrix[0, 1], matrix[1, 1]))
    yaw = np.arctan2(matrix[1, 0], matrix[0, 0])
    # Relative to this yaw, as it is only rounding next to a quarter turn.
    across = np.array([-np.sin(yaw), np.cos(yaw)]) @ matrix[:2]
    return float(np.arctan2(-across[2], across[1])), float(pitch), float(yaw)


def _plane_rotation(angle: float, first: int, second: int) -> FloatArray:
    """Return the rotation (3, 3) by an angle [rad] from the first axis towards the second."""
    matrix = np.eye(3)
    matrix[first, first] = matrix[second, second] = np.cos(angle)
    matrix[second, first] = np.sin(angle)
    matrix[first, second] = -np.sin(angle)
    return matrix


# ---- Rotation vectors: logarithm and exponential of rotation matrices, and their rates.
#
# A rotation vector v has the rotation's axis as direction and its angle [rad] as length. All
# functions take arrays with any leading shape (...). Formulas after Sola, Deray & Atchuthan, "A
# micro Lie theory for state estimation in robotics" (2018), appendix B.

_SMALL = 1e-2  # [rad]: below it, series are used where closed forms lose digits
# An error of at most e in every column of a rotation matrix changes its rotation vector by at most
# this times e times `turning_gain`: see `rotation_vector`.
MATRIX_ERROR_GAIN = 5.0


def _shepperd_rows() -> FloatArray:
    """Return the linear map from a rotation matrix to 4 q q^T, less 1 on its diagonal: (9, 16)."""
    rows = np.zeros((3, 3, 4, 4))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        rows[i, i, i, i] = rows[i, i, 3, 3] = 1.0
        rows[j, j, i, i] = rows[k, k, i, i] = -1.0
        rows[i, j, i, j] = rows[i, j, j, i] = rows[j, i, i, j] = rows[j, i, j, i] = 1.0
        rows[k, j, i, 3] = rows[k, j, 3, i] = 1.0
        rows[j, k, i, 3] = rows[j, k, 3, i] = -1.0
    return rows.reshape(9, 16)


def _skew_entries() -> FloatArray:
    """Return the linear map from v to the entries of [v]: (3, 9)."""
    entries = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        entries[i, k, j], entries[i, j, k] = 1.0, -1.0
    return entries.reshape(3, 9)


_SHEPPERD_ROWS, _SKEW_ENTRIES = _shepperd_rows(), _skew_entries()
_ONE_3, _ONE_4 = np.eye(3), np.eye(4).ravel()


def skew(v: FloatArray) -> FloatArray:
    """Return the matrices [v] with [v] w = v x w: (..., 3) gives (..., 3, 3)."""
    return (v @ _SKEW_ENTRIES).reshape(*v.shape, 3)


def rotation_vector(matrix: FloatArray) -> FloatArray:
    """Return the rotation vectors of rotation matrices: (..., 3, 3) gives (..., 3), length <= pi.

    From the row of 4 q q^T, q being the unit quaternion, that has the largest diagonal element
    (Shepperd, "Quaternion from rotation matrix", 1978), sound at every angle. That element is at
    least 1: where every entry of the matrix is off by at most e, the row's are by 3 e on the
    diagonal and 2 e beside it, its direction by (9 + 3 4)^(1/2) e / 2 and the rotation by twice as
    much. At an angle of pi, where v and -v are the same rotation, either is returned.
    """
    m = np.asarray(matrix)
    rows = (m.reshape(*m.shape[:-2], 9) @ _SHEPPERD_ROWS + _ONE_4).reshape(-1, 4, 4)
    largest = rows[:, range(4), range(4)].argmax(axis=1)
    q = rows[np.arange(len(rows)), largest].reshape(*m.shape[:-2], 4)
    q = q * np.where(q[..., 3:] < 0, -1.0, 1.0)
    sine = np.linalg.norm(q[..., :3], axis=-1)
    half_angle = np.arctan2(sine, q[..., 3])
    return (2 * half_angle / np.where(sine == 0, 1.0, sine))[..., None] * q[..., :3]


def quaternion_of_matrix(matrix: FloatArray) -> FloatArray:
    """Return the unit quaternions x y z w, w >= 0, of rotation matrices: (..., 4)."""
    v = rotation_vector(matrix)
    half = np.linalg.norm(v, axis=-1, keepdims=True) / 2
    return np.concatenate([np.sinc(half / np.pi) * v / 2, np.cos(half)], axis=-1)


def matrices_along(axes: FloatArray) -> FloatArray:
    """Return rotation matrices (N, 3, 3) whose z axes are unit vectors (N, 3), no two opposed.

    The x axis of the first lies in the plane of its z axis and x, or y where z is along x. From one
    to the next the rotation is the least that turns the z axes into each other.
    """
    along = axes[0]
    first = np.array([1.0, 0, 0] if abs(along[0]) < _ALONG_X else [0, 1.0, 0])
    x = first - (first @ along) * along
    x /= np.linalg.norm(x)
    matrices = [np.column_stack([x, np.cross(along, x), along])]
    for axis, further in pairwise(axes):
        turn = skew(np.cross(axis, further))
        matrices.append((np.eye(3) + turn + turn @ turn / (1 + axis @ further)) @ matrices[-1])
    return np.array(matrices)


def nearest_branch(v: FloatArray, near: FloatArray, components: BoolArray) -> FloatArray:
    """Return the equivalents of rotation vectors (..., 3) of at most pi nearest to others [rad].

    A rotation by a about an axis is a rotation by 2 pi - a about the opposite axis. The latter is
    returned if it is nearer, by the components that count (3,), and its angle at most 3/2 pi.
    """
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    if (angle <= np.pi / 2).all():
        return v
    other = v * (1 - 2 * np.pi / np.maximum(angle, np.pi / 2))
    far, further = ((abs(x - near) * components).sum(axis=-1) for x in (v, other))
    is_nearer = (angle[..., 0] > np.pi / 2) & (further < far)
    return np.where(is_nearer[..., None], other, v)


def rotation_matrix(v: FloatArray) -> FloatArray:
    """Return the rotation matrices of rotation vectors (Rodrigues): (..., 3) gives (..., 3, 3)."""
    angle = np.linalg.norm(v, axis=-1)[..., None, None]
    k = skew(v)
    # np.sinc(x) is sin(pi x) / (pi x): sound at zero.
    sine, half = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi))
    return _ONE_3 + sine * k + 0.5 * half**2 * (k @ k)


def inverse_right_jacobian(v: FloatArray) -> FloatArray:
    """Return J with dv/dt = J w, w being the angular velocity of exp([v]) in its own frame.

    Of rotation vectors (..., 3) of at most pi, shape (..., 3, 3): 1 + [v] / 2 + c [v]^2, where
    c = 1 / a^2 - cot(a / 2) / (2 a), a = |v|.
    """
    k = skew(v)
    c = _second_coefficient(np.linalg.norm(v, axis=-1))[..., None, None]
    return _ONE_3 + 0.5 * k + c * (k @ k)


def turning_gain(angle: FloatArray) -> FloatArray:
    """Return the norm of `inverse_right_jacobian` at angles from 0 to less than 2 pi [rad].

    In the plane across the axis its eigenvalues are a/2 cot(a/2) +- i a/2; increasing in a.
    """
    return 1 / np.sinc(angle / (2 * np.pi))


def turning_gain_rate(angle: FloatArray) -> FloatArray:
    """Return a bound on the change of `inverse_right_jacobian` per |dv|, angles below 2 pi [rad].

    From its three terms: 1/2 + |c'| a^2 + 2 c a, increasing in a.
    """
    # c' = -2 / a^3 + cot(a / 2) / (2 a^2) + 1 / (4 a sin^2(a / 2)).
    a = np.maximum(angle, _SMALL)
    closed = -2 / a**3 + 1 / (2 * a**2 * np.tan(a / 2)) + 1 / (4 * a * np.sin(a / 2) ** 2)
    slope = np.where(angle < _SMALL, angle / 360, closed)
    return 0.5 + slope * angle**2 + 2 * _second_coefficient(angle) * angle


def _second_coefficient(angle: FloatArray) -> FloatArray:
    """Return c = 1 / a^2 - cot(a / 2) / (2 a)."""
    a = np.maximum(angle, _SMALL)
    closed = 1 / a**2 - 1 / (2 * a * np.tan(a / 2))
    return np.where(angle < _SMALL, 1 / 12 + angle**2 / 720, closed)
