"""B-splines against scipy's."""

import numpy as np
import pytest
from scipy import interpolate

from tubeplanner.trajectory.b_spline import BSpline


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_values_and_derivatives_are_those_of_scipy(degree):
    rng = np.random.default_rng(degree)
    breakpoints = np.cumsum([0.0, *rng.uniform(0.1, 0.5, 7)])
    knots = np.pad(breakpoints, degree, mode="edge")
    control_points = rng.normal(size=(7 + degree, 2, 3))
    reference = interpolate.BSpline(knots, control_points, degree)
    x = np.concatenate([breakpoints, rng.uniform(0, breakpoints[-1], 50)])
    spline = BSpline(knots, control_points, degree)
    for order in range(degree + 1):
        expected = reference(x, order)
        np.testing.assert_allclose(spline(x, order), expected, atol=1e-12 * abs(expected).max())


def test_what_rests_has_no_derivative_at_all():
    knots = np.pad(np.array([0.0, 1e-4, 0.3, 1.0]), 3, mode="edge")
    spline = BSpline(knots, np.array([0.1, 0.1, 0.1, 0.7, 0.7, 0.7]), 3)
    assert [spline(np.array([0.0]), order).item() for order in (1, 2)] == [0.0, 0.0]
