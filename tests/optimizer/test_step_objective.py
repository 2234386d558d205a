"""Objective of a step: duration, or energy, work and smoothness in a fixed one; damping."""

from dataclasses import replace

import numpy as np
import pytest
from cases import INERTIA, begun, constraints_of, one_joint
from scipy.interpolate import BSpline

from tubeplanner import PlanningProblem, Tube
from tubeplanner.limits.peaks import EffortCosts
from tubeplanner.optimizer.control_variables import ControlVariables
from tubeplanner.optimizer.motion_measures import Energy, IntervalMotion, Work, smoothness_measures
from tubeplanner.optimizer.phased_spline import DEGREE, PhasedSpline
from tubeplanner.optimizer.starts import knot_grid
from tubeplanner.optimizer.step_objective import _FIRST_WORTH as FIRST_WORTH
from tubeplanner.optimizer.step_objective import _PROXIMITY, _SMOOTHING, MeasuredObjective, StepCost
from tubeplanner.optimizer.step_program import Step
from tubeplanner.trajectory.joint_trajectory import from_spline

SWITCHING_TIMES = np.array([0.0, 0.4, 1.0])
RUN_IN = 0.8


def monotone(joints, travel, seed=2):
    """Return a spline of joints that go so far, each without turning back."""
    grid = knot_grid(SWITCHING_TIMES, 10)
    steps = np.random.default_rng(seed).uniform(0.2, 1.0, (grid.control_point_count - 1, joints))
    steps[:2] = steps[-2:] = 0.0
    course = np.vstack([np.zeros(joints), np.cumsum(steps, axis=0)])
    return PhasedSpline(grid, SWITCHING_TIMES, course / course[-1] * travel)


def evaluated(problem, spline, run_in=RUN_IN):
    return constraints_of(problem, spline.grid, run_in=run_in).at(spline)


def motion(problem, spline, run_in=RUN_IN):
    """Return a spline as measures take it."""
    return IntervalMotion(evaluated(problem, spline, run_in), run_in)


def curve(spline):
    """Return scipy's spline."""
    return BSpline(spline.grid.knots(spline.switching_times), spline.control_points, DEGREE)


def at_knots(spline):
    """Return accelerations at the knots, jerks between them, and widths."""
    knots, found = spline.grid.breakpoints(spline.switching_times), curve(spline)
    return found(knots, 2), found((knots[1:] + knots[:-1]) / 2, 3), np.diff(knots)[:, None]


def unbounded(robot):
    """A problem of two segments that asks nothing of a robot but its limits."""
    joints = robot.joint_count
    tool = robot.tool_position(np.zeros((1, joints)))[0]
    tube = Tube(tool + np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]]), 1000.0)
    return PlanningProblem(robot, tube, np.zeros(joints), self_collision=False)


def bar(tmp_path, **limits):
    """A bar in free rotation: its effort is its inertia times its acceleration."""
    return unbounded(one_joint(tmp_path, **limits))


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


def test_the_model_of_energy_is_exact_where_efforts_are_linear(tmp_path):
    """Those of a bar, in its control points."""
    problem, spline = bar(tmp_path), monotone(1, TRAVEL)
    energy, at, points = Energy(np.array([2.5])), motion(problem, spline), spline.control_points
    step = np.zeros_like(points)
    step[3:-3] = 0.1 * np.random.default_rng(5).normal(size=step[3:-3].shape)
    model = energy.model(at, 3.0)
    change = np.einsum("mrv,mv->mr", model.control, by_interval(step, len(model.slope)))
    expected = (model.slope * change).sum() + (model.curvature * change**2).sum() / 2
    displaced = motion(problem, replace(spline, control_points=points + step))
    assert 3.0 * (energy.total(displaced) - energy.total(at)) == pytest.approx(expected, rel=1e-9)


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
        displaced = by_interval(step, len(model.slope))
        bends = model.curvature * np.einsum("mrv,mv->mr", model.control, displaced) ** 2
        assert bends.sum() > bend
        missed.append(bend > bends[:, own].sum())
    assert any(missed)  # by the residuals of power alone


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


DAMPING = 0.7


UNITS = np.linspace(0.5, 2, 7)


@pytest.fixture(scope="module", params=["ur5/over_the_wall", "panda/between_shelves"])
def cost_case(request, bundled):
    """A problem with an open goal, and one with a given one."""
    problem = bundled(request.param)
    spline = begun(problem, 12)
    variables = ControlVariables(problem, spline.grid)
    return spline, variables, StepCost(variables, spline.grid, UNITS[: problem.robot.joint_count])


def cost(spline, variables, step, switching):
    """Return smoothing, proximity and damping of a step, written out.

    A motion of an even speed whose phase becomes wider by some fraction is slower by that fraction.
    """
    units = UNITS[: step.shape[1]]
    intervals, change = spline.grid.interval_count, variables.change(step) / units
    points = spline.control_points / units
    bends = np.diff(points + change, 3, axis=0)
    smoothing = _SMOOTHING * intervals**5 / 250_000 * (bends**2).sum()
    rates = intervals * (np.diff(change, axis=0) ** 2).sum()
    squared_speed = intervals * (np.diff(points, axis=0) ** 2).sum()
    widths = np.diff(spline.switching_times)
    wider = np.diff(np.concatenate([[0.0], switching, [0.0]])) / widths
    rates += squared_speed * (widths * wider**2).sum()
    return smoothing + (_PROXIMITY * ((step / units) ** 2).sum() + DAMPING * rates) / 2


def test_it_is_the_cost_of_a_step_but_for_what_there_was_before(cost_case):
    """Squared rates are what is damped; everything that may change has some curvature."""
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
        self.cost = StepCost(self.variables, spline.grid, problem.robot.joint_units)
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
