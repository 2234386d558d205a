import numpy as np
import pytest

from cases import PROBLEMS
from tubeplanner import PlanningProblem, Tube
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.waypoint_search.candidate_waypoints import candidate_waypoints


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("count", [2, 3, 30])
def test_the_tools_are_equally_spaced_along_the_reference_path(name, count, bundled):
    problem = bundled(name)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    waypoints = candidate_waypoints(problem, branch, count)
    assert waypoints.shape == (count, problem.robot.joint_count)
    np.testing.assert_array_equal(waypoints[0], branch.start)
    np.testing.assert_array_equal(waypoints[-1], branch.goal)
    points = problem.tube.points
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    wanted = np.linspace(0, way[-1], count)
    expected = np.column_stack([np.interp(wanted, way, points[:, axis]) for axis in range(3)])
    tool = problem.robot.tool_position(waypoints)
    np.testing.assert_allclose(tool, expected, atol=1e-4)
    inside = (waypoints[:, None] >= problem.joint_lower) & (
        waypoints[:, None] <= problem.joint_upper
    )
    assert inside.all(axis=2).any(axis=1).all()


def test_where_only_redundant_joints_move_they_are_equally_spaced_themselves(panda):
    q = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])
    goal = q + np.array([0, 0, 0, 0, 0, 0, 0.8])
    tool = panda.tool_position(q[None])[0]
    tube = Tube(tool + np.array([[0, 0, 0], [1e-5, 0, 0]]), 0.05)
    problem = PlanningProblem(panda, tube, q, goal)
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    last_joint = candidate_waypoints(problem, branch, 5)[:, 6]
    np.testing.assert_allclose(last_joint, np.linspace(0.5, 1.3, 5), atol=1e-6)
