"""Configurations in which an arm is seen and moves well: mid-range, bent, above ground."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel

_SAMPLES, _SEED = 500, 0
_SHARE = 0.6  # of the way from the middle of a range to its ends
_MOST = 1.5  # [rad or m] from the middle
_MIDDLE = 1.0  # the middle is at most so far from zero [rad or m]
_BELOW_GROUND = 0.2  # what a configuration below the base counts
_NO_GAIN = 1e-6


def typical_configurations(arm: RobotModel) -> FloatArray:
    """Return configurations (K, n) within limits, the best first.

    Good is where every direction in which the joints can move and turn the tool is easy, by the
    least singular values that are not always zero, of the Jacobian and of its first three rows, and
    no joint is below the base, however it stands.
    """
    arm = arm.in_root_frame()
    limits = arm.limits
    endless = np.isinf(limits.lower_position) | np.isinf(limits.upper_position)
    lower = np.where(endless, -np.pi, limits.lower_position)
    upper = np.where(endless, np.pi, limits.upper_position)
    middle = np.clip((lower + upper) / 2, np.maximum(lower, -_MIDDLE), np.minimum(upper, _MIDDLE))
    down = np.minimum(_SHARE * (middle - lower), _MOST)
    up = np.minimum(_SHARE * (upper - middle), _MOST)
    share = np.random.default_rng(_SEED).uniform(-1, 1, (_SAMPLES, arm.joint_count))
    q = middle + np.where(share < 0, share * down, share * up)
    return q[np.argsort(-_goodness(arm, q), kind="stable")]


def _goodness(arm: RobotModel, q: FloatArray) -> FloatArray:
    """Return how good configurations are, shape (K,)."""
    tool, jacobian = arm.tool_jacobian(q)
    _, origins = arm.body_poses(q)
    lowest = np.minimum(origins[..., 2].min(axis=1), tool[:, 2])
    ground = min(0.0, float(origins[:, 1, 2].min()))  # the first joint may hang below the base
    share = np.where(lowest < ground - _NO_GAIN, _BELOW_GROUND, 1.0)
    return share * _least_gain(jacobian[:, :3]) * _least_gain(jacobian)


def _least_gain(jacobian: FloatArray) -> FloatArray:
    """Return the least singular values of matrices (K, rows, n) that are not always zero."""
    gains = np.linalg.svd(jacobian, compute_uv=False)
    rank = int(np.median((gains > _NO_GAIN).sum(axis=1)))
    return np.asarray(gains[:, max(rank, 1) - 1], dtype=np.float64)
