"""B-splines, fits to configurations; lines, cubics and quintics between samples."""

import numpy as np
import pytest
from scipy import interpolate
from scipy.interpolate import BPoly, PPoly

from tubeplanner.trajectory.polynomials import (
    BSpline,
    fitted_control_points,
    hermite_pieces,
    times_between,
)


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


def test_control_points_are_those_of_dense_least_squares():
    degree, rng = 5, np.random.default_rng(5)
    breakpoints = np.cumsum([0.0, *rng.uniform(0.1, 0.3, 12)])
    knots = np.pad(breakpoints, degree, mode="edge")
    times = times_between(breakpoints, 6)
    path, ends = rng.normal(size=(len(times), 4)), tuple(rng.normal(size=(2, 4)))
    control_points = fitted_control_points(knots, degree, times, path, ends)
    design = interpolate.BSpline(knots, np.eye(12 + degree), degree)(times)
    clamped = np.vstack([np.tile(ends[0], (3, 1)), np.tile(ends[1], (3, 1))])
    edges = np.r_[0:3, -3:0]
    rest = path - design[:, edges] @ clamped
    inner = np.linalg.lstsq(design[:, 3:-3], rest, rcond=None)[0]
    np.testing.assert_allclose(control_points[edges], clamped)
    np.testing.assert_allclose(control_points[3:-3], inner, atol=1e-9)


def test_points_that_no_time_says_anything_about_are_on_the_joint_line():
    knots = np.pad(np.linspace(0, 1, 11), 3, mode="edge")
    times, ends = np.linspace(0.01, 0.3, 20), (np.zeros(2), np.ones(2))
    control_points = fitted_control_points(knots, 3, times, np.zeros((20, 2)), ends, draw=1e-8)
    np.testing.assert_allclose(control_points[7:10], np.linspace(0, 1, 13)[7:10, None] * [1, 1])


def test_times_between_lie_evenly_inside_their_intervals():
    times = times_between(np.array([0.0, 1.0, 3.0]), 2)
    assert times.tolist() == [0.25, 0.75, 1.5, 2.5]


@pytest.mark.parametrize("orders", [1, 2, 3])
def test_they_are_those_of_another_library(orders):
    random = np.random.default_rng(orders)
    time = np.cumsum(random.uniform(0.1, 0.6, 9))
    derivatives = [random.normal(size=(9, 3)) for _ in range(orders)]
    expected = PPoly.from_bernstein_basis(
        BPoly.from_derivatives(time, np.stack(derivatives, axis=1))
    )
    np.testing.assert_allclose(hermite_pieces(time, derivatives), expected.c, rtol=1e-9, atol=1e-9)


def test_samples_a_millisecond_apart_join_to_rounding():
    """Positions far from zero have the fewest digits behind the point."""
    time = np.arange(2000) / 1000
    tables = [3 + np.sin(time), np.cos(time), -np.sin(time)]
    pieces = PPoly(hermite_pieces(time, [k[:, None] for k in tables]), time)
    ends = np.nextafter(time[1:-1], 0.0)
    for order, size in ((0, 3.0), (1, 1.0), (2, 1.0)):
        left, right = pieces(ends, order), pieces(time[1:-1], order)
        assert abs(left - right).max() <= 1e-11 * size
