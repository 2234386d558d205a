"""Piecewise polynomials against scipy's."""

import numpy as np
import pytest
from scipy.interpolate import PPoly

from tubeplanner.trajectory.piecewise_polynomial import PiecewisePolynomial


@pytest.mark.parametrize("degree", [0, 1, 5])
def test_values_and_derivatives_are_those_of_scipy(degree):
    rng = np.random.default_rng(degree)
    breakpoints = np.cumsum([0.0, *rng.uniform(0.1, 0.5, 4)])
    coefficients = rng.normal(size=(degree + 1, 4, 2))
    reference = PPoly(coefficients, breakpoints)
    t = np.append(rng.uniform(-0.1, breakpoints[-1] + 0.1, 55), breakpoints).reshape(12, 5)
    for order in range(4):
        found = PiecewisePolynomial(coefficients, breakpoints).derivative(order)
        np.testing.assert_allclose(found(t), reference(t, order), rtol=1e-12, atol=1e-12)
        assert found.coefficients.shape == reference.derivative(order).c.shape
    assert found(t[0, 0]).shape == (2,)
