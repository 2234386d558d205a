"""Polynomial enclosures of quantities along a trajectory, for all t: theorem and rounding.

On each of I intervals the quantity is interpolated at Chebyshev points. The polynomial's error
between these points is bounded by the majorant of the next Taylor coefficient, T:

    |f(u) - P(u)| <= T max |product of (u - u_i)| = T 2 / 4^N

for N points on an interval of width one (Davis, "Interpolation and Approximation", 1963, theorem
3.1.1). Intervals are halved until that is negligible. Rounding errors, some 1e-12, are not bounded.
The error of the polynomial's derivative is at most T max |derivative of that product|
= T 4 N^2 / 4^N (Shadrin, "Error bounds for Lagrange interpolation", 1995).

A `Quantity` gives values, and a majorant made from the series of `enclosed_quantities`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import bernstein_coefficients, halves

_POINTS = 8
_NODES = (np.sin(np.pi / 2 / _POINTS * np.arange(1 - _POINTS, _POINTS, 2)) + 1) / 2  # Chebyshev's
# Largest values on [0, 1] of the product of the distances from all nodes, and of its derivative:
# the errors of an interpolation and of its derivative are in proportion to them.
_NODE_PRODUCT = 2.0 / 4.0**_POINTS
_SLOPE_OF_PRODUCT = 4.0 * _POINTS**2 / 4.0**_POINTS
# From values at the nodes to coefficients, highest power first.
_FIT = np.linalg.inv(np.vander(_NODES))
# After this many intervals none is halved any more: the errors of such a trajectory stay large.
_MAX_INTERVALS = 200_000
_MIN_WIDTH = 1e-9  # [s]


@dataclass(frozen=True, eq=False)
class Quantity:
    """A function of the joints of a trajectory at every instant, of c components."""

    derivatives: int  # number of derivatives of the joint positions that it depends on
    # from joint positions and these derivatives, each (N, n), to the values, (N, c)
    values: Callable[..., FloatArray]
    # from bounds on the Taylor coefficients of joint positions, (orders, I, n), and widths of the I
    # intervals, (I,) [s], to bounds on those of the quantity, (orders - derivatives, I, c); time
    # runs from 0 to 1 over each interval
    majorant: Callable[[FloatArray, FloatArray], FloatArray]


def total(terms: Iterable[Quantity]) -> Quantity:
    """Return the sum of quantities: values and majorants are sums over the same terms."""
    terms = tuple(terms)
    highest = max(term.derivatives for term in terms)

    def values(*states: FloatArray) -> FloatArray:
        return np.sum([term.values(*states[: term.derivatives + 1]) for term in terms], axis=0)

    def majorant(joints: FloatArray, width: FloatArray) -> FloatArray:
        # Terms of fewer derivatives are known to more orders than the others.
        return np.sum(
            [term.majorant(joints, width)[: len(joints) - highest] for term in terms], axis=0
        )

    return Quantity(highest, values, majorant)


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A quantity of c components over I intervals, as polynomials of local time u from 0 to 1."""

    start: FloatArray  # start of each interval, shape (I,) [s]
    width: FloatArray  # width of each interval, shape (I,) [s]
    coefficients: FloatArray  # shape (N, I, c), highest power first
    error: FloatArray  # bound on the distance of the quantity from the polynomials, shape (I, c)

    def at(self, time: FloatArray) -> FloatArray:
        """Return the polynomials' values at times (N,) [s], shape (N, c)."""
        interval = np.clip(np.searchsorted(self.start, time, "right") - 1, 0, None)
        return self.within(interval, (time - self.start[interval]) / self.width[interval])

    def within(self, interval: IntArray, u: FloatArray) -> FloatArray:
        """Return the values in intervals (N,) at their local times u (N,), shape (N, c)."""
        value = np.zeros((len(u), self.coefficients.shape[2]))
        for row in self.coefficients:
            value = value * u[:, None] + row[interval]
        return value


def enclosed(trajectory: JointTrajectory, quantity: Quantity, tolerance: FloatArray) -> Enclosure:
    """Return polynomials on intervals halved until their errors are within the tolerance.

    Args:
        trajectory: Of n joints.
        quantity: The quantity to enclose.
        tolerance: Largest errors of its components, shape (c,).
    """

    def missed(majorant: FloatArray, width: FloatArray) -> FloatArray:
        return _NODE_PRODUCT * majorant

    return _interpolated(trajectory, quantity, tolerance, missed)


