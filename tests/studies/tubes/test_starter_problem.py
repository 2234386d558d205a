"""Routes that begin at the tool and stay where the arm can move it."""

import numpy as np
import pytest

from tubeplanner import load_robot
from tubeplanner.studies.tubes.starter_problem import starter_routes


def routes_from(robot, q):
    """Return the routes of at most 0.8 rad from a configuration, which begin at its tool."""
    routes = list(starter_routes(robot, np.array(q), 0.8))
    assert len(routes) >= 12
    for points in routes:
        np.testing.assert_allclose(points[0], robot.tool_position(np.array(q)), atol=1e-4)
    return routes


def test_routes_go_up_over_and_down_the_longest_first(ur5):
    routes = routes_from(ur5, [0.3, -1.2, 1.4, -1.0, -0.9, 0.2])
    up, over, down = np.diff(routes[0], axis=0)
    np.testing.assert_allclose([up, -down], [[0, 0, 0.2]] * 2, atol=2e-4)
    assert over[2] == pytest.approx(0, abs=2e-4)
    assert np.linalg.norm(over) == pytest.approx(0.4, abs=1e-3)
    assert over @ routes[0][0] == pytest.approx(0, abs=1e-3)  # around the base
    # Both ways over, up or down first, then shorter ones.
    lengths = [np.linalg.norm(points[1] - points[0]) for points in routes]
    np.testing.assert_allclose(lengths, np.repeat([0.2, 0.12, 0.064], 4), atol=1e-3)
    ends = {tuple(np.sign(points[2] - points[0]).tolist()) for points in routes[:4]}
    assert len(ends) == 4


def test_an_arm_in_a_plane_stays_in_it(two_link):
    routes = routes_from(two_link, [0.4, 1.1])
    for points in routes:
        np.testing.assert_allclose(points[:, 2], routes[0][0, 2], atol=1e-8)
    up, over, _ = np.diff(routes[0], axis=0)
    assert up @ over == pytest.approx(0, abs=1e-6)
    # The last ones are where the joints take the tool.
    stepped = two_link.tool_position(np.array([[0.4, 1.1], [0.65, 1.1], [0.65, 1.35]]))
    np.testing.assert_allclose(routes[-2], stepped, atol=1e-8)


def test_a_tool_on_a_circle_stays_on_it():
    robot = load_robot("example:two_link", "hand", joints=["joint2"])
    routes = starter_routes(robot, np.array([0.2]), 0.5)
    for points, direction in zip(routes, (1, -1), strict=True):
        turned = robot.tool_position(0.2 + direction * np.array([[0.0], [0.25], [0.5]]))
        np.testing.assert_allclose(points, turned, atol=1e-8)
