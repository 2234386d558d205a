"""How fast an arm's joint efforts change along a motion, and how that follows from the motion.

The efforts are a function tau(q, v, a), so that d tau / dt is by_q v + by_v a + by_a jerk with its
derivatives by_q, by_v and by_a (Carpentier & Mansard, "Analytical derivatives of rigid body
dynamics algorithms", 2018).
"""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel

# Of the times in which the motion changes by one radian or metre: the differences are good to 1e-8.
_STEP = 1e-4


def effort_rate(
    robot: RobotModel, q: FloatArray, v: FloatArray, a: FloatArray, jerk: FloatArray
) -> FloatArray:
    """Return d tau / dt, shape (N, n) [N m/s or N/s], exact.

    Args:
        robot: The arm.
        q: Configurations, shape (N, n) [rad or m].
        v: Velocities, shape (N, n).
        a: Accelerations, shape (N, n).
        jerk: Shape (N, n).
    """
    blocks = robot.inverse_dynamics_derivatives(q, v, a)
    rates = np.concatenate([v, a, jerk], axis=1)[:, :, None]
    rate: FloatArray = (np.concatenate(blocks, axis=2) @ rates)[:, :, 0]
    return rate


def gravity_effort_rate(robot: RobotModel, q: FloatArray, v: FloatArray) -> FloatArray:
    """Return how fast the efforts against gravity change, shape (N, n) [N m/s or N/s], exact.

    Args:
        robot: The arm.
        q: Configurations, shape (N, n) [rad or m].
        v: Velocities, shape (N, n).
    """
    still = np.zeros_like(q)
    if not robot.gravity.any():
        return still
    by_q, _, _ = robot.inverse_dynamics_derivatives(q, still, still)
    rate: FloatArray = (by_q @ v[:, :, None])[:, :, 0]
    return rate


def effort_rate_derivatives(
    robot: RobotModel, q: FloatArray, v: FloatArray, a: FloatArray, jerk: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the derivatives of d tau / dt by q, v, a and jerk, each (N, effort joint, n).

    Those of tau change by the time derivative of by_q, and so on: it is taken by differences along
    the motion, which cost two evaluations whatever the number of joints. What a derivative by v or
    a adds, the derivative by q or v itself, is their mean.

    Args:
        robot: The arm.
        q: Configurations, shape (N, n) [rad or m].
        v: Velocities, shape (N, n).
        a: Accelerations, shape (N, n).
        jerk: Shape (N, n).
    """
    step = _steps(v, a, jerk)
    changes = [step * rate for rate in (v, a, jerk)]
    state = list(zip((q, v, a), changes, strict=True))
    after = robot.inverse_dynamics_derivatives(*(now + change for now, change in state))
    before = robot.inverse_dynamics_derivatives(*(now - change for now, change in state))
    pairs = list(zip(after, before, strict=True))
    mean = [(late + early) / 2 for late, early in pairs]
    change = [(late - early) / (2 * step[:, :, None]) for late, early in pairs]
    return change[0], change[1] + mean[0], change[2] + mean[1], mean[2]


def _steps(v: FloatArray, a: FloatArray, jerk: FloatArray) -> FloatArray:
    """Return for how long to follow motions, shape (N, 1) [s]."""
    pace = [abs(rate).max(axis=1) ** (1 / k) for k, rate in enumerate((v, a, jerk), start=1)]
    fastest = np.sum(pace, axis=0)[:, None]
    return np.divide(_STEP, fastest, out=np.full_like(fastest, _STEP), where=fastest > 0)
