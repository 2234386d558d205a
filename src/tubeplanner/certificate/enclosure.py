"""Polynomial enclosures of quantities along a trajectory, for all t: theorem and rounding.

On each of I intervals the quantity is interpolated at Chebyshev points. What the polynomial misses
between them is bounded by the majorant of the next Taylor coefficient, T:

    |f(u) - P(u)| <= T max |product of (u - u_i)| = T 2 / 4^N

for N points on an interval of width one (Davis, "Interpolation and Approximation", 1963, theorem
3.1.1). Intervals are halved until that is negligible. Rounding errors, some 1e-12, are not bounded.
The polynomial's derivative misses no more of the quantity's than T max |derivative of that product|
= T 4 N^2 / 4^N (Shadrin, "Error bounds for Lagrange interpolation", 1995).

What is enclosed is a `Quantity`: its values, and a majorant made from the series of `majorants`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import comb

import numpy as np
from numpy.polynomial import chebyshev

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import bernstein_coefficients, halves

_POINTS = 8
_NODES = (chebyshev.chebpts1(_POINTS) + 1) / 2
_NODE_PRODUCT = 2.0 / 4.0**_POINTS
_SLOPE_OF_PRODUCT = 4.0 * _POINTS**2 / 4.0**_POINTS
# From values at the nodes to coefficients, highest power first.
_FIT = np.linalg.inv(np.vander(_NODES))
# A trajectory that is not enclosed after so many intervals is left as it is: its errors are large.
_MAX_INTERVALS = 200_000
_MIN_WIDTH = 1e-9  # [s]


@dataclass(frozen=True, eq=False)
class Quantity:
    """What follows from the joints of a trajectory at every instant: c components.

    Attributes:
        derivatives: How many derivatives of the joint positions it depends on.
        values: From joint positions and these derivatives, each (N, n), to the values, (N, c).
        majorant: From bounds on the Taylor coefficients of the joint positions over I intervals,
            shape (orders, I, n), in widths of the intervals, and from these widths (I,) [s], to
            bounds on the coefficients of the quantity, shape (orders - derivatives, I, c).
    """

    derivatives: int
    values: Callable[..., FloatArray]
    majorant: Callable[[FloatArray, FloatArray], FloatArray]


def total(terms: Iterable[Quantity]) -> Quantity:
    """Return the sum of quantities: no term has values without bounds on them, or the reverse."""
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
    """A quantity of c components over I intervals, as polynomials of local time u from 0 to 1.

    Attributes:
        start: Start of each interval, shape (I,) [s].
        width: Width of each interval, shape (I,) [s].
        coefficients: Shape (N, I, c), highest power first.
        error: How far the quantity may be from the polynomials, shape (I, c).
    """

    start: FloatArray
    width: FloatArray
    coefficients: FloatArray
    error: FloatArray

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
    """Halve intervals until the interpolation's error is below the tolerance everywhere.

    Args:
        trajectory: Of n joints.
        quantity: What is enclosed.
        tolerance: How large the errors of its components may be, shape (c,).
    """

    def missed(majorant: FloatArray, width: FloatArray) -> FloatArray:
        return _NODE_PRODUCT * majorant

    return _interpolated(trajectory, quantity, tolerance, missed)


def enclosed_rate(
    trajectory: JointTrajectory, quantity: Quantity, tolerance: FloatArray
) -> Enclosure:
    """Enclose likewise the time derivative of a quantity, inside the trajectory's pieces.

    Where it jumps, at breakpoints, both sides are enclosed.

    Args:
        trajectory: Of n joints.
        quantity: Whose derivative is enclosed.
        tolerance: How large the errors of its components may be, shape (c,) [per s].
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
    """Return a quantity's polynomials on intervals so short that nothing more is missed.

    Args:
        trajectory: Of n joints.
        quantity: What is interpolated.
        tolerance: How much may be missed, shape (c,).
        missed_of: From the majorants of the next Taylor coefficients, (I, c), and the widths of the
            intervals (I,) [s] to what is missed, (I, c).
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
    states = _states(trajectory, piece, start, width, quantity.derivatives)
    values = quantity.values(*states)
    values = values.reshape(len(piece), _POINTS, -1)
    coefficients = np.einsum("kp,ipc->kic", _FIT, values)
    return Enclosure(trajectory.breakpoints[piece] + start, width, coefficients, missed)


def joint_bounds(
    trajectory: JointTrajectory,
    piece: IntArray,
    start: FloatArray,
    width: FloatArray,
    orders: int,
) -> FloatArray:
    """Return bounds on the Taylor coefficients of the joint positions, in widths of the intervals.

    The k-th derivative of a polynomial has as Bernstein coefficients the k-th differences of the
    polynomial's own, times degree! / (degree - k)!.

    Args:
        trajectory: Of n joints.
        piece: The piece that each interval is in: int, shape (I,).
        start: Start of each interval in its piece, shape (I,) [s].
        width: Width of each interval, shape (I,) [s].
        orders: How many coefficients, from the constant one.

    Returns:
        Shape (orders, I, n).
    """
    hull = bernstein_coefficients(trajectory.coefficients[:, piece], start, width)
    degree = len(hull) - 1
    bounds = np.zeros((orders, *hull.shape[1:]))
    for k in range(min(degree + 1, len(bounds))):
        bounds[k] = comb(degree, k) * abs(np.diff(hull, n=k, axis=0)).max(axis=0)
    return bounds


def _states(
    trajectory: JointTrajectory,
    piece: IntArray,
    start: FloatArray,
    width: FloatArray,
    derivatives: int,
) -> list[FloatArray]:
    """Return positions and so many derivatives at the nodes of all intervals, each (I N, n).

    Evaluated piece by piece, so that no rounding of times crosses a breakpoint.
    """
    local = start[:, None] + width[:, None] * _NODES
    joints = trajectory.coefficients.shape[2]
    states = []
    for order in range(derivatives + 1):
        value = np.zeros((*local.shape, joints))
        for row in trajectory.derivative_coefficients(order):
            value = value * local[:, :, None] + row[piece][:, None]
        states.append(value.reshape(-1, joints))
    return states
