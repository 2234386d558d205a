"""Objective of a step: duration or a measure; damping, proximity."""

from dataclasses import replace

import numpy as np
import pytest
from begun_splines import begun, constraints_of
from measured_motions import (
    RUN_IN,
    SWITCHING_TIMES,
    at_knots,
    curve,
    evaluated,
    monotone,
    unbounded,
)

from tubeplanner.refinement.control_variables import ControlVariables
from tubeplanner.refinement.measured_objective import _FIRST_WORTH as FIRST_WORTH
from tubeplanner.refinement.measured_objective import MeasuredObjective
from tubeplanner.refinement.phased_spline import PhasedSpline
from tubeplanner.refinement.smoothness_measures import smoothness_measures
from tubeplanner.refinement.step_block import Step
from tubeplanner.refinement.step_cost import _PROXIMITY, _SMOOTHING, StepCost

# The quadratic part of a step's cost is what it says it is.


DAMPING = 0.7


@pytest.fixture(scope="module", params=["ur5/over_the_wall", "panda/between_shelves"])
def cost_case(request, bundled):
    """A problem with an open goal, and one with a given one."""
    problem = bundled(request.param)
    spline = begun(problem, 12)
    variables = ControlVariables(problem, spline.grid)
    return spline, variables, StepCost(variables, spline.grid, problem.robot.joint_count)


def cost(spline, variables, step, switching):
    """Return smoothing, proximity and damping of a step, written out.

    A motion of an even speed whose phase becomes wider by some share is slower by that share.
    """
    intervals, change = spline.grid.interval_count, variables.change(step)
    bends = np.diff(spline.control_points + change, 3, axis=0)
    smoothing = _SMOOTHING * intervals**5 / 250_000 * (bends**2).sum()
    rates = intervals * (np.diff(change, axis=0) ** 2).sum()
    squared_speed = intervals * (np.diff(spline.control_points, axis=0) ** 2).sum()
    widths = np.diff(spline.switching_times)
    wider = np.diff(np.concatenate([[0.0], switching, [0.0]])) / widths
    rates += squared_speed * (widths * wider**2).sum()
    return smoothing + (_PROXIMITY * (step**2).sum() + DAMPING * rates) / 2


def test_it_is_the_cost_of_a_step_but_for_what_there_was_before(cost_case):
    """Squared rates are what is damped; everything that may change has some curvature.

    Else the solver's program would have no single answer.
    """
    spline, variables, step_cost = cost_case
    rng = np.random.default_rng(0)
    step = 0.01 * rng.normal(size=variables.lower.shape)
    switching = 0.02 * rng.normal(size=spline.grid.switch_count)
    quadratic, undamped = (step_cost.quadratic(spline, w) for w in (DAMPING, 0.0))
    x = np.concatenate([step.ravel(), switching, [0.0, 0.0]])
    found = quadratic.gradient @ x[:-2] + x @ quadratic.hessian.product(x) / 2
    before = cost(spline, variables, np.zeros_like(step), np.zeros_like(switching))
    assert found == pytest.approx(cost(spline, variables, step, switching) - before, rel=1e-6)
    assert not quadratic.gradient[step.size :].any() and quadratic.duration == 1
    rates = quadratic.hessian.dense() - undamped.hessian.dense()
    squared_rates = step_cost.squared_rates(spline, step, switching)
    assert DAMPING * squared_rates == pytest.approx(x @ (rates @ x), rel=1e-9)
    assert np.linalg.eigvalsh(step_cost.quadratic(spline).hessian.dense()).min() > 0


# What steps of the second stage gain: the model of its measures near a trajectory.


def smoothness(problem, spline, run_in):
    return MeasuredObjective(smoothness_measures(problem, spline, run_in), run_in)


def jerk_alone(problem, spline, run_in):
    """The jerk, its logarithm unweighted."""
    _, jerk = smoothness_measures(problem, spline, run_in)[2]
    return MeasuredObjective(((1.0, jerk),), run_in)


class Model:
    """The objective's own convex quadratic near a spline."""

    def __init__(self, problem, spline, run_in=RUN_IN, objective=smoothness):
        self.problem, self.spline = problem, spline
        self.variables = ControlVariables(problem, spline.grid)
        self.cost = StepCost(self.variables, spline.grid, problem.robot.joint_count)
        self.objective = objective(problem, spline, run_in)
        self.constraints = constraints_of(problem, spline.grid, run_in=run_in)
        self.here = self.constraints.at(spline)
        regular = self.cost.quadratic(spline)
        whole = self.objective.cost(self.here, self.variables, regular)
        self.hessian = (whole.hessian.dense() - regular.hessian.dense())[:-2, :-2]
        self.gradient = whole.gradient - regular.gradient

    def step(self, scale, switching=0.0):
        control = scale * np.random.default_rng(3).normal(size=self.variables.lower.shape)
        return Step(control, np.array([switching]), 0.0, 0.0, np.zeros(0))

    def moved(self, step):
        points = self.variables.moved(self.spline.control_points, step.control)
        times = self.spline.switching_times + np.array([0.0, step.switching[0], 0.0])
        return self.constraints.at(PhasedSpline(self.spline.grid, times, points))


def with_given_goal(case):
    problem, spline, _ = case
    return replace(problem, goal=spline.control_points[-1]), spline


@pytest.fixture(scope="module")
def model(case):
    return Model(*with_given_goal(case))


def test_the_model_is_convex(model):
    values = np.linalg.eigvalsh(model.hessian)
    np.testing.assert_allclose(model.hessian, model.hessian.T, atol=1e-12 * values.max())
    assert values.min() > -1e-10 * values.max()


