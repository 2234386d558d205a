"""B-splines by the recursions of Cox and de Boor."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class BSpline:
    """A B-spline; called with times x of shape (N,), it gives values of shape (N, ...).

    Attributes:
        knots: Clamped knot vector, shape (K+degree+1,).
        control_points: Shape (K, ...).
        degree: At least 1.
    """

    knots: FloatArray
    control_points: FloatArray
    degree: int

    def __call__(self, x: FloatArray, order: int = 0) -> FloatArray:
        """Return a derivative of an order up to the degree; 0: the values.

        Where it jumps, at a knot, that of the interval after it.
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
    """Return the index of the knot that begins the interval of each x, shape (N,)."""
    span = np.searchsorted(knots, x, side="right") - 1
    return np.clip(span, degree, len(knots) - degree - 2)


def basis_functions(knots: FloatArray, degree: int, span: IntArray, x: FloatArray) -> FloatArray:
    """Return the basis functions that count at each x, and their derivatives.

    Args:
        knots: Clamped knot vector.
        degree: Of the spline.
        span: For each x, the knot that begins the interval that counts, shape (N,).
        x: Shape (N,).

    Returns:
        By order, x and control point, from span - degree on, shape (degree+1, N, degree+1).

    By the recursions of Cox and de Boor (Piegl & Tiller, "The NURBS Book", 1997, equations 2.5 and
    2.9): the order-th derivative at one degree comes from the order before at the degree below.
    Knots and x may be complex, in the order of their real parts.
    """
    dtype = np.result_type(knots, x, float)
    known = np.ones((1, len(x), 1), dtype=dtype)
    for k in range(1, degree + 1):
        offsets = np.arange(k + 2) - k
        t = knots[span[:, None] + offsets]  # t[:, r] begins function r of this degree
        t_end = knots[span[:, None] + offsets + k]
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.where(t_end.real > t.real, 1 / (t_end - t), 0.0)
        new = np.zeros((k + 1, len(x), k + 1), dtype=dtype)
        padded = np.zeros((len(known), len(x), k + 2), dtype=dtype)
        padded[:, :, 1:-1] = known * inverse[:, 1:-1]
        left, right = padded[:, :, :-1], padded[:, :, 1:]
        rising = x[:, None] - t[:, :-1]
        falling = knots[span[:, None] + offsets[1:] + k] - x[:, None]
        new[0] = rising * left[0] + falling * right[0]
        new[1:] = k * (left - right)
        known = new
    return known
