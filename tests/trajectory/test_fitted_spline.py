"""Fitted splines against a dense least-squares solver."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from tubeplanner.trajectory.fitted_spline import fitted_control_points, times_between


@pytest.mark.parametrize("degree", [3, 5])
def test_control_points_are_those_of_dense_least_squares(degree):
    rng = np.random.default_rng(degree)
    breakpoints = np.cumsum([0.0, *rng.uniform(0.1, 0.3, 12)])
    knots = np.pad(breakpoints, degree, mode="edge")
    times = times_between(breakpoints, 6)
    path, ends = rng.normal(size=(len(times), 4)), tuple(rng.normal(size=(2, 4)))
    found = fitted_control_points(knots, degree, times, path, ends)
    design = BSpline(knots, np.eye(12 + degree), degree)(times)
    clamped = np.vstack([np.tile(ends[0], (3, 1)), np.tile(ends[1], (3, 1))])
    edges = np.r_[0:3, -3:0]
    rest = path - design[:, edges] @ clamped
    inner = np.linalg.lstsq(design[:, 3:-3], rest, rcond=None)[0]
    np.testing.assert_allclose(found[edges], clamped)
    np.testing.assert_allclose(found[3:-3], inner, atol=1e-9)


def test_points_that_no_time_says_anything_about_are_on_the_joint_line():
    knots = np.pad(np.linspace(0, 1, 11), 3, mode="edge")
    times, ends = np.linspace(0.01, 0.3, 20), (np.zeros(2), np.ones(2))
    found = fitted_control_points(knots, 3, times, np.zeros((20, 2)), ends, draw=1e-8)
    np.testing.assert_allclose(found[7:10], np.linspace(0, 1, 13)[7:10, None] * [1, 1])


def test_times_between_lie_evenly_inside_their_intervals():
    times = times_between(np.array([0.0, 1.0, 3.0]), 2)
    assert times.tolist() == [0.25, 0.75, 1.5, 2.5]
