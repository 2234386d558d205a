"""Piecewise polynomials and their rigorous bounds; B-splines, fits, pieces between samples."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """Polynomials between breakpoints; the first and the last polynomial go on beyond the ends."""

    # shape (degree+1, pieces, n), highest power first, local time `t - breakpoints[i]`
    coefficients: FloatArray
    breakpoints: FloatArray  # shape (pieces+1,), increasing

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return the values at times of any shape (...,): shape (..., n).

        At a breakpoint, the value of the piece after it.
        """
        last = len(self.breakpoints) - 2
        piece = np.clip(np.searchsorted(self.breakpoints, t, side="right") - 1, 0, last)
        local = (t - self.breakpoints[piece])[..., None]
        value = self.coefficients[0][piece]
        for row in self.coefficients[1:]:
            value = value * local + row[piece]
        return value

    def derivative(self, order: int) -> "PiecewisePolynomial":
        """Return the derivative of an order, with at least a row of coefficients."""
        coefficients = self.coefficients
        for _ in range(order):
            powers = np.arange(len(coefficients) - 1, 0, -1.0)
            lower = coefficients[:-1] * powers[:, None, None]
            coefficients = lower if len(lower) else np.zeros_like(coefficients)
        return PiecewisePolynomial(coefficients, self.breakpoints)


# ---- Rigorous bounds on polynomials: a polynomial lies in the hull of its Bernstein coefficients.
#
# Coefficients are laid out as in `scipy.interpolate.PPoly`: shape (degree+1, pieces, n), highest
# power first, local time from 0 to the width of the piece.

_MAX_HALVINGS = 40  # of a piece: its parts then have 1e-12 of its width
_RESOLUTION = 1e-10  # relative to the largest value


@dataclass(frozen=True, eq=False)
class Extrema:
    """Largest values of n polynomials over all their pieces, with their times."""

    # shape (n,); a value that is attained, at most 1e-10 (relative) below the maximum
    value: FloatArray
    piece: IntArray  # piece that attains the value: int, shape (n,)
    local_time: FloatArray  # time from the start of that piece [s], shape (n,)


def bernstein_coefficients(
    coefficients: FloatArray, start: FloatArray, width: FloatArray
) -> FloatArray:
    """Return the Bernstein coefficients of polynomials (degree+1, P, n) restricted to intervals.

    Intervals have starts in local time and widths (P,) [s]. The first and the last coefficient are
    the values at the interval's ends. (Farouki, "The Bernstein polynomial basis: a centennial
    retrospective", 2012, section 3.2.)
    """
    binomials = _binomials(len(coefficients) - 1)
    # From powers of u on [0, 1] to Bernstein coefficients: lower triangular, as C(i, j) is.
    matrix = binomials / binomials[-1]
    return np.einsum("bk,kpn->bpn", matrix, _taylor_coefficients(coefficients, start, width))


def restricted(coefficients: FloatArray, start: FloatArray, width: FloatArray) -> FloatArray:
    """Return polynomials (degree+1, P, n) restricted to intervals, with a time from 0 to 1 in each.

    Intervals have starts in local time and widths (P,) [s].
    """
    return _taylor_coefficients(coefficients, start, width)[::-1]


