"""Trajectories cut into parts, and joined of parts."""

from collections.abc import Sequence
from math import comb

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import TrajectoryError
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


def part_of(trajectory: JointTrajectory, begin: float, end: float) -> JointTrajectory:
    """Return what a trajectory does between two times [s], as a trajectory that begins at zero.

    Raises:
        TrajectoryError: They are not in order, or lie outside of it.
    """
    if not 0 <= begin < end <= trajectory.duration:
        raise TrajectoryError(
            f"from {begin:g} to {end:g} s is no part of a trajectory of {trajectory.duration:g} s"
        )
    times, coefficients = trajectory.breakpoints, trajectory.coefficients
    first = max(int(np.searchsorted(times, begin, side="right")) - 1, 0)
    stop = max(int(np.searchsorted(times, end, side="left")), first + 1)
    pieces = coefficients[:, first:stop].copy()
    pieces[:, 0] = _from_later(pieces[:, 0], begin - times[first])
    inner = times[first + 1 : stop]
    return JointTrajectory(
        trajectory.joint_names, np.concatenate([[0.0], inner - begin, [end - begin]]), pieces
    )


def joined(joint_names: Sequence[str], parts: Sequence[JointTrajectory]) -> JointTrajectory:
    """Return trajectories one after the other as one, each of the same joints in their order.

    Each begins exactly where the one before ends in time; nothing makes positions meet.
    """
    degree = max(len(part.coefficients) for part in parts)
    pieces, times = [], [np.zeros(1)]
    for part in parts:
        padded = np.zeros((degree, *part.coefficients.shape[1:]))
        padded[degree - len(part.coefficients) :] = part.coefficients
        pieces.append(padded)
        times.append(times[-1][-1] + part.breakpoints[1:])
    return JointTrajectory(joint_names, np.concatenate(times), np.concatenate(pieces, axis=1))


def resting(joint_names: Sequence[str], q: FloatArray, duration: float) -> JointTrajectory:
    """Return the trajectory that stays in a configuration (n,) for a duration [s]."""
    return JointTrajectory(joint_names, [0.0, duration], q[None, None])


def _from_later(polynomial: FloatArray, by: float) -> FloatArray:
    """Return a polynomial (degree+1, n), highest power first, of a time that begins later [s]."""
    if by == 0:
        return polynomial
    degree = len(polynomial) - 1
    shifted = np.zeros_like(polynomial)
    for power in range(degree + 1):
        for lower in range(power + 1):
            term = comb(power, lower) * by ** (power - lower) * polynomial[degree - power]
            shifted[degree - lower] += term
    return shifted
