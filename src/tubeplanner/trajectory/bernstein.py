"""Rigorous bounds on polynomials: a polynomial lies in the hull of its Bernstein coefficients.

Coefficients are laid out as in `scipy.interpolate.PPoly`: shape (degree+1, pieces, n), highest
power first, local time from 0 to the width of the piece.
"""

from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only

# Halvings after which a piece is not cut further: its width is then 1e-12 of the original.
_MAX_HALVINGS = 40
_RESOLUTION = 1e-10  # relative to the largest value


@dataclass(frozen=True, eq=False)
class Extrema:
    """Largest values of n polynomials over all their pieces, and where.

    Attributes:
        value: Shape (n,); a value that is attained, at most 1e-10 (relative) below the maximum.
        piece: Piece that attains it: int, shape (n,).
        local_time: Time from the start of that piece [s], shape (n,).
    """

    value: FloatArray
    piece: IntArray
    local_time: FloatArray


def bernstein_coefficients(
    coefficients: FloatArray, start: FloatArray, width: FloatArray
) -> FloatArray:
    """Return the Bernstein coefficients of polynomials restricted to intervals.

    Args:
        coefficients: Shape (degree+1, P, n), highest power first.
        start: Start of each interval in local time [s], shape (P,).
        width: Width of each interval [s], shape (P,).

    Returns:
        Shape (degree+1, P, n); the first and the last are the values at the interval's ends.
        (Farouki, "The Bernstein polynomial basis: a centennial retrospective", 2012, section 3.2.)
    """
    return np.einsum(
        "bk,kpn->bpn",
        _power_to_bernstein(len(coefficients) - 1),
        _taylor_coefficients(coefficients, start, width),
    )


def restricted(coefficients: FloatArray, start: FloatArray, width: FloatArray) -> FloatArray:
    """Return polynomials on intervals, as polynomials of a time that runs from 0 to 1 over each.

    Args:
        coefficients: Shape (degree+1, P, n), highest power first.
        start: Start of each interval in local time [s], shape (P,).
        width: Width of each interval [s], shape (P,).

    Returns:
        Shape (degree+1, P, n), highest power first.
    """
    return _taylor_coefficients(coefficients, start, width)[::-1]


def halves(start: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return starts and widths of both halves of intervals (P,), one after the other: (2P,)."""
    width = np.repeat(width / 2, 2)
    start = np.repeat(start, 2)
    start[1::2] += width[1::2]
    return start, width


def maxima(coefficients: FloatArray, widths: FloatArray) -> Extrema:
    """Return the largest value of each of n piecewise polynomials, by Bernstein subdivision.

    Args:
        coefficients: Shape (degree+1, pieces, n).
        widths: Widths of the pieces [s], shape (pieces,).

    Raises:
        ValueError: A coefficient is not finite.
    """
    if not np.isfinite(coefficients).all():
        raise ValueError("coefficients must be finite")
    pieces, n = coefficients.shape[1:]
    # One row per (piece, polynomial) still in question.
    piece = np.repeat(np.arange(pieces), n)
    column = np.tile(np.arange(n), pieces)
    start, width = np.zeros(len(piece)), widths[piece].astype(float)
    value = np.full(n, -np.inf)
    best_piece, best_time = np.zeros(n, dtype=np.int64), np.zeros(n)
    for _ in range(_MAX_HALVINGS):
        rows = coefficients[:, piece, column][:, :, None]
        bounds = bernstein_coefficients(rows, start, width)[:, :, 0]
        for ends, times in ((bounds[0], start), (bounds[-1], start + width)):
            order = np.argsort(ends, kind="stable")
            better = order[ends[order] > value[column[order]]]
            value[column[better]] = ends[better]
            best_piece[column[better]] = piece[better]
            best_time[column[better]] = times[better]
        slack = _RESOLUTION * np.maximum(abs(value), 1e-300)
        open_ = bounds.max(axis=0) > value[column] + slack[column]
        if not open_.any():
            break
        piece, column = np.repeat(piece[open_], 2), np.repeat(column[open_], 2)
        start, width = halves(start[open_], width[open_])
    return Extrema(value, best_piece, best_time)


def peak_magnitudes(coefficients: FloatArray, widths: FloatArray) -> Extrema:
    """Return the largest magnitude of each of n piecewise polynomials; arguments as `maxima`."""
    both = maxima(np.concatenate([coefficients, -coefficients], axis=2), widths)
    n = coefficients.shape[2]
    sign = both.value.reshape(2, n).argmax(axis=0)
    chosen = n * sign + np.arange(n)
    return Extrema(both.value[chosen], both.piece[chosen], both.local_time[chosen])


def _taylor_coefficients(
    coefficients: FloatArray, start: FloatArray, width: FloatArray
) -> FloatArray:
    """Return those about the starts of intervals, in widths of these, lowest power first."""
    degree = len(coefficients) - 1
    ascending = np.asarray(coefficients, dtype=np.float64)[::-1]
    if not start.any():
        return ascending * (width ** np.arange(degree + 1)[:, None])[..., None]
    scaled = np.empty_like(ascending)
    powers = start ** np.arange(degree + 1)[:, None]
    for power in range(degree + 1):
        # Sum over k of C(k, power) start^(k - power) c_k.
        factors = _binomials(degree)[power:, power, None] * powers[: degree + 1 - power]
        scaled[power] = np.einsum("kp,kpn->pn", factors, ascending[power:])
        scaled[power] *= (width**power)[:, None]
    return scaled


@cache
def _binomials(degree: int) -> FloatArray:
    """Return the numbers C(i, j) for i and j from 0 to a degree, (k+1, k+1)."""
    numbers = range(degree + 1)
    return read_only([[comb(i, j) for j in numbers] for i in numbers])


@cache
def _power_to_bernstein(degree: int) -> FloatArray:
    """Return the matrix from powers of u on [0, 1] to Bernstein coefficients, (k+1, k+1)."""
    binomials = _binomials(degree)
    # 0 above the diagonal, as C(i, j) is.
    return read_only(binomials / binomials[-1])
