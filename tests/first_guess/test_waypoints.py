"""Candidate waypoints of phase 1, links clear near them, quartics through them at equal times."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cases import waypoints_of
from numpy.polynomial import Polynomial

from tubeplanner import Obstacle, PlanningProblem, Tube, placement_of
from tubeplanner.first_guess.branches import redundancy_rules, reference_branch
from tubeplanner.first_guess.segment_rules import LinkClearance
from tubeplanner.first_guess.waypoints import (
    candidate_waypoints,
    look_ahead_quartic,
    quartic_spline,
    sequential_quartics,
)

NAMES = ("first", "second")
PRIMITIVES = (sequential_quartics, quartic_spline)


@pytest.mark.parametrize(("name", "count"), [("two_link/around_a_post", 2), ("ur5/level_tray", 30)])
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
    last_joint = waypoints_of(problem, 5)[:, 6]
    np.testing.assert_allclose(last_joint, np.linspace(0.5, 1.3, 5), atol=1e-6)


# Links clear of obstacles and of each other near waypoints, against measuring every pair.


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
    waypoints = waypoints_of(problem, 12)
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
    waypoints = waypoints_of(problem, 12)
    tool = two_link.tool_position(waypoints)
    ball = Obstacle.sphere("ball", 0.01, placement_of(tool[5]))
    blocked = replace(problem, obstacles=[ball])
    free = LinkClearance(blocked, waypoints).free_waypoints
    assert not free[5]
    np.testing.assert_array_equal(free, [is_free(blocked, q) for q in waypoints])


# Trajectories through waypoints: the conditions of the paper, and what follows from them.


def waypoints(count, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (count, len(NAMES)))


def polynomials(trajectory, joint):
    return [Polynomial(c) for c in trajectory.coefficients[::-1, :, joint].T]


@pytest.mark.parametrize("count", [2, 3, 4, 9])
@pytest.mark.parametrize("primitive", PRIMITIVES)
def test_the_trajectory_passes_all_waypoints_smoothly_and_rests_at_both_ends(primitive, count):
    points = waypoints(count)
    trajectory = primitive(NAMES, points)
    np.testing.assert_array_equal(trajectory.breakpoints, np.arange(count))
    np.testing.assert_allclose(trajectory.position(np.arange(count)), points, atol=1e-12)
    for order in range(3):
        derivatives = [[p.deriv(order) for p in polynomials(trajectory, joint)] for joint in (0, 1)]
        for pieces in derivatives:
            jumps = [after(0.0) - before(1.0) for before, after in pairwise(pieces)]
            np.testing.assert_allclose(jumps, 0, atol=1e-11)
            if order > 0:
                np.testing.assert_allclose([pieces[0](0.0), pieces[-1](1.0)], 0, atol=1e-11)


@pytest.mark.parametrize("primitive", PRIMITIVES)
def test_two_waypoints_are_joined_by_the_quintic(primitive):
    start, goal = points = waypoints(2)
    s = np.linspace(0, 1, 11)[:, None]
    expected = start + (goal - start) * (10 * s**3 - 15 * s**4 + 6 * s**5)
    np.testing.assert_allclose(primitive(NAMES, points).position(s[:, 0]), expected, atol=1e-13)


def test_three_waypoints_leave_no_freedom_to_either_primitive():
    points = waypoints(3)
    one, other = (primitive(NAMES, points).coefficients for primitive in PRIMITIVES)
    np.testing.assert_allclose(one, other, atol=1e-12)


def test_a_segment_aims_at_the_waypoint_after_its_end():
    state = waypoints(5, seed=1)
    quartic = look_ahead_quartic(*state)[:, 0]
    for joint in (0, 1):
        p = Polynomial(quartic[::-1, joint])
        found = [p(0.0), p.deriv(1)(0.0), p.deriv(2)(0.0), p(1.0), p(2.0)]
        np.testing.assert_allclose(found, state[:, joint], atol=1e-12)


def test_a_segment_depends_on_no_waypoint_beyond_the_next_but_one():
    points = waypoints(8)
    moved = points.copy()
    moved[5] += 1.0
    before, after = (sequential_quartics(NAMES, w).coefficients for w in (points, moved))
    np.testing.assert_array_equal(before[:, :3], after[:, :3])
    assert (before[:, 3] != after[:, 3]).any()


def test_errors_of_the_sequential_state_grow_by_a_known_factor():
    """Velocity and acceleration errors grow by -1.593 per segment: many waypoints are unstable."""
    zero = np.zeros(2)
    basis = np.eye(2)  # a unit error of the velocity, and one of the acceleration
    quartic = look_ahead_quartic(zero, basis[0], basis[1], zero, zero)[:, 0]
    step = [[Polynomial(c[::-1]).deriv(order)(1.0) for c in quartic.T] for order in (1, 2)]
    eigenvalues = np.linalg.eigvals(np.array(step))
    assert eigenvalues[abs(eigenvalues).argmax()] == pytest.approx(-1.593, abs=5e-4)


def test_the_spline_is_quartic_at_its_ends_and_cubic_between():
    coefficients = quartic_spline(NAMES, waypoints(6)).coefficients
    assert (abs(coefficients[0, [0, -1]]) > 1e-3).all()
    np.testing.assert_array_equal(coefficients[0, 1:-1], 0)


def test_the_spline_is_stable_with_many_waypoints():
    """A disturbance dies out along the spline, and explodes along sequential quartics."""
    points = np.zeros((24, 2))
    points[3] = 0.01
    spline, quartics = (primitive(NAMES, points) for primitive in PRIMITIVES[::-1])
    late = np.linspace(16, 23, 200)
    assert abs(spline.position(late)).max() < 1e-7
    assert abs(quartics.position(late)).max() > 1.0
