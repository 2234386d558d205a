"""Plans to tool positions: exact ones as an open goal, balls used to save time, orientations."""

from dataclasses import replace

import numpy as np
import pytest

from cases import SHORTEST
from tubeplanner import GoalRegion, Planner, PlanOptions, Tube, plan, verify
from tubeplanner.baselines.baselines import BASELINES, judged_baseline

POST, WALL, TRAY = "two_link/around_a_post", "ur5/over_the_wall", "ur5/level_tray"


def with_goal(problem, *values, position=None):
    position = problem.tube.points[-1] if position is None else position
    return replace(problem, goal=GoalRegion(position, *values))


def away(problem, result):
    tool = problem.robot.tool_position(result.trajectory.position([result.duration]))[0]
    return float(np.linalg.norm(tool - problem.goal.position))


@pytest.mark.parametrize("name", [POST, WALL])
def test_the_last_point_without_a_tolerance_is_a_goal_left_out(name, bundled):
    problem = replace(bundled(name), goal=None)
    exact = with_goal(problem)
    found = plan(exact, SHORTEST)
    assert found.duration == pytest.approx(plan(problem, SHORTEST).duration, rel=1e-3)
    assert away(exact, found) < 1e-6


@pytest.mark.parametrize("name", [POST, WALL, "panda/between_shelves"])
def test_the_larger_the_ball_the_shorter_the_motion(name, bundled):
    problem = replace(bundled(name), goal=None)
    durations = [plan(problem, SHORTEST).duration]
    for tolerance in (0.005, 0.02):
        ball = with_goal(problem, tolerance)
        found = plan(ball, SHORTEST)
        assert found.succeeded
        assert 0.9 * tolerance < away(ball, found) <= tolerance
        durations.append(found.duration)
    assert durations[0] > 1.002 * durations[1] > 1.004 * durations[2]


def test_what_a_tolerance_saves_is_what_it_is_said_to_cost(bundled):
    """10 % more of it, against planning again with 30 % more."""
    problem = with_goal(bundled("panda/between_shelves"), 0.023)
    found = plan(problem, SHORTEST)
    price = next(one for one in found.sensitivities if one.limit == "tolerance")
    assert str(price).startswith("tolerance of the goal: ")
    wider = plan(with_goal(problem, 0.0299), SHORTEST)
    assert found.duration - wider.duration == pytest.approx(3 * price.saved, rel=0.2)


def test_a_tiny_tolerance_is_no_worse_than_none(bundled):
    problem = bundled("panda/between_shelves")
    exact = plan(with_goal(problem), SHORTEST).duration
    assert plan(with_goal(problem, 1e-4), SHORTEST).duration < 1.002 * exact


@pytest.mark.parametrize(
    ("position", "tolerance"),
    [
        ([0.45, 0.31, 0.215], 0.0),  # beside the last segment
        ([0.45, 0.3, 0.35], 0.01),  # half way along it
        ([0.45, 0.3, 0.5], 0.0),  # where it begins, so that its leg has no length
        ([0.45, 0.3, 0.2], 0.5),  # the ball holds the capsule
    ],
)
def test_the_end_is_in_ball_and_capsule(position, tolerance, bundled):
    problem = with_goal(bundled(WALL), tolerance, position=position)
    found = plan(problem, SHORTEST)
    assert found.succeeded
    assert found.duration < 0.55
    assert away(problem, found) <= tolerance + 1e-6
    goal = found.certificate.conditions["goal"]
    assert goal.margin == pytest.approx(tolerance - away(problem, found), abs=1e-9)


def test_a_ball_is_reached_where_its_centre_is_not(bundled):
    """The arm ends 5 mm short of a point that it does not reach, within 1 cm of it."""
    problem = bundled(POST)
    reach = 0.6
    points = [[0.45, -0.3, 0], [0.45, 0.1, 0], [reach + 0.005, 0.1, 0]]
    points[-1][0] = float(np.sqrt(reach**2 - 0.1**2)) + 0.005
    tube = Tube(points, 0.03, joint_signs={"joint2": "+"})
    open_end = replace(problem, tube=tube, goal=None, obstacles=())
    assert plan(open_end, SHORTEST).status == "unreachable"
    ball = with_goal(open_end, 0.01)
    assert plan(ball, SHORTEST).succeeded
    refused = plan(with_goal(open_end, 0.003), SHORTEST)
    assert refused.status == "unreachable"
    assert "may stay 0.003 m away" in refused.message
    assert "move the goal" in refused.message


@pytest.mark.parametrize("bound", [0.05, (0.02, 0.02, np.inf), 0.002])
@pytest.mark.parametrize("tolerance", [0.0, 0.02])
def test_the_end_may_be_turned_less_than_the_way(bound, tolerance, bundled):
    problem = bundled(TRAY)
    tube = problem.tube
    free = Tube(
        tube.points,
        tube.radius,
        joint_signs=list(tube.joint_ranges),
        orientations=tube.orientations,
        rotation_tolerance=np.inf,
    )
    free = replace(problem, tube=free, goal=None)
    turned = with_goal(free, tolerance, bound)
    found = plan(turned, SHORTEST)
    assert found.succeeded
    rotation = found.certificate.conditions["rotation"]
    assert -1e-6 <= rotation.margin < 0.1 * np.min(bound)
    assert rotation.coverage == "at the goal"
    assert any(one.limit == "rotation_tolerance" for one in found.sensitivities)
    assert all(one.saved < 0.05 for one in found.sensitivities)
    assert "rotation" in verify(turned, plan(free, SHORTEST).trajectory).failures()


@pytest.mark.parametrize("method", ["stop-at-corners", "branch-and-bound", "suh-bishop"])
@pytest.mark.parametrize("visit", ["ordered", "any"])
def test_every_method_ends_in_the_ball(method, visit, bundled):
    problem = bundled(POST)
    tube = Tube(problem.tube.points, problem.tube.radius, visit=visit)
    problem = with_goal(replace(problem, tube=tube), 0.02, position=[0.22, 0.44, 0.0])
    result = plan(problem, PlanOptions(method, time_limit=5.0))
    assert result.succeeded
    assert away(problem, result) <= 0.02


@pytest.mark.parametrize("name", BASELINES)
def test_baselines_end_in_the_ball(name, bundled):
    problem = with_goal(bundled(POST), 0.02, position=[0.21, 0.44, 0.0])
    _, certificate = judged_baseline(problem, name)
    assert certificate.conditions["goal"].margin >= -1e-6


def test_a_plan_is_planned_again_for_another_ball(bundled):
    problem = with_goal(bundled(WALL), 0.02)
    planner = Planner(problem, SHORTEST)
    planner.plan()
    moved = with_goal(problem, 0.005, position=problem.goal.position + np.array([0.0, 0.01, 0.0]))
    again = planner.replan(moved)
    assert again.succeeded
    assert any("last motion" in note for note in again.notes)
    assert again.duration == pytest.approx(plan(moved, SHORTEST).duration, rel=5e-3)


def test_the_message_says_where_it_ended(bundled):
    problem = with_goal(bundled(POST), 0.02)
    message = plan(problem, SHORTEST).message
    assert "the tool ends 19.9 mm from the goal's position; the goal was left open" in message
