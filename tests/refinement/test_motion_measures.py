"""Measures of a motion of fixed duration: energy, work, smoothness."""

from dataclasses import replace

import numpy as np
import pytest
from cases import INERTIA, one_joint
from measured_motions import RUN_IN, at_knots, bar, curve, monotone, motion, unbounded

from tubeplanner.constraints.effort_costs import EffortCosts
from tubeplanner.refinement.effort_measures import Energy, Work
from tubeplanner.refinement.smoothness_measures import smoothness_measures
from tubeplanner.trajectory.joint_trajectory import from_spline

# Energy and work as the second stage measures them: closed forms, and bounds.


TRAVEL = np.array([1.3])


def by_interval(step, intervals):
    """Return a step of the control points that count in each interval, (M, 5 n)."""
    taken = np.vstack([step, np.zeros((1, step.shape[1]))])
    return np.array([taken[k : k + 5].ravel() for k in range(intervals)])


def test_energy_is_the_integral_of_squared_efforts_in_one_second(tmp_path):
    """Piecewise linear efforts, for which Simpson's rule is exact."""
    spline = monotone(1, TRAVEL)
    acceleration, _, width = at_knots(spline)
    begin, end = acceleration[:-1], acceleration[1:]
    squared = ((begin**2 + begin * end + end**2) / 3 * width).sum()
    expected = 2.5 * INERTIA**2 * squared / RUN_IN**4
    found = Energy(np.array([2.5])).total(motion(bar(tmp_path), spline))
    assert found == pytest.approx(expected, rel=1e-9)


def test_joints_without_weight_cost_nothing(slide):
    problem, spline = unbounded(slide), monotone(3, np.array([0.9, -0.4, 0.3]))
    at = motion(problem, spline)
    alone = [Energy(weights).total(at) for weights in np.diag([1.0, 2.0, 3.0])]
    assert Energy(np.array([1.0, 0.0, 3.0])).total(at) == pytest.approx(alone[0] + alone[2])
    assert min(alone) > 0


def test_the_model_of_energy_is_exact_where_efforts_are_linear(tmp_path):
    """Those of a bar, in its control points."""
    problem, spline = bar(tmp_path), monotone(1, TRAVEL)
    energy, at, points = Energy(np.array([2.5])), motion(problem, spline), spline.control_points
    step = np.zeros_like(points)
    step[3:-3] = 0.1 * np.random.default_rng(5).normal(size=step[3:-3].shape)
    model = energy.model(at, 3.0)
    change = np.einsum("mrv,mv->mr", model.control, by_interval(step, len(model.slope)))
    expected = (model.slope * change).sum() + (model.curvature * change**2).sum() / 2
    moved = motion(problem, replace(spline, control_points=points + step))
    assert 3.0 * (energy.total(moved) - energy.total(at)) == pytest.approx(expected, rel=1e-9)


def test_of_an_arm_they_are_nearly_those_of_the_trajectory(slide):
    """Between samples efforts bend a little, and power changes its sign."""
    problem, spline = unbounded(slide), monotone(3, np.array([0.9, -0.4, 0.3]))
    trajectory = from_spline(slide.joint_names, spline.bspline()).scaled(RUN_IN)
    at, costs = motion(problem, spline), EffortCosts(slide, trajectory)
    weights = np.array([1.0, 0.5, 2.0])
    assert Energy(weights).total(at) * RUN_IN == pytest.approx(costs.energy(weights), rel=2e-2)
    assert Work(3, 1e-6).total(at) == pytest.approx(costs.work(), rel=5e-2)


def test_work_of_a_bar_is_its_greatest_kinetic_energy_rounded_upwards(tmp_path):
    problem, spline = bar(tmp_path), monotone(1, TRAVEL)
    at = motion(problem, spline)
    speed = curve(spline)(np.linspace(0, 1, 5001), 1).ravel() / RUN_IN
    rises = np.maximum(np.diff(speed**2), 0.0).sum() * INERTIA / 2
    found = [Work(1, nominal).total(at) for nominal in (1e-6, 0.1 * rises, rises)]
    assert found[0] == pytest.approx(rises, rel=5e-2)
    assert found[0] < found[1] < found[2] < 1.5 * rises


