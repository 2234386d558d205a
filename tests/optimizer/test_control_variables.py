"""Variables of a step: free control points, their bounds, columns common to legs."""

import numpy as np
import pytest
from cases import begun

from tubeplanner.optimizer.control_variables import (
    FIXED,
    ControlVariables,
    LegShape,
    shared_columns,
)


@pytest.fixture(scope="module", params=["ur5/over_the_wall", "panda/between_shelves"])
def case(request, bundled):
    """A problem with an open goal, and one with a given one."""
    problem = bundled(request.param)
    spline = begun(problem, 12)
    return problem, spline, ControlVariables(problem, spline.grid)


def test_the_ends_are_fixed_but_for_an_open_goal_that_moves_as_one(case):
    problem, spline, variables = case
    column = variables.column
    assert (column[:3] == FIXED).all()
    assert np.diff(column[3:-3]).tolist() == [1] * (len(column) - 7)
    open_goal = problem.goal is None
    assert (column[-3:] == (column[-4] + 1 if open_goal else FIXED)).all()
    assert len(variables.lower) == len(column) - 6 + open_goal
    points = spline.control_points
    np.testing.assert_array_equal(variables.of(points)[: len(column) - 6], points[3:-3])


def test_a_step_changes_what_the_variables_stand_for(case):
    """Derivatives are collected as it is spread: what a change costs is the same by either."""
    problem, spline, variables = case
    rng = np.random.default_rng(0)
    step = rng.normal(size=variables.lower.shape)
    change = variables.change(step)
    np.testing.assert_array_equal(change[3:-3], step[: len(change) - 6])
    assert (change[:3] == 0).all()
    assert (change[-3:] == (step[-1] if problem.goal is None else 0)).all()
    by_point = rng.normal(size=spline.control_points.shape)
    cost = np.vdot(by_point, change)
    assert np.vdot(variables.collected(by_point), step) == pytest.approx(cost, rel=1e-12)


def test_the_tool_stays_at_an_open_goal(case):
    problem, spline, variables = case
    points = spline.control_points
    step = 0.05 * np.random.default_rng(1).normal(size=variables.lower.shape)
    moved, held = variables.moved(points, step), variables.held(points)
    if problem.goal is not None:
        np.testing.assert_array_equal(moved[-3:], points[-3:])
        assert len(held) == 0
        return
    tool = problem.robot.tool_position(moved[-1:])[0]
    np.testing.assert_allclose(tool, problem.tube.points[-1], atol=1e-9)
    assert abs(moved[-1] - points[-1]).max() > 0.01
    np.testing.assert_array_equal(moved[-3:], np.tile(moved[-1], (3, 1)))
    np.testing.assert_array_equal(moved[-1], variables.goal_after(points, step))
    # Directions that move the tool there are held.
    _, jacobian = problem.robot.tool_jacobian(points[-1:])
    assert len(held) == 3
    np.testing.assert_allclose(jacobian[0, :3] @ (np.eye(6) - held.T @ held), 0, atol=1e-9)
    # What the goal is corrected by is spread over the motion, ever more of it towards the goal.
    correction = moved - points - variables.change(step)
    fraction = np.linalg.norm(correction, axis=1) / np.linalg.norm(correction[-1])
    assert (fraction[:3] < 1e-12).all()
    assert (np.diff(fraction) > -1e-12).all()
    np.testing.assert_allclose(fraction + fraction[::-1], 1.0, atol=1e-9)


def test_a_goal_is_corrected_beyond_the_points_that_would_leave_their_bounds(bundled):
    """Clipped alone, a point in a short phase would be a jump of the acceleration."""
    problem = bundled("ur5/over_the_wall")
    spline = begun(problem, 12)
    variables = ControlVariables(problem, spline.grid)
    points = spline.control_points
    step = 0.05 * np.random.default_rng(1).normal(size=variables.lower.shape)
    free = variables.moved(points, step)
    predicted = points + variables.change(step)
    middle = len(points) // 2
    at_bound = predicted[middle]
    number = variables.column[middle]
    rises = free[middle] > at_bound
    variables.upper[number] = np.where(rises, at_bound, variables.upper[number])
    variables.lower[number] = np.where(rises, variables.lower[number], at_bound)
    moved = variables.moved(points, step)
    np.testing.assert_array_equal(moved[-3:], free[-3:])
    correction = (moved - predicted) * np.where(rises, 1.0, -1.0)
    assert abs(correction[: middle + 1]).max() < 1e-12
    assert (np.diff(correction, axis=0) > -1e-12).all()
    assert correction[-1].max() > 0.001


def test_points_are_moved_into_the_ranges_of_all_phases_they_count_in(case):
    problem, spline, variables = case
    far = spline.control_points + 20.0
    inside, moving = variables.within_bounds(far), variables.column != FIXED
    bounded = np.isfinite(problem.joint_upper.min(axis=0))
    assert (inside[moving][:, bounded] <= problem.joint_upper.max(axis=0)[bounded]).all()
    np.testing.assert_array_equal(inside[~moving], far[~moving])


def test_an_open_goal_without_redundant_joints_stays_where_it_is(bundled):
    problem = bundled("two_link/paper_1_10mm")
    spline = begun(problem, 12)
    variables = ControlVariables(problem, spline.grid)
    assert (variables.column[-3:] == FIXED).all()
    assert len(variables.held(spline.control_points)) == 0


