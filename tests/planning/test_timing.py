"""Durations and periods, at the edges of rounding too."""

import numpy as np
import pytest

from tubeplanner import JointTrajectory
from tubeplanner.planning.timing import fewest_periods, lengthened, most_periods, no_longer

PERIOD = 0.001


@pytest.fixture
def trajectory():
    """A cubic in three pieces that takes 0.3 s, its breakpoints multiples of 0.01 s."""
    coefficients = np.random.default_rng(0).normal(size=(4, 3, 2))
    return JointTrajectory(["a", "b"], [0.0, 0.1, 0.17, 0.3], coefficients)


@pytest.mark.parametrize(
    ("duration", "fewest", "most"),
    [
        (0.5, 500, 500),
        (0.5 + 5e-13, 500, 500),
        (0.5 - 5e-13, 500, 500),
        (0.5 + 5e-12, 501, 500),
        (0.5 - 5e-12, 500, 499),
        (0.4996, 500, 499),
        (0.0004, 1, 0),
        (0.0, 1, 0),
    ],
)
def test_periods_are_counted_but_for_rounding(duration, fewest, most):
    assert fewest_periods(duration, PERIOD) == fewest
    assert most_periods(duration, PERIOD) == most


@pytest.mark.parametrize("count", [3, 7, 29, 58, 115, 8191])
@pytest.mark.parametrize("period", [0.1, 0.001, 1 / 3, 0.008, 1e-5])
def test_a_multiple_has_as_many_periods_as_it_was_made_of(count, period):
    for duration in (
        count * period,
        np.nextafter(count * period, 0),
        np.nextafter(count * period, 9),
    ):
        assert fewest_periods(duration, period) == most_periods(duration, period) == count


@pytest.mark.parametrize(
    ("duration", "holds"), [(1.0, True), (0.9, True), (1 + 5e-10, True), (1 + 5e-9, False)]
)
def test_durations_are_compared_but_for_rounding(duration, holds):
    assert no_longer(duration, 1.0) is holds
    assert no_longer(3 * duration, 3.0) is holds


def test_a_motion_that_takes_longer_stays_as_it_is(trajectory):
    assert lengthened(trajectory, 0.2) is trajectory
    assert lengthened(trajectory, 0.2, PERIOD) is trajectory


def test_a_shorter_one_is_run_more_slowly(trajectory):
    slower = lengthened(trajectory, 0.6)
    np.testing.assert_allclose(slower.breakpoints, 2 * trajectory.breakpoints)
    np.testing.assert_allclose(slower.position(0.46), trajectory.position(0.23), rtol=1e-12)


def test_in_periods_rounding_is_taken_off_the_breakpoints_and_no_more(trajectory):
    periods = np.array([0, 10, 17, 30])
    off = JointTrajectory(
        trajectory.joint_names,
        trajectory.breakpoints / 3 * (1 + 1e-14 * np.arange(4)),
        trajectory.coefficients,
    )
    slower = lengthened(off, 30 * 0.02, 0.02)
    np.testing.assert_array_equal(slower.breakpoints, periods * 0.02)
    plain = off.scaled(6 * (1 - 3e-14))
    np.testing.assert_allclose(slower.coefficients, plain.coefficients, rtol=1e-12)
