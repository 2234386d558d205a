"""Piecewise polynomials of one variable."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """Polynomials between breakpoints; the first and the last one go on beyond them.

    Attributes:
        coefficients: Shape (degree+1, pieces, n), highest power first, local time
            `t - breakpoints[i]`.
        breakpoints: Shape (pieces+1,), increasing.
    """

    coefficients: FloatArray
    breakpoints: FloatArray

    def __call__(self, t: FloatArray) -> FloatArray:
        """Return the values at times of any shape (...,): shape (..., n).

        At a breakpoint, that of the piece after it.
        """
        last = len(self.breakpoints) - 2
        piece = np.clip(np.searchsorted(self.breakpoints, t, side="right") - 1, 0, last)
        local = (t - self.breakpoints[piece])[..., None]
        value = self.coefficients[0][piece]
        for row in self.coefficients[1:]:
            value = value * local + row[piece]
        return value

    def derivative(self, order: int) -> "PiecewisePolynomial":
        """Return the derivative of an order; of at least one row of coefficients."""
        coefficients = self.coefficients
        for _ in range(order):
            powers = np.arange(len(coefficients) - 1, 0, -1.0)
            lower = coefficients[:-1] * powers[:, None, None]
            coefficients = lower if len(lower) else np.zeros_like(coefficients)
        return PiecewisePolynomial(coefficients, self.breakpoints)