@pytest.fixture(scope="module")
def with_start(bundled):
    """The same problem's variables whose start is fixed, beside those whose start moves."""
    problem = bundled("ur5/over_the_wall")
    spline = begun(problem, 12)
    alone = ControlVariables(problem, spline.grid)
    return spline, alone, ControlVariables(problem, spline.grid, start_moves=True)


def test_a_start_that_moves_is_one_variable_before_all_others(with_start):
    spline, alone, variables = with_start
    assert variables.column[:3].tolist() == [0, 0, 0]
    np.testing.assert_array_equal(variables.column[3:], alone.column[3:] + 1)
    assert len(variables.lower) == len(alone.lower) + 1
    points = spline.control_points
    np.testing.assert_array_equal(variables.of(points), [points[0], *alone.of(points)])
    step = np.random.default_rng(3).normal(size=variables.lower.shape)
    np.testing.assert_array_equal(variables.change(step)[:3], np.tile(step[0], (3, 1)))


def test_a_start_that_moves_gets_to_where_it_is_to_be(with_start):
    spline, _, variables = with_start
    points, step = spline.control_points, np.zeros(variables.lower.shape)
    step[0] = np.random.default_rng(5).uniform(-0.02, 0.02, len(step[0]))
    # Near zero, where what is added to far larger angles is rounded.
    start = np.random.default_rng(6).uniform(0.001, 0.01, len(step[0]))
    moved = variables.moved(points, step, start)
    np.testing.assert_array_equal(moved[:3], np.tile(start, (3, 1)))
    np.testing.assert_allclose(moved[-3:], points[-3:], atol=1e-9)
    # What the start lacked is spread over the motion, ever less of it.
    fraction = (moved - points - variables.change(step))[:, 0] / (start - points[0] - step[0])[0]
    assert (np.diff(fraction) < 1e-9).all()
    np.testing.assert_allclose(fraction + fraction[::-1], 1.0, atol=1e-9)


def test_tied_ends_have_the_bounds_of_both(with_start, bundled):
    problem, grid = bundled("ur5/over_the_wall"), with_start[0].grid
    before = ControlVariables(problem, grid)
    after = ControlVariables(problem, grid, start_moves=True)
    before.lower[-1], before.upper[-1] = [-1, -3, -1, -3, -1, -1], 2.0
    after.lower[0], after.upper[0] = -2.0, [1, 3, 1, 3, 1, 1]
    before.tie(after)
    for variables, place in ((before, -1), (after, 0)):
        assert variables.lower[place].tolist() == [-1, -2, -1, -2, -1, -1]
        assert variables.upper[place].tolist() == [1, 2, 1, 2, 1, 1]


# Three, one and two configurations of two joints; one, no and two switching times.
LEGS = [LegShape(3, 2, 1), LegShape(1, 2, 0), LegShape(2, 2, 2)]


def test_configurations_stand_first_then_switching_times_then_eta_then_elastic():
    first, second, third = shared_columns(LEGS, [False, False, False])
    assert first.tolist() == [0, 1, 2, 3, 4, 5, 12, 15, 18]
    assert second.tolist() == [6, 7, 16, 19]
    assert third.tolist() == [8, 9, 10, 11, 13, 14, 17, 20]
    (cycle,) = shared_columns([LegShape(3, 2, 1)], [True])  # of one leg
    assert cycle.tolist() == [2, 3, 0, 1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize(
    ("is_tied", "first"),
    [
        ([True, False, False], [0, 1, 2, 3, 4, 5]),  # its end is the next one's beginning
        # Where a cycle closes comes after all other configurations.
        ([False, False, True], [8, 9, 0, 1, 2, 3]),
    ],
)
def test_tied_ends_are_the_same_configuration(is_tied, first):
    columns = shared_columns(LEGS, is_tied)
    assert columns[0][:6].tolist() == first
    assert columns[1][:2].tolist() == [4, 5]
    assert columns[2][:4].tolist() == [6, 7, 8, 9]
    assert columns[0][6] == 10


# Of forty switching times, two beside a phase of thirty knot intervals.
MANY = np.array([1] * 19 + [30] * 2 + [1] * 19)
BEHIND = np.concatenate([np.arange(20), np.arange(50, 70)])
MIXED = LegShape(70, 2, 40, MANY, BEHIND)


def test_many_switching_times_stand_where_they_count_unless_beside_a_long_phase():
    """Few are behind all configurations."""
    assert MIXED.is_among.tolist() == (MANY == 1).tolist()
    (own,) = shared_columns([MIXED], [False])
    assert sorted(own) == list(range(70 * 2 + 40 + 2))
    switching, begin = own[140:180], own[:140:2]
    for place, behind, is_among in zip(switching, BEHIND, MIXED.is_among, strict=True):
        assert (begin < place).sum() == (behind if is_among else 70)
    assert (np.diff(own[:140]) > 0).all()
    assert own[-2:].tolist() == [180, 181]
    # Six configurations of two joints, a switching time after two and one after four of them.
    few = LegShape(6, 2, 2, np.array([1, 1]), np.array([2, 4]))
    assert not few.is_among.any()
    assert shared_columns([few], [False])[0].tolist() == list(range(6 * 2 + 2 + 2))


def test_switching_times_of_several_legs_stand_in_their_own_leg():
    first, second = shared_columns([MIXED, MIXED], [True, False])
    assert first[140:159].max() < second[0] - 1 <= second[140:159].min()
    assert first[138:140].tolist() == second[:2].tolist()
    assert sorted(set(first) | set(second)) == list(range(139 * 2 + 80 + 4))