def test_work_against_gravity_does_not_depend_on_the_speed(tmp_path):
    """Of a motion so slow that nothing but gravity counts: upwards it is the height."""
    problem, spline = unbounded(one_joint(tmp_path, mass=0.5)), monotone(1, TRAVEL)
    expected = 0.5 * 9.81 * 0.5 * np.sin(1.3)
    found = Work(1, 1e-6).total(motion(problem, spline, 1e3))
    assert found == pytest.approx(expected, rel=1e-3)


def test_the_model_of_work_bends_more_than_power(tmp_path):
    """Power is a product, which bends both ways: what bends downwards is left out."""
    problem, spline = bar(tmp_path), monotone(1, TRAVEL)
    work, at = Work(1, 20.0), motion(problem, spline)
    model, rng = work.model(at, 1.0), np.random.default_rng(5)
    own, points = model.slope.any(axis=0), spline.control_points
    missed = []
    for _ in range(6):
        step = np.zeros_like(points)
        step[3:-3] = 1e-4 * rng.normal(size=step[3:-3].shape)
        sides = [
            work.total(motion(problem, replace(spline, control_points=points + sign * step)))
            for sign in (1, -1)
        ]
        bend = sum(sides) - 2 * work.total(at)
        moved = by_interval(step, len(model.slope))
        bends = model.curvature * np.einsum("mrv,mv->mr", model.control, moved) ** 2
        assert bends.sum() > bend
        missed.append(bend > bends[:, own].sum())
    assert any(missed)  # by the residuals of power alone


# What smoothness is measured by: against closed forms.


RATE, VARIATION, JERK = range(3)


def total(which, problem, spline, run_in=RUN_IN):
    """Return one measure of a spline."""
    _, measure = smoothness_measures(problem, spline, run_in)[which]
    return measure.total(motion(problem, spline, run_in))


def test_jerk_and_effort_rate_are_integrals_of_their_fourth_powers(slide, tmp_path):
    """Joints that hardly move count as if they moved a twentieth of what the farthest does."""
    spline = monotone(3, np.array([0.9, -0.4, 1e-3]))
    _, jerk, width = at_knots(spline)
    expected = ((jerk / np.array([0.9, 0.4, 0.045])) ** 4 * width).sum()
    assert total(JERK, unbounded(slide), spline) == pytest.approx(expected, rel=1e-9)
    spline = monotone(1, TRAVEL)
    _, jerk, width = at_knots(spline)
    expected = ((INERTIA * jerk / RUN_IN**2 / 5.0) ** 4 * width).sum()
    assert total(RATE, bar(tmp_path), spline) == pytest.approx(expected, rel=1e-9)


def test_variation_is_that_of_the_effort_in_limits(tmp_path):
    """Piecewise linear here; what is below a hundredth of the limit counts for less."""
    spline, run_in = monotone(1, TRAVEL), 0.05
    acceleration, _, width = at_knots(spline)
    change = abs(np.diff(acceleration, axis=0)) * INERTIA / run_in**2 / 5.0
    found = total(VARIATION, bar(tmp_path), spline, run_in)
    assert found < change.sum()
    # Two samples for each change.
    assert found == pytest.approx(change.sum() - 2 * len(width) * 0.01, rel=1e-4)


def test_without_a_limit_the_largest_effort_of_the_motion_is_the_unit(tmp_path):
    spline = monotone(1, TRAVEL)
    problem = bar(tmp_path, effort=np.inf, acceleration=50.0)
    acceleration, _, width = at_knots(spline)
    largest = abs(curve(spline)(np.linspace(0, 1, 200), 2)).max()
    expected = abs(np.diff(acceleration, axis=0)).sum() / largest
    found = total(VARIATION, problem, spline, 1e-3)
    assert expected - 2 * len(width) * 0.01 < found < expected
