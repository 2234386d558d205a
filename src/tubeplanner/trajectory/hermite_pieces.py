"""Polynomials between samples that meet what is known of them: lines, cubics or quintics.

(Hermite interpolation; Biagiotti & Melchiorri, "Trajectory Planning for Automatic Machines and
Robots", 2008, sections 2.1.1, 2.1.3 and 2.1.5.) Each begins with what is known of its first sample;
the rest is taken from what that leaves to be made up until the next one. These are small numbers:
samples a millisecond apart meet to rounding, where differences of Bernstein coefficients would
leave jumps of the acceleration of 1e-7 rad/s^2.
"""

from collections.abc import Sequence

import numpy as np

from tubeplanner.arrays import FloatArray


def hermite_pieces(time: FloatArray, known: Sequence[FloatArray]) -> FloatArray:
    """Return the coefficients of one polynomial between every two samples.

    Args:
        time: Of the samples, shape (N,), increasing [s].
        known: Positions and, if given, velocities and accelerations there, each (N, n).

    Returns:
        Shape (2 * len(known), N-1, n), highest power of the time in the piece first.
    """
    h = np.diff(time)[:, None]
    first, last = [k[:-1] for k in known], [k[1:] for k in known]
    if len(known) == 1:
        return np.stack([(last[0] - first[0]) / h, first[0]])
    if len(known) == 2:
        left = last[0] - (first[0] + first[1] * h)
        left_rate = (last[1] - first[1]) * h
        return np.stack(
            [(left_rate - 2 * left) / h**3, (3 * left - left_rate) / h**2, first[1], first[0]]
        )
    left = last[0] - (first[0] + (first[1] + first[2] * h / 2) * h)
    left_rate = (last[1] - (first[1] + first[2] * h)) * h
    left_bend = (last[2] - first[2]) * h**2
    return np.stack(
        [
            (12 * left - 6 * left_rate + left_bend) / (2 * h**5),
            (-30 * left + 14 * left_rate - 2 * left_bend) / (2 * h**4),
            (20 * left - 8 * left_rate + left_bend) / (2 * h**3),
            first[2] / 2,
            first[1],
            first[0],
        ]
    )
