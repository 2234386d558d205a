"""Paths composed with time parameterizations: polynomials of polynomials, exactly.

A path is stored as the trajectory that runs it at unit speed, a time parameterization as the
trajectory of a single joint: the arc length along the path.
"""

import numpy as np
from scipy.interpolate import PPoly
from scipy.optimize import elementwise
from scipy.special import factorial

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.trajectory.averaging import averaged
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_SAME_TIME = 1e-9  # of the duration: pieces shorter than this are none


def run_along(path: JointTrajectory, timing: JointTrajectory) -> JointTrajectory:
    """Return the trajectory along a path with a time parameterization.

    Args:
        path: Over the arc length, from 0 to its length.
        timing: The arc length over time, from 0 to the same length, never falling.

    Returns:
        The composition, exactly; its degree is the product of both degrees.
    """
    reached = times_at(timing, path.breakpoints[1:-1])
    nearest = abs(reached[:, None] - timing.breakpoints).min(axis=1)
    times = np.append(timing.breakpoints, reached[nearest > _SAME_TIME * timing.duration])
    times = np.sort(times)
    times = times[np.append(True, np.diff(times) > _SAME_TIME * timing.duration)]
    times[-1] = timing.duration
    middle = timing.position((times[:-1] + times[1:]) / 2)[:, 0]
    piece = np.clip(np.searchsorted(path.breakpoints, middle) - 1, 0, len(path.widths) - 1)
    return JointTrajectory(
        path.joint_names, times, _composed(path, _restarted(timing, times), piece)
    )


def times_at(timing: JointTrajectory, arc_length: FloatArray) -> FloatArray:
    """Return the times [s] at which arc lengths (N,) are reached; they never fall."""
    if len(arc_length) == 0:
        return np.zeros(0)
    arc_length = np.clip(
        arc_length,
        timing.position(0.0),
        timing.position(timing.duration),
    )
    ends = (np.zeros(len(arc_length)), np.full(len(arc_length), timing.duration))
    found = elementwise.find_root(
        lambda t, arc_length: timing.position(t)[:, 0] - arc_length,
        ends,
        args=(arc_length,),
    )
    return found.x


def averaged_parameterization(timing: JointTrajectory, intervals: int) -> JointTrajectory:
    """Return the average over neighbouring intervals: a C2 cubic spline that never falls.

    Args:
        timing: The arc length over time.
        intervals: How many equal ones, at least 3; two of them come on top of its duration.
    """
    # In between, the time parameterization's own speed.
    return averaged(timing, intervals, timing.duration * intervals / (intervals - 2))


def _restarted(timing: JointTrajectory, times: FloatArray) -> FloatArray:
    """Return coefficients (degree+1, P) of the pieces between other times, (P+1,)."""
    polynomial = PPoly(timing.coefficients[:, :, 0], timing.breakpoints)
    powers = np.arange(len(timing.coefficients) - 1, -1, -1)
    # Looked up at the middles, expanded about the starts: rounding cannot pick a neighbouring
    # piece.
    half = np.diff(times) / 2
    rows = np.array([polynomial.derivative(p)(times[:-1] + half) / factorial(p) for p in powers])
    return _shifted(rows, -half)


def _shifted(rows: FloatArray, by: FloatArray) -> FloatArray:
    """Return polynomials (degree+1, P), highest power first, in local time moved by (P,)."""
    shifted = rows.copy()
    for last in range(len(rows), 1, -1):  # repeated synthetic division
        for k in range(1, last):
            shifted[k] += by * shifted[k - 1]
    return shifted


def _composed(path: JointTrajectory, timing: FloatArray, piece: IntArray) -> FloatArray:
    """Return a path's pieces (P,) composed with polynomials (r+1, P): (degree*r+1, P, n)."""
    arc_length = timing.copy()
    arc_length[-1] -= path.breakpoints[piece]
    rows = path.coefficients[:, piece]
    result = rows[:1]
    for row in rows[1:]:
        product = np.zeros((len(result) + len(arc_length) - 1, *row.shape))
        for power, factor in enumerate(arc_length):
            product[power : power + len(result)] += factor[:, None] * result
        product[-1] += row
        result = product
    return result
