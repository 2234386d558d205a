"""Lower bounds on the duration: closed forms, random ways through tubes, certified motions."""

from dataclasses import replace

import numpy as np
import pytest
from cases import anywhere, changed, limited_tool, one_joint

from tubeplanner import GoalRegion, PlanningProblem, PlanOptions, Tube, load_robot, plan
from tubeplanner.limits.lower_bound import (
    least_duration,
    rest_to_rest,
    slowest_joint,
    tool_travel,
)
from tubeplanner.task.endpoints import ToolPose

INF, R, SPEED = np.inf, 0.1, 0.5


@pytest.mark.parametrize(
    ("distance", "velocity", "acceleration", "jerk", "expected"),
    [
        (0.0, 2.0, 1.0, 1.0, 0.0),
        (0.0, INF, 1.0, INF, 0.0),
        (1.0, 2.0, INF, INF, 0.5),
        (1.0, INF, INF, INF, 0.0),
        (4.0, 1.0, 1.0, INF, 5.0),
        (1.0, 9.0, 4.0, INF, 1.0),
        (1.0, INF, 4.0, INF, 1.0),
        (2.0, INF, INF, 1.0, 4.0),
        (2.0, 9.0, 9.0, 1.0, 4.0),
        (4.0, 1.0, 9.0, 1.0, 6.0),
        (4.0, 1.0, 1.0, 1.0, 6.0),
        (4.0, 0.5, 0.5, 1.0, 9.5),
        (6.0, 9.0, 1.0, 1.0, 6.0),
    ],
)
def test_a_joint_alone_takes_its_double_s(distance, velocity, acceleration, jerk, expected):
    assert rest_to_rest(distance, velocity, acceleration, jerk) == pytest.approx(expected)


def test_a_single_joint_comes_as_near_as_knots_allow(tmp_path):
    robot = one_joint(tmp_path, effort=1e6, acceleration=10.0, jerk=200.0)
    problem = changed(anywhere(robot), goal=np.array([2.0]))
    bound = slowest_joint(problem)
    assert bound == rest_to_rest(2.0, 4.0, 10.0, 200.0)
    duration = plan(problem, PlanOptions(slack=0.0)).duration
    assert bound <= duration < 1.002 * bound
    assert slowest_joint(changed(anywhere(robot), goal=None)) == 0.0


@pytest.mark.parametrize(
    "name", ["two_link/paper_1_30mm", "two_link/around_a_post", "ur5/level_tray"]
)
def test_no_certified_motion_is_shorter(name, planned):
    """The tool's speed is limited to the largest that the motion has."""
    problem, result = planned(name, "refinement")
    speed = result.peaks.tool_speed.value
    limited = problem.with_tube(replace(problem.tube, tool_speed=speed))
    assert 0 < tool_travel(limited) <= result.duration
    assert slowest_joint(problem) <= least_duration(limited) <= result.duration


# --- the tool through the tube -------------------------------------------------------------------

ARM = load_robot("example:ur5", "tool0")


def pose(position):
    placement = np.eye(4)
    placement[:3, 3] = position
    return ToolPose(placement)


def through(points, goal=None, radius=R, tool_speed=SPEED, **fields):
    """A problem of the least time of a tool alone, from the first to the last point."""
    tube = Tube(points, radius, tool_speed=tool_speed, **fields)
    goal = pose(points[-1]) if goal is None else goal
    return PlanningProblem(ARM, tube, pose(points[0]), goal, self_collision=False)


CORNER = [[-1, 0, 0], [0, 0, 0], [0, 1, 0]]
BACK = [[0, 0, 0], [1, 0, 0], [0, 0.01, 0]]
BOX = {"box": [0.2, 0.04], "up": [0, 0, 1]}


@pytest.mark.parametrize(
    ("problem", "length"),
    [
        (through([[0, 0, 0], [1, 0, 0]]), 1.0),
        (through([[0, 0, 0], [1, 0, 0]], GoalRegion([1, 0, 0], 0.05)), 0.95),
        (through([[0, 0, 0], [0.5, 0, 0], [1, 0, 0]]), 1.0),
        (through(CORNER), 2 * np.hypot(1 - R, R)),
        (through(CORNER, radius=None, cross_section=BOX), 2 * np.hypot(1 - R, R)),
        (through(CORNER, tool_speed=[SPEED, None]), 1 - R),
        (through(CORNER, tool_speed=None), 0.0),
        (through(CORNER, visit="any"), np.sqrt(2)),
        (through(BACK), 2 * (1 - R)),
        (through(BACK, pass_through_points="none"), 0.01),
    ],
)
def test_the_least_way_through_a_tube(problem, length):
    assert tool_travel(problem) == pytest.approx(length / SPEED, rel=2e-4, abs=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_no_way_through_a_random_tube_is_shorter(seed):
    """Random points near the reference points are inside both segments, or in the goal's ball."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.uniform(-0.3, 0.5, (rng.integers(3, 30), 3)), axis=0)
    radius, speed = rng.uniform(0.01, 0.4, (2, len(points) - 1))
    goal = GoalRegion(points[-1], radius[-1])
    problem = through(points, goal, radius, speed, pass_through_points="none")
    bound = tool_travel(problem)
    passing = np.minimum(np.append(radius, radius[-1]), np.append(radius[0], radius))
    passing[0] = 0.0
    direct = points[0] - points
    directions = [*rng.normal(size=(50, len(points), 3)), direct, direct[::-1]]
    times = []
    for away in directions:
        size = np.linalg.norm(away, axis=1, keepdims=True)
        near = points + away / np.maximum(size, 1e-9) * np.minimum(passing[:, None], size)
        times.append((np.linalg.norm(np.diff(near, axis=0), axis=1) / speed).sum())
    assert 0 < bound <= min(times)


def test_in_a_tube_for_two_link_arms_the_tool_may_be_beside_the_end():
    """That arm does not reach all points of the ball: its tool is anywhere in it."""
    problem = limited_tool(tube_speed=SPEED, count=1)
    length = np.linalg.norm(np.diff(problem.tube.points, axis=0))
    assert tool_travel(problem) == pytest.approx((length - 2 * 0.05) / SPEED, rel=1e-4)
