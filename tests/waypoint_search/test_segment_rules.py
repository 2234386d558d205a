"""Links clear of obstacles and of each other near the waypoints, against every pair."""

import numpy as np
import pytest

from tubeplanner import Obstacle, placement_of
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.waypoint_search.candidate_waypoints import candidate_waypoints
from tubeplanner.waypoint_search.link_clearance import LinkClearance


def waypoints_of(problem):
    branch = reference_branch(problem, redundancy_rules(problem)[0])
    return candidate_waypoints(problem, branch, 12)


def is_free(problem, q):
    """Measure every pair of one configuration."""
    checker = problem.collision
    rotation, position = (poses[0] for poses in problem.robot.body_poses(q[None]))
    obstacles = checker.distances(rotation, position, checker.obstacle_pairs)
    links = checker.distances(rotation, position, checker.link_pairs)
    return (obstacles >= problem.clearance).all() and (links >= 0).all()


@pytest.mark.parametrize(
    ("name", "spread"), [("two_link/around_a_post", 0.1), ("ur5/over_the_wall", 0.5)]
)
def test_configurations_are_judged_as_by_measuring_every_pair(name, spread, bundled):
    """Near the waypoints, where bounds decide, and far away, where pairs are measured."""
    problem = bundled(name)
    waypoints = waypoints_of(problem)
    rng = np.random.default_rng(7)
    nearest = rng.integers(len(waypoints), size=60)
    q = waypoints[nearest] + rng.uniform(-spread, spread, (60, waypoints.shape[1]))
    free = LinkClearance(problem, waypoints).is_free(q, nearest)
    expected = np.array([is_free(problem, row) for row in q])
    np.testing.assert_array_equal(free, expected)
    if spread == 0.5:
        assert 0 < expected.sum() < len(expected)


def test_waypoints_in_collision_are_known(bundled, two_link):
    problem = bundled("two_link/around_a_post")
    waypoints = waypoints_of(problem)
    tool = two_link.tool_position(waypoints)
    ball = Obstacle.sphere("ball", 0.01, placement_of(tool[5]))
    blocked = type(problem)(two_link, problem.tube, problem.start, obstacles=[ball])
    free = LinkClearance(blocked, waypoints).free_waypoints
    assert not free[5]
    np.testing.assert_array_equal(free, [is_free(blocked, q) for q in waypoints])