def halves(start: FloatArray, width: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return starts and widths of the halves of intervals (P,), halves side by side: (2P,)."""
    width = np.repeat(width / 2, 2)
    start = np.repeat(start, 2)
    start[1::2] += width[1::2]
    return start, width


def maxima(coefficients: FloatArray, widths: FloatArray) -> Extrema:
    """Return the largest value of each of n piecewise polynomials, by Bernstein subdivision.

    Pieces of coefficients (degree+1, pieces, n) have widths (pieces,) [s].

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
    larger = n * sign + np.arange(n)
    return Extrema(both.value[larger], both.piece[larger], both.local_time[larger])


def _taylor_coefficients(
    coefficients: FloatArray, start: FloatArray, width: FloatArray
) -> FloatArray:
    """Return Taylor coefficients about interval starts, per interval width, lowest power first."""
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
    """Return the binomials C(i, j) for i and j from 0 to a degree k: shape (k+1, k+1)."""
    numbers = range(degree + 1)
    return read_only([[comb(i, j) for j in numbers] for i in numbers])


# ---- B-splines by the recursions of Cox and de Boor.


@dataclass(frozen=True, eq=False)
class BSpline:
    """B-spline; a call with times x of shape (N,) returns values of shape (N, ...)."""

    knots: FloatArray  # clamped knot vector, shape (K+degree+1,)
    control_points: FloatArray  # shape (K, ...)
    degree: int  # at least 1

    def __call__(self, x: FloatArray, order: int = 0) -> FloatArray:
        """Return a derivative of an order up to the degree; 0: the values.

        At a knot, the derivative of the interval after it.
        """
        if order > 0:
            return self.derivative()(x, order - 1)
        span = knot_intervals(self.knots, self.degree, x)
        weights = basis_functions(self.knots, self.degree, span, x)[0]
        near = self.control_points[span[:, None] + np.arange(-self.degree, 1)]
        values: FloatArray = np.einsum("nk,nk...->n...", weights, near)
        return values

    def derivative(self) -> "BSpline":
        """Return the derivative (Piegl & Tiller, "The NURBS Book", 1997, equation 3.4).

        Exactly zero where control points are equal.
        """
        widths = self.knots[self.degree + 1 : -1] - self.knots[1 : -self.degree - 1]
        slopes = (self.degree * np.diff(self.control_points, axis=0).T / widths).T
        return BSpline(self.knots[1:-1], slopes, self.degree - 1)


def knot_intervals(knots: FloatArray, degree: int, x: FloatArray) -> IntArray:
    """Return the index of the knot at the beginning of the interval of each x, shape (N,)."""
    span = np.searchsorted(knots, x, side="right") - 1
    return np.clip(span, degree, len(knots) - degree - 2)


def basis_functions(knots: FloatArray, degree: int, span: IntArray, x: FloatArray) -> FloatArray:
    """Return the basis functions that are not zero at each x (N,), and their derivatives.

    By order, x and control point, from span - degree on, shape (degree+1, N, degree+1); spans are
    as of `knot_intervals`. By the recursions of Cox and de Boor (Piegl & Tiller, "The NURBS Book",
    1997, equations 2.5 and 2.9): a derivative at one degree comes from the derivative of the order
    before at the degree below. Knots and x may be complex, in the order of their real parts.
    """
    dtype = np.result_type(knots, x, float)
    functions = np.ones((1, len(x), 1), dtype=dtype)
    for k in range(1, degree + 1):
        offsets = np.arange(k + 2) - k
        t = knots[span[:, None] + offsets]  # t[:, r] begins function r of this degree
        t_end = knots[span[:, None] + offsets + k]
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.where(t_end.real > t.real, 1 / (t_end - t), 0.0)
        new = np.zeros((k + 1, len(x), k + 1), dtype=dtype)
        padded = np.zeros((len(functions), len(x), k + 2), dtype=dtype)
        padded[:, :, 1:-1] = functions * inverse[:, 1:-1]
        first, second = padded[:, :, :-1], padded[:, :, 1:]
        rising = x[:, None] - t[:, :-1]
        falling = knots[span[:, None] + offsets[1:] + k] - x[:, None]
        new[0] = rising * first[0] + falling * second[0]
        new[1:] = k * (first - second)
        functions = new
    return functions


# ---- B-splines fitted to configurations, at rest at both ends.

REST_POINTS = 3  # equal control points at an end put velocity and acceleration there to zero


def fitted_control_points(
    knots: FloatArray,
    degree: int,
    times: FloatArray,
    path: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    draw: float = 0.0,
) -> FloatArray:
    """Return the control points (K, n) of the least-squares spline at rest at both ends.

    On clamped knots (K+degree+1,) [s] of a degree of at least 3, to configurations (N, n) at times
    (N,) [s]. The first and the last three control points are the ends, (n,) each. Control points
    that no time determines need a weight `draw` > 0 of their squared distance to the joint line.
    """
    count = len(knots) - degree - 1
    span = knot_intervals(knots, degree, times)
    near = span[:, None] + np.arange(-degree, 1)
    weights = basis_functions(knots, degree, span, times)[0]
    inner = slice(REST_POINTS, count - REST_POINTS)
    line = ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0])
    points = np.zeros_like(line)
    points[:REST_POINTS], points[-REST_POINTS:] = ends
    # Normal equations, well conditioned; at each time only degree + 1 weights are not zero.
    normal_matrix, right_side = draw * np.eye(count), draw * line
    pairs = (near[:, :, None], near[:, None])
    np.add.at(normal_matrix, pairs, weights[:, :, None] * weights[:, None])
    residual = path - np.einsum("nk,nkj->nj", weights, points[near])
    np.add.at(right_side, near, weights[:, :, None] * residual[:, None])
    points[inner] = np.linalg.solve(normal_matrix[inner, inner], right_side[inner])
    return points


def times_between(breakpoints: FloatArray, count: int) -> FloatArray:
    """Return `count` inner times of each of P intervals between breakpoints (P+1,): (P count,)."""
    local = (np.arange(count) + 0.5) / count
    times: FloatArray = breakpoints[:-1, None] + local * np.diff(breakpoints)[:, None]
    return times.ravel()


def hermite_pieces(time: FloatArray, known: Sequence[FloatArray]) -> FloatArray:
    """Return the coefficients of the line, cubic or quintic between every two of N samples.

    Hermite interpolation (Biagiotti & Melchiorri, "Trajectory Planning for Automatic Machines and
    Robots", 2008, sections 2.1.1, 2.1.3 and 2.1.5) of K quantities (N, n): positions and, if given,
    velocities and accelerations at times (N,) [s]. The result is (2 K, N-1, n), highest power of
    the time in the piece first. The lower half of the coefficients follow from the first sample,
    the upper half from the gaps between these and the next sample. Gaps are small numbers: pieces a
    millisecond long meet to rounding, where differences of Bernstein coefficients would leave jumps
    of the acceleration of 1e-7 rad/s^2.
    """
    h = np.diff(time)[:, None]
    first, last = [k[:-1] for k in known], [k[1:] for k in known]
    if len(known) == 1:
        return np.stack([(last[0] - first[0]) / h, first[0]])
    if len(known) == 2:
        gap = last[0] - (first[0] + first[1] * h)
        velocity_gap = (last[1] - first[1]) * h
        return np.stack(
            [(velocity_gap - 2 * gap) / h**3, (3 * gap - velocity_gap) / h**2, first[1], first[0]]
        )
    gap = last[0] - (first[0] + (first[1] + first[2] * h / 2) * h)
    velocity_gap = (last[1] - (first[1] + first[2] * h)) * h
    acceleration_gap = (last[2] - first[2]) * h**2
    return np.stack(
        [
            (12 * gap - 6 * velocity_gap + acceleration_gap) / (2 * h**5),
            (-30 * gap + 14 * velocity_gap - 2 * acceleration_gap) / (2 * h**4),
            (20 * gap - 8 * velocity_gap + acceleration_gap) / (2 * h**3),
            first[2] / 2,
            first[1],
            first[0],
        ]
    )
