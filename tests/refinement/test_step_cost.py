"""The quadratic part of a step's cost is what it says it is."""

import numpy as np
import pytest

from tubeplanner import load_problem
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.refinement.control_variables import ControlVariables
from tubeplanner.refinement.spline_start import starting_spline
from tubeplanner.refinement.step_cost import _PROXIMITY, _SMOOTHING, StepCost

DAMPING = 0.7


@pytest.fixture(scope="module", params=["ur5/over_the_wall", "panda/between_shelves"])
def case(request):
    """A problem with an open goal, and one with a given one."""
    problem = load_problem(f"example:{request.param}")
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    spline = starting_spline(problem, branch, 12)
    variables = ControlVariables(problem, spline.grid)
    joints = problem.robot.joint_count
    return spline, variables, StepCost(variables, spline.grid, joints)


def cost(spline, variables, step):
    """Return smoothing, proximity and damping of a step, written out."""
    intervals, change = spline.grid.interval_count, variables.change(step)
    bends = np.diff(spline.control_points + change, 3, axis=0)
    smoothing = _SMOOTHING * intervals**5 / 250_000 * (bends**2).sum()
    rates = intervals * (np.diff(change, axis=0) ** 2).sum()
    return smoothing + (_PROXIMITY * (step**2).sum() + DAMPING * rates) / 2


def test_it_is_the_cost_of_a_step_but_for_what_there_was_before(case):
    spline, variables, step_cost = case
    step = 0.01 * np.random.default_rng(0).normal(size=variables.lower.shape)
    quadratic = step_cost.quadratic(spline.control_points, DAMPING)
    others = quadratic.hessian.size - step.size
    x = np.append(step.ravel(), np.zeros(others))
    found = quadratic.gradient @ x[:-2] + x @ quadratic.hessian.product(x) / 2
    before = cost(spline, variables, np.zeros_like(step))
    assert found == pytest.approx(cost(spline, variables, step) - before, rel=1e-9)
    assert not quadratic.gradient[step.size :].any() and quadratic.duration == 1


def test_squared_rates_are_what_is_damped(case):
    spline, variables, step_cost = case
    step = 0.01 * np.random.default_rng(1).normal(size=variables.lower.shape)
    found = [step_cost.quadratic(spline.control_points, w).hessian.dense() for w in (DAMPING, 0.0)]
    rates = found[0] - found[1]
    x = np.append(step.ravel(), np.zeros(rates.shape[0] - step.size))
    assert DAMPING * step_cost.squared_rates(step) == pytest.approx(x @ (rates @ x), rel=1e-9)


def test_everything_that_may_change_has_some_curvature(case):
    """Else the solver's program would have no single answer."""
    spline, _, step_cost = case
    hessian = step_cost.quadratic(spline.control_points).hessian.dense()
    assert np.linalg.eigvalsh(hessian).min() > 0
