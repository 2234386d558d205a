"""Legs whose common ends are open: where they end, and what that is worth."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import GoalRegion, PlanningProblem, PlanOptions, Seed, Tube, load_robot, plan
from tubeplanner.refinement.tied_legs import TiedLegs

pytestmark = pytest.mark.dear("plans and improves several legs")

FAST = PlanOptions(quality="fast", slack=0.0)
# Where the hand of a two-link arm starts, and ends each leg, within a tolerance.
POINTS = np.array([[0.3, -0.5, 0.0], [0.5, 0.2, 0.0], [0.1, 0.6, 0.0], [-0.4, 0.3, 0.0]])
TOLERANCE, RADIUS = 0.05, 0.08


@pytest.fixture(scope="module")
def robot():
    return load_robot("example:two_link", "hand")


def leg(robot, k, start, goal):
    return PlanningProblem(robot, Tube(POINTS[k : k + 2], RADIUS), start, goal)


@pytest.fixture(scope="module")
def planned(robot):
    """Three legs planned one after the other: problems, results and motions."""
    start, problems, results = Seed([0.0, -1.0]), [], []
    for k in range(3):
        problems.append(leg(robot, k, start, GoalRegion(POINTS[k + 1], TOLERANCE)))
        results.append(plan(problems[-1], FAST))
        start = results[-1].trajectory.position(results[-1].duration)
    return problems, results, [result.motion for result in results]


def between(planned, ends, legs):
    """Return the sum of durations of the legs planned alone between configurations."""
    starts, goals = [planned[0][0].start, *ends[:2]], [*ends[:2], planned[0][2].goal]
    alone = (replace(planned[0][k], start=starts[k], goal=goals[k]) for k in legs)
    return sum(plan(problem, FAST).duration for problem in alone)


@pytest.fixture(scope="module")
def tied(planned):
    legs = TiedLegs(planned[2], [True, True])
    return legs, legs.run()


def test_tied_ends_agree_exactly_and_the_arm_is_at_rest_there(robot, planned, tied):
    for one, other in zip(tied[1][:-1], tied[1][1:], strict=True):
        q = one.control_points[-1]
        np.testing.assert_array_equal(one.control_points[-3:], [q, q, q])
        np.testing.assert_array_equal(other.control_points[:3], [q, q, q])
    before = planned[2][0].spline.control_points[0]
    np.testing.assert_array_equal(tied[1][0].control_points[0], before)
    # The hand stays within the goals' tolerance.
    ends = np.array([spline.control_points[-1] for spline in tied[1]])
    away = np.linalg.norm(robot.tool_position(ends) - POINTS[1:], axis=1)
    assert (away <= TOLERANCE).all()
    assert away.max() > 0.9 * TOLERANCE


def test_legs_between_tied_ends_take_less_than_one_after_the_other_or_between_ends_near_by(
    robot, planned, tied
):
    """The first end moved in its ball: no way leads to a smaller sum, but for noise."""
    ends = [spline.control_points[-1] for spline in tied[1]]
    last = between(planned, ends, [2])
    total = between(planned, ends, [0, 1]) + last
    assert total < 0.99 * sum(result.duration for result in planned[1])
    # On its coarser knots the program knew the sum nearly.
    assert sum(tied[0].durations) == pytest.approx(total, rel=0.06)
    jacobian = robot.tool_jacobian(ends[0][None])[1][0, :2]
    directions = np.array([[0.02, 0], [-0.02, 0], [0, 0.02], [0, -0.02]])
    others = ends[0] + np.linalg.solve(jacobian, directions.T).T
    away = np.linalg.norm(robot.tool_position(others) - POINTS[1], axis=1)
    inside = others[away <= TOLERANCE]
    assert len(inside) > 0
    for other in inside[:2]:
        assert between(planned, [other, *ends[1:]], [0, 1]) + last > 0.998 * total


def test_an_end_that_is_not_tied_stays_and_every_step_is_announced_with_the_sum(planned):
    sums, (_, results, motions) = [], planned
    first, second, third = TiedLegs(motions, [True, False], checkpoint=sums.append).run()
    before = motions[2].spline.control_points[0]
    np.testing.assert_array_equal(third.control_points[0], before)
    np.testing.assert_array_equal(first.control_points[-1], second.control_points[0])
    assert len(sums) > 2
    assert sums[-1] == pytest.approx(sum(result.duration for result in results), rel=0.05)
    with pytest.raises(KeyboardInterrupt):  # a checkpoint may end the work
        TiedLegs(motions, [True, True], checkpoint=interrupt).run()


def interrupt(duration):
    raise KeyboardInterrupt


def test_a_closed_cycle_begins_where_it_ends(robot, planned):
    """A leg back to the first point; where the cycle closes is chosen as well."""
    first = planned[1][0]
    goal, last = (first.trajectory.position(t) for t in (0.0, first.duration))
    back = plan(PlanningProblem(robot, Tube(POINTS[[1, 0]], 0.7), last, goal), FAST).motion
    back = replace(back, problem=replace(back.problem, goal=GoalRegion(POINTS[0], TOLERANCE)))
    legs = TiedLegs([first.motion, back], [True], is_closed=True)
    splines = legs.run()
    begin, end = splines[0].control_points[:3], splines[-1].control_points[-3:]
    np.testing.assert_array_equal(begin, np.tile(end[-1], (3, 1)))
    assert np.ptp(end, axis=0).max() == 0
    moved = robot.tool_position(begin[:1])[0] - POINTS[0]
    assert 0.001 < np.linalg.norm(moved) <= TOLERANCE
    assert abs(begin[0] - goal).max() > 0.01
    open_legs = TiedLegs([first.motion, back], [True])
    open_legs.run()
    assert sum(legs.durations) < sum(open_legs.durations) + 1e-3


def test_a_goal_that_leaves_nothing_to_choose_stays(robot):
    """Two joints in a plane at a point."""
    first = plan(leg(robot, 0, Seed([0.0, -1.0]), None), FAST)
    q = first.trajectory.position(first.duration)
    second = plan(leg(robot, 1, q, GoalRegion(POINTS[2], TOLERANCE)), FAST)
    motions = [first.motion, second.motion]
    splines = TiedLegs(motions, [True]).run()
    for spline, motion in zip(splines, motions, strict=True):
        before = motion.spline.control_points
        np.testing.assert_array_equal(spline.control_points[0], before[0])
    np.testing.assert_allclose(splines[0].control_points[-1], q, atol=1e-15)
