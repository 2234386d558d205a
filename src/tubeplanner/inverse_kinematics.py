"""Inverse kinematics of one hand position, within joint bounds.

Damped least squares with the damping of Sugihara, "Solvability-unconcerned inverse kinematics by
the Levenberg-Marquardt method" (IEEE T-RO 27(5), 2011): it converges at a fully stretched arm, and
comes as near as possible to a point out of reach. Spare joints are pulled towards a preferred
configuration in the null space of the hand's position.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot import RobotModel

_DAMPING = 1e-10  # added to half the squared error [m^2]
_POSITION_TOLERANCE = 1e-10  # [m]
# The last step [rad or m]: what it leaves is of its square.
_POSTURE_TOLERANCE = 1e-6
_MOST_ITERATIONS = 100
# Near full stretch a joint is all but spare, and a pull on it would keep the hand from its target:
# later iterations go for the target alone.
_PULLED_ITERATIONS = 40
_LARGEST_STEP = 0.2  # [rad or m] of any joint
# Directions in which a joint moves the hand by less than this count as spare [m/rad].
_SPARE_GAIN = 1e-4
# A stretched arm cannot feel which way to fold: it is bent this much, one way, then the other.
_BENDS = (0.05, -0.05)  # [rad or m], its sign alternating from joint to joint


@dataclass(frozen=True, eq=False)
class PositionSolution:
    """The nearest the hand gets to a position.

    Attributes:
        q: Configuration within the bounds, shape (n,) [rad or m].
        error: Distance of the hand from the position [m].
    """

    q: FloatArray
    error: float


def solve_position(
    robot: RobotModel,
    target: FloatArray,
    seed: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    preferred: FloatArray | None = None,
) -> PositionSolution:
    """Move a configuration until the hand is at a position.

    Args:
        robot: The arm.
        target: Hand position, shape (3,), base frame [m].
        seed: Where to start, shape (n,) [rad or m].
        lower: Lower joint bounds, shape (n,).
        upper: Upper joint bounds, shape (n,).
        preferred: Where spare joints go, shape (n,); default: back to the seed.

    Returns:
        The solution; its error says whether the target was reached.
    """
    preferred = seed if preferred is None else preferred
    solution = _descend(robot, target, seed, lower, upper, preferred)
    pattern = (-1.0) ** np.arange(len(seed))
    for bend in _BENDS:
        if solution.error < _POSITION_TOLERANCE**0.5:
            break
        bent = solution.q + bend * pattern
        other = _descend(robot, target, bent, lower, upper, preferred)
        solution = min(solution, other, key=lambda found: found.error)
    return solution


def _descend(
    robot: RobotModel,
    target: FloatArray,
    seed: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    preferred: FloatArray,
) -> PositionSolution:
    q = last = np.clip(seed, lower, upper)
    least = np.inf
    for iteration in range(_MOST_ITERATIONS):
        position, jacobian = robot.tool_jacobian(q[None])
        error, jacobian = target - position[0], jacobian[0, :3]
        pulled = iteration < _PULLED_ITERATIONS
        if not pulled and np.linalg.norm(error) > least:
            q = (last + q) / 2  # a step beyond a target out of reach
            continue
        least, last = float(np.linalg.norm(error)), q
        pull = preferred - q if pulled else np.zeros_like(q)
        step = _step(jacobian, error, pull, q, lower, upper)
        step *= min(1.0, _LARGEST_STEP / max(float(abs(step).max()), 1e-300))
        moved = np.clip(q + step, lower, upper) - q
        q = q + moved
        if abs(moved).max() < _POSTURE_TOLERANCE:
            break
        if not pulled and least < _POSITION_TOLERANCE:
            break
    error = target - robot.tool_position(q[None])[0]
    return PositionSolution(q, float(np.linalg.norm(error)))


def _step(
    jacobian: FloatArray,
    error: FloatArray,
    pull: FloatArray,
    q: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
) -> FloatArray:
    """Return a joint step; joints at a bound that it would push outwards are held still."""
    free = np.ones(len(q), dtype=bool)
    while True:
        step = np.zeros_like(q)
        step[free] = _free_step(jacobian[:, free], error, pull[free])
        outward = free & (((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0)))
        if not outward.any():
            return step
        free &= ~outward


def _free_step(jacobian: FloatArray, error: FloatArray, pull: FloatArray) -> FloatArray:
    if jacobian.shape[1] == 0:
        return np.zeros(0)
    u, gain, v = np.linalg.svd(jacobian, full_matrices=False)
    damping = 0.5 * float(error @ error) + _DAMPING
    towards = v.T @ (gain / (gain**2 + damping) * (u.T @ error))
    used = v[gain > _SPARE_GAIN]
    return towards + pull - used.T @ (used @ pull)