def enclosed_rate(
    trajectory: JointTrajectory, quantity: Quantity, tolerance: FloatArray
) -> Enclosure:
    """Return the enclosure of a quantity's time derivative, inside the trajectory's pieces.

    Where the derivative jumps, at breakpoints, both sides are enclosed.

    Args:
        trajectory: Of n joints.
        quantity: The quantity whose derivative is enclosed.
        tolerance: Largest errors of the derivative's components, shape (c,) [per s].
    """

    def missed(majorant: FloatArray, width: FloatArray) -> FloatArray:
        bound: FloatArray = _SLOPE_OF_PRODUCT * majorant / width[:, None]
        return bound

    whole = _interpolated(trajectory, quantity, tolerance, missed)
    powers = np.arange(_POINTS - 1, 0, -1)
    slopes = whole.coefficients[:-1] * powers[:, None, None] / whole.width[:, None]
    return replace(whole, coefficients=slopes)


def _interpolated(
    trajectory: JointTrajectory,
    quantity: Quantity,
    tolerance: FloatArray,
    missed_of: Callable[[FloatArray, FloatArray], FloatArray],
) -> Enclosure:
    """Return a quantity's polynomials on intervals that are short enough for a tolerance.

    Args:
        trajectory: Of n joints.
        quantity: The quantity to interpolate.
        tolerance: Largest errors, shape (c,).
        missed_of: From the majorants of the next Taylor coefficients, (I, c), and the widths of the
            intervals (I,) [s] to bounds on the errors, (I, c).
    """
    orders = _POINTS + 1 + quantity.derivatives
    pieces = len(trajectory.widths)
    piece: IntArray = np.arange(pieces)
    start, width = np.zeros(pieces), trajectory.widths
    done: list[tuple[IntArray, FloatArray, FloatArray, FloatArray]] = []
    count = 0
    while len(piece):
        joints = joint_bounds(trajectory, piece, start, width, orders)
        missed = missed_of(quantity.majorant(joints, width)[_POINTS], width)
        count += len(piece)
        coarse = np.any(missed > tolerance, axis=1) & (width > _MIN_WIDTH)
        coarse &= count < _MAX_INTERVALS
        fine = ~coarse
        done.append((piece[fine], start[fine], width[fine], missed[fine]))
        piece = np.repeat(piece[coarse], 2)
        start, width = halves(start[coarse], width[coarse])
    piece = np.concatenate([part[0] for part in done])
    start, width, missed = (np.concatenate([part[i] for part in done]) for i in (1, 2, 3))
    order = np.lexsort((start, piece))
    piece, start, width, missed = piece[order], start[order], width[order], missed[order]
    # Positions and derivatives at the nodes of all intervals, each (I N, n): evaluated piece by
    # piece, so that no rounding of times crosses a breakpoint.
    local = start[:, None] + width[:, None] * _NODES
    joint_count = trajectory.coefficients.shape[2]
    states = []
    for derivative in range(quantity.derivatives + 1):
        value = np.zeros((*local.shape, joint_count))
        for row in trajectory.derivative_coefficients(derivative):
            value = value * local[:, :, None] + row[piece][:, None]
        states.append(value.reshape(-1, joint_count))
    values = quantity.values(*states)
    values = values.reshape(len(piece), _POINTS, -1)
    coefficients = np.einsum("kp,ipc->kic", _FIT, values)
    return Enclosure(trajectory.breakpoints[piece] + start, width, coefficients, missed)


def joint_bounds(
    trajectory: JointTrajectory, piece: IntArray, start: FloatArray, width: FloatArray, orders: int
) -> FloatArray:
    """Return bounds on the Taylor coefficients of the joint positions, in widths of the intervals.

    The k-th derivative of a polynomial has as Bernstein coefficients the k-th differences of the
    polynomial's own, times degree! / (degree - k)!.

    Args:
        trajectory: Of n joints.
        piece: Index of the piece that holds each interval, shape (I,).
        start: Start of each interval in its piece, shape (I,) [s].
        width: Width of each interval, shape (I,) [s].
        orders: Number of coefficients, from the constant.

    Returns:
        Shape (orders, I, n).
    """
    hull = bernstein_coefficients(trajectory.coefficients[:, piece], start, width)
    degree = len(hull) - 1
    bounds = np.zeros((orders, *hull.shape[1:]))
    for k in range(min(degree + 1, len(bounds))):
        bounds[k] = comb(degree, k) * abs(np.diff(hull, n=k, axis=0)).max(axis=0)
    return bounds
