"""The ball of a goal as the optimisation sees it: its polyhedron, its keys, its movable end."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import GoalRegion
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.refinement.control_variables import FIXED, ControlVariables
from tubeplanner.refinement.goal_constraints import goal_keys
from tubeplanner.refinement.sequential_program import SequentialProgram
from tubeplanner.refinement.spline_start import starting_spline

TOLERANCE = 0.02


@pytest.fixture(scope="module", params=["two_link/around_a_post", "ur5/level_tray"])
def case(request, bundled):
    problem = bundled(request.param)
    goal = GoalRegion(problem.tube.points[-1], TOLERANCE)
    problem = replace(problem, goal=goal)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    return problem, starting_spline(problem, branch, 12)


def test_the_polyhedron_about_the_ball_is_given_from_the_beginning(case):
    """At its centre, where no plane is near; it reaches little farther than the ball."""
    problem, spline = case
    ball = SequentialProgram(problem, spline.grid).iterate(spline).regions[-1]
    planes = ball.planes
    assert len(planes) == 26
    assert ball.is_crossed
    np.testing.assert_allclose(ball.slack(planes), 1 - 0.005, atol=1e-9)
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(200, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    assert (ways @ planes.normal.T).max(axis=1).min() > 0.85


def test_every_tolerance_of_a_goal_has_its_key(case):
    problem, spline = case
    position = problem.goal.position
    kinds = [
        [key.kind for key in goal_keys(replace(problem, goal=goal))]
        for goal in (None, GoalRegion(position), GoalRegion(position, 0.01))
    ]
    assert kinds == [[], [], ["tolerance"]]
    if problem.tube.rotation is not None:
        turned = replace(problem, goal=GoalRegion(position, 0.0, 0.04))
        assert [key.kind for key in goal_keys(turned)] == ["rotation_tolerance"]
        iterate = SequentialProgram(turned, spline.grid).iterate(spline)
        assert iterate.regions[-1].regions.radius[-1] == 0.04
        bounds = replace(problem, goal=GoalRegion(position, 0.0, (0.04, 0.03, np.inf)))
        iterate = SequentialProgram(bounds, spline.grid).iterate(spline)
        assert [len(one.segment) for one in iterate.rotations][-1] == 1


def test_a_step_leads_the_tool_no_farther_than_the_balls_edge(case):
    """Whatever the step, and whether or not joints are redundant for a point."""
    problem, spline = case
    variables = ControlVariables(problem, spline.grid)
    assert (variables.column[-3:] == variables.column.max()).all()
    assert variables.column.max() != FIXED
    points = spline.control_points
    assert len(variables.held(points)) == 0
    step = np.zeros_like(variables.lower)
    for size, off in ((1e-3, None), (0.2, 0.995 * TOLERANCE)):
        step[-1] = size
        tool = problem.robot.tool_position(variables.moved(points, step)[-1:])[0]
        away = np.linalg.norm(tool - problem.goal.position)
        free = problem.robot.tool_position((points + variables.change(step))[-1:])[0]
        expected = np.linalg.norm(free - problem.goal.position) if off is None else off
        assert away == pytest.approx(expected, abs=3e-7)