@pytest.mark.parametrize(("scale", "switching"), [(1e-5, 0.0), (0.0, 1e-6)])
def test_a_small_step_gains_what_it_should(model, scale, switching):
    step, within = model.step(scale, switching), 100.0  # [s]: time has no price
    slow = Model(model.problem, model.spline, within)
    predicted = slow.objective.predicted_gain(slow.here, step)
    gained = slow.objective.gain(slow.here, slow.moved(step))
    assert gained == pytest.approx(predicted, rel=2e-2)


def test_the_jerk_has_an_exact_model_by_control_points(case):
    """Jerks are linear in them: to second order, their fourth powers are what the model says."""
    model = Model(*with_given_goal(case), 100.0, jerk_alone)
    step = model.step(2e-4)
    change = np.append(step.control.ravel(), 0.0)
    sides = [model.moved(replace(step, control=sign * step.control)) for sign in (1, -1)]
    here, *there = (np.exp(model.objective.value(at)) for at in (model.here, *sides))
    bend = sum(there) / here - 2
    assert change @ model.hessian @ change == pytest.approx(FIRST_WORTH * bend, rel=1e-3)
    slope = (there[0] - there[1]) / (2 * here)
    assert model.gradient @ change == pytest.approx(FIRST_WORTH * slope, rel=1e-3)
    predicted = model.objective.predicted_gain(model.here, step)
    assert predicted == pytest.approx(-FIRST_WORTH * (slope + bend / 2), rel=1e-3)


def test_its_curvature_by_switching_times_is_that_of_the_jerks_themselves(case):
    """Twelve times squares and squared slopes of what is raised to the fourth: Gauss and Newton."""
    problem, spline = with_given_goal(case)
    model = Model(problem, spline, objective=jerk_alone)
    travel = np.ptp(curve(spline)(np.linspace(0, 1, 200)), axis=0)

    def raised(step):
        times = SWITCHING_TIMES + np.array([0.0, step, 0.0])
        _, jerk, width = at_knots(replace(spline, switching_times=times))
        return jerk / np.maximum(travel, 0.05 * travel.max()) * width**0.25

    slope = (raised(1e-6) - raised(-1e-6)) / 2e-6
    expected = 12 * (raised(0.0) ** 2 * slope**2).sum() / (raised(0.0) ** 4).sum()
    assert model.hessian[-1, -1] == pytest.approx(FIRST_WORTH * expected, rel=1e-4)


def test_a_moving_goal_counts_once_for_all_its_control_points(case):
    """The gradient by the joints of an open goal is that of every point that moves along."""
    problem, spline, _ = case
    model = Model(replace(problem, goal=None), spline)
    steps = np.zeros((2, *model.variables.lower.shape))
    steps[0, -1, 1], steps[1, -1, 1] = 1e-6, -1e-6  # it lifts the arm: gravity counts there
    sides = []
    for step in steps:
        moved = spline.control_points + model.variables.change(step)
        at = model.constraints.at(replace(spline, control_points=moved))
        sides.append(model.objective.value(at))
    numeric = (sides[0] - sides[1]) / 2e-6
    found = model.gradient[:-1].reshape(steps[0].shape)[-1, 1]
    assert found == pytest.approx(FIRST_WORTH * numeric, rel=1e-4)


def objective_beside(slider, run_in):
    """Return an objective, motions of the slider of which the second is slower, and their gains."""
    slider, spline = unbounded(slider.robot), monotone(1, np.array([0.6]))
    objective = smoothness(slider, spline, run_in)
    longer = replace(spline, control_points=1.01 * spline.control_points)
    here, slower = (evaluated(slider, each, run_in) for each in (spline, longer))
    return objective, here, slower, objective.value(here) - objective.value(slower)


def test_smoothness_is_worth_less_while_steps_are_too_long(slider):
    objective, here, slower, smoother = objective_beside(slider, 0.1)  # far less than it needs
    longer = (slower.squared_duration - here.squared_duration) / 0.1**2
    assert longer > 0
    step = Step(np.zeros((1, 1)), np.zeros(1), 1e-3, 0.0, np.zeros(0))
    objective.after(replace(step, duration=0.0))
    for worth in (FIRST_WORTH, 2.5e-3, 1.25e-3, 6.25e-4, 5e-4, 5e-4):
        assert objective.gain(here, slower) == pytest.approx(worth * smoother - longer, rel=1e-9)
        objective.after(step)
    nowhere = replace(slower, squared_duration=np.inf)
    assert objective.gain(here, nowhere) == -np.inf


def test_within_the_time_nothing_is_longer(slider):
    """Measures that vanish have logarithms, too."""
    objective, here, slower, smoother = objective_beside(slider, 60.0)
    assert objective.gain(here, slower) == pytest.approx(FIRST_WORTH * smoother, abs=1e-14)
    slider, spline = unbounded(slider.robot), monotone(1, np.array([0.6]))
    still = evaluated(slider, replace(spline, control_points=0 * spline.control_points), 1.0)
    assert np.isfinite(smoothness(slider, spline, 1.0).value(still))


def test_a_step_that_would_be_longer_should_gain_less(slider):
    model = Model(unbounded(slider.robot), monotone(1, np.array([0.6])), 0.1)
    longer = model.here.squared_duration / 0.1**2 - 1
    assert longer > 0
    for duration, more in ((0.0, 0.0), (0.2, 0.2), (-0.2, 0.0)):
        step = replace(model.step(0.0), duration=duration)
        predicted = model.objective.predicted_gain(model.here, step)
        assert predicted == pytest.approx(longer - more, rel=1e-9)
