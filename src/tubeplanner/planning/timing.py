"""How long a motion takes: longer than it must, and in a controller's periods."""

from math import ceil, floor

import numpy as np

from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_ROUNDING = 1e-9  # relative, and of a period


def no_longer(duration: float, longest: float) -> bool:
    """Return whether a duration is no longer than another, but for rounding."""
    return duration <= longest * (1 + _ROUNDING)


def fewest_periods(duration: float, period: float) -> int:
    """Return the number of periods that a motion needs."""
    return max(ceil(duration / period - _ROUNDING), 1)


def most_periods(duration: float, period: float) -> int:
    """Return the number of periods that fit into a duration."""
    return floor(duration / period + _ROUNDING)


def lengthened(
    trajectory: JointTrajectory, duration: float, period: float | None = None
) -> JointTrajectory:
    """Return a trajectory run in a duration [s], unless it takes longer.

    Args:
        trajectory: The trajectory.
        duration: What it is to take.
        period: Its breakpoints are multiples of this, but for rounding, which is taken away; None:
            they are not.
    """
    if not no_longer(trajectory.duration, duration):
        return trajectory
    slower = trajectory.scaled(duration / trajectory.duration)
    if period is None:
        return slower
    breakpoints = np.round(slower.breakpoints / period) * period
    return JointTrajectory(slower.joint_names, breakpoints, slower.coefficients)
