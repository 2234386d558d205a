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


def test_it_is_the_cost_of_a_step_but_for_what_there_was_before(case):
    spline, variables, step_cost = case
    step = 0.01 * np.random.default_rng(0).normal(size=variables.lower.shape)
    switching = 0.02 * np.random.default_rng(2).normal(size=spline.grid.switch_count)
    quadratic = step_cost.quadratic(spline, DAMPING)
    x = np.concatenate([step.ravel(), switching, [0.0, 0.0]])
    found = quadratic.gradient @ x[:-2] + x @ quadratic.hessian.product(x) / 2
    before = cost(spline, variables, np.zeros_like(step), np.zeros_like(switching))
    assert found == pytest.approx(cost(spline, variables, step, switching) - before, rel=1e-6)
    assert not quadratic.gradient[step.size :].any() and quadratic.duration == 1


def test_squared_rates_are_what_is_damped(case):
    spline, variables, step_cost = case
    step = 0.01 * np.random.default_rng(1).normal(size=variables.lower.shape)
    switching = 0.02 * np.random.default_rng(3).normal(size=spline.grid.switch_count)
    found = [step_cost.quadratic(spline, w).hessian.dense() for w in (DAMPING, 0.0)]
    rates = found[0] - found[1]
    x = np.concatenate([step.ravel(), switching, [0.0, 0.0]])
    squared_rates = step_cost.squared_rates(spline, step, switching)
    assert DAMPING * squared_rates == pytest.approx(x @ (rates @ x), rel=1e-9)


def test_everything_that_may_change_has_some_curvature(case):
    """Else the solver's program would have no single answer."""
    spline, _, step_cost = case
    hessian = step_cost.quadratic(spline).hessian.dense()
    assert np.linalg.eigvalsh(hessian).min() > 0
