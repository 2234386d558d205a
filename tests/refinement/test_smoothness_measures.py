"""What smoothness is measured by: against closed forms."""

import numpy as np
import pytest

from cases import INERTIA
from measured_motions import RUN_IN, at_knots, bar, curve, monotone, motion, unbounded
from tubeplanner.refinement.smoothness_measures import smoothness_measures

RATE, VARIATION, JERK = range(3)


def total(which, problem, spline, run_in=RUN_IN):
    """Return one measure of a spline."""
    _, measure = smoothness_measures(problem, spline, run_in)[which]
    return measure.total(motion(problem, spline, run_in))


def test_jerk_is_the_integral_of_its_fourth_power_in_the_joints_travel(slide):
    """Joints that hardly move count as if they moved a twentieth of what the farthest does."""
    travel = np.array([0.9, -0.4, 1e-3])
    spline = monotone(3, travel)
    _, jerk, width = at_knots(spline)
    expected = ((jerk / np.array([0.9, 0.4, 0.045])) ** 4 * width).sum()
    assert total(JERK, unbounded(slide), spline) == pytest.approx(expected, rel=1e-9)


def test_variation_is_that_of_the_effort_in_limits(tmp_path):
    """Piecewise linear here; what is below a hundredth of the limit counts for less."""
    spline, run_in = monotone(1, np.array([1.3])), 0.05
    acceleration, _, width = at_knots(spline)
    change = abs(np.diff(acceleration, axis=0)) * INERTIA / run_in**2 / 5.0
    found = total(VARIATION, bar(tmp_path), spline, run_in)
    assert found < change.sum()
    # Two samples for each change.
    assert found == pytest.approx(change.sum() - 2 * len(width) * 0.01, rel=1e-4)


def test_effort_rate_is_the_integral_of_its_fourth_power(tmp_path):
    spline = monotone(1, np.array([1.3]))
    _, jerk, width = at_knots(spline)
    expected = ((INERTIA * jerk / RUN_IN**2 / 5.0) ** 4 * width).sum()
    found = total(RATE, bar(tmp_path), spline)
    assert found == pytest.approx(expected, rel=1e-9)


def test_without_a_limit_the_largest_effort_of_the_motion_is_the_unit(tmp_path):
    spline = monotone(1, np.array([1.3]))
    problem = bar(tmp_path, effort=np.inf, acceleration=50.0)
    acceleration, _, width = at_knots(spline)
    largest = abs(curve(spline)(np.linspace(0, 1, 200), 2)).max()
    expected = abs(np.diff(acceleration, axis=0)).sum() / largest
    found = total(VARIATION, problem, spline, 1e-3)
    assert expected - 2 * len(width) * 0.01 < found < expected
