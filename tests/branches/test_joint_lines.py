"""Starts of refinement that no continuous branch of the inverse kinematics gives."""

import numpy as np
import pytest

from cases import SHORTEST
from tubeplanner import Obstacle, PlanningProblem, Tube, load_problem, placement_of, plan
from tubeplanner.branches.joint_lines import joint_lines
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.outcome import Infeasible


@pytest.mark.parametrize("name", ["ur5/over_the_wall", "ur5/level_tray", "panda/between_shelves"])
def test_they_join_configurations_at_the_reference_points(name):
    problem = load_problem(f"example:{name}")
    lines = joint_lines(problem)
    corners = np.array([lines.start, *(segment[-1] for segment in lines.segments)])
    tool = problem.robot.tool_position(corners)
    np.testing.assert_allclose(tool[1:-1], problem.tube.points[1:-1], atol=1e-6)
    for k, segment in enumerate(lines.segments):
        np.testing.assert_allclose(segment[0], corners[k])
        np.testing.assert_allclose(np.diff(segment, n=2, axis=0), 0, atol=1e-12)
        assert (segment >= problem.joint_lower[k] - 1e-12).all()
        assert (segment <= problem.joint_upper[k] + 1e-12).all()
    if problem.goal is not None:
        np.testing.assert_array_equal(lines.goal, problem.goal)
    if problem.tube.rotation is not None:
        margin = problem.tube.rotation.margin(*problem.robot.tool_pose(corners[1:]), 0)
        assert (margin > 0).all()


def other_elbow(two_link):
    """From one side of the stretched arm to the other: no branch goes on through it."""
    start, goal = np.array([0.0, -0.6]), np.array([-0.5, 0.6])
    tool = two_link.tool_position(np.array([start, goal]))
    return PlanningProblem(two_link, Tube(tool, 0.06), start, goal)


def test_a_goal_on_another_branch_is_reached_through_the_stretched_arm(two_link):
    problem = other_elbow(two_link)
    for rule in redundancy_rules(problem):
        with pytest.raises(Infeasible, match="the goal lies on another branch"):
            reference_branch(problem, rule)
    result = plan(problem, SHORTEST)
    assert result.succeeded
    assert result.method == "refinement"
    elbow = result.trajectory.position(np.linspace(0, result.duration, 50))[:, 1]
    assert elbow.min() < -0.5 < 0.5 < elbow.max()


def test_an_open_goal_is_moved_out_of_a_collision(ur5):
    """The nearest goal has the forearm in a ball; another one has not."""
    start = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
    tool = ur5.tool_position(start[None])[0]
    tube = Tube(tool + np.array([[0, 0, 0], [0, 0.4, 0.1]]), 0.08, joint_signs={"elbow_joint": "+"})
    open_problem = PlanningProblem(ur5, tube, start)
    goal = reference_branch(open_problem, redundancy_rules(open_problem)[0]).goal
    body = ur5.link_body["wrist_1_link"]
    wrist = ur5.body_poses(goal[None])[1][0, body]
    ball = Obstacle.sphere("ball", 0.05, placement_of(wrist + np.array([0.0, 0.0, 0.06])))
    result = plan(PlanningProblem(ur5, tube, start, obstacles=[ball]), SHORTEST)
    assert result.succeeded
    assert result.method == "refinement"
    blocked = plan(PlanningProblem(ur5, tube, start, goal, obstacles=[ball]), SHORTEST)
    assert "in the goal configuration" in blocked.message
