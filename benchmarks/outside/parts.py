"""A part of a trajectory, cut out at two instants."""

import math

import numpy as np

from outside.files import BadInput
from outside.trajectory import Trajectory

SAME = 1e-9  # [s]: who is that near to a breakpoint is there


def part_of(trajectory: Trajectory, begin: float, end: float) -> Trajectory:
    """Return what a trajectory does between two times [s], as one that begins at zero.

    Raises:
        BadInput: They are not in order, or outside of it.
    """
    begin, end = (_at_breakpoint(trajectory.breakpoints, time) for time in (begin, end))
    if not 0 <= begin < end <= trajectory.duration:
        raise BadInput(f"from {begin:g} to {end:g} s is no part of {trajectory.duration:g} s")
    inner = trajectory.breakpoints[
        (trajectory.breakpoints > begin) & (trajectory.breakpoints < end)
    ]
    times = np.array([begin, *inner, end])
    piece = np.searchsorted(trajectory.breakpoints, times[:-1], side="right") - 1
    coefficients = trajectory.coefficients[:, piece]
    later = begin - trajectory.breakpoints[piece[0]]
    coefficients[:, 0] = _shifted(coefficients[:, 0], later)
    return Trajectory(trajectory.joint_names, times - begin, coefficients)


def _at_breakpoint(breakpoints: np.ndarray, time: float) -> float:
    nearest = float(breakpoints[abs(breakpoints - time).argmin()])
    return nearest if abs(nearest - time) <= SAME else time


def _shifted(polynomial: np.ndarray, by: float) -> np.ndarray:
    """Return a polynomial (degree+1, n), highest power first, of a time that begins later.

    Taylor: the coefficient of a power is that derivative there, divided by the factorial.
    """
    rows, derivative = [], polynomial
    for power in range(len(polynomial)):
        value = np.zeros(polynomial.shape[1])
        for row in derivative:
            value = value * by + row
        rows.append(value / math.factorial(power))
        derivative = derivative[:-1] * np.arange(len(derivative) - 1, 0, -1)[:, None]
    return np.array(rows[::-1])
