"""The last motion as a start for a changed problem."""

from dataclasses import replace

import numpy as np
import pytest

from cases import SHORTEST
from tubeplanner import PlanningProblem, Tube, load_problem, plan
from tubeplanner.outcome import Infeasible, PlanStatus


@pytest.fixture(scope="module")
def motion():
    return plan(load_problem("example:two_link/around_a_post"), SHORTEST).motion


def moved(problem, steps):
    return problem.with_tube(replace(problem.tube, points=problem.tube.points + np.array(steps)))


def tool_at(problem, spline, x):
    return problem.robot.tool_position(spline.bspline()(x))


def test_where_nothing_changes_it_stays(motion):
    shifted = motion.shifted(motion.problem)
    np.testing.assert_allclose(
        shifted.control_points, motion.spline.control_points, rtol=0, atol=1e-6
    )
    assert shifted.grid is motion.spline.grid


def test_its_tool_moves_with_the_reference_points_and_it_stays_at_rest(motion):
    steps = [[0.01, 0.0, 0.0], [-0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, -0.01, 0.0]]
    changed = moved(motion.problem, steps)
    spline = motion.shifted(changed)
    ends = spline.switching_times
    before, after = (tool_at(changed, s, ends) for s in (motion.spline, spline))
    np.testing.assert_allclose(after[[0, -1]], changed.tube.points[[0, -1]], atol=1e-8)
    # Control points near a corner follow it, but for what the spline makes of the others.
    np.testing.assert_allclose(after - before, steps, atol=2e-3)
    assert np.ptp(spline.control_points[:3], axis=0).max() == 0
    assert np.ptp(spline.control_points[-3:], axis=0).max() == 0


def test_it_goes_to_a_given_goal(motion):
    problem = motion.problem
    goal = motion.spline.control_points[-1] + [0.02, -0.01]
    spline = motion.shifted(replace(problem, goal=goal))
    np.testing.assert_allclose(spline.control_points[-3:], np.tile(goal, (3, 1)), atol=1e-12)


def test_a_goal_out_of_reach_is_none(motion):
    far = moved(motion.problem, [[0, 0, 0]] * 3 + [[0.0, 0.5, 0.0]])
    with pytest.raises(Infeasible, match="does not lead to reference point 3") as found:
        motion.shifted(far)
    assert found.value.status is PlanStatus.UNREACHABLE


def test_it_suits_problems_with_the_same_joints_and_segments(motion, slide):
    problem = motion.problem
    wider = problem.with_tube(problem.tube.scaled(1.2))
    assert motion.suited(wider) is wider
    points = problem.tube.points
    fewer = Tube(points[:-1], 0.03, joint_signs={"joint2": "-"})
    assert motion.suited(problem.with_tube(fewer)) is None
    tool = slide.tool_position(np.zeros((1, 3)))[0]
    other = Tube(tool + points - points[0], 0.05)
    assert motion.suited(PlanningProblem(slide, other, np.zeros(3))) is None
