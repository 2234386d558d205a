"""Distances that matter, against those of every pair, with and without the native library."""

import numpy as np
import pytest

from tubeplanner import load_problem
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.near_distances import near_distances

MATTERS = 0.08  # [m]


@pytest.fixture(scope="module", params=["as built", "pure Python"])
def checker(request):
    problem = load_problem("example:ur5/over_the_wall")
    made = CollisionChecker(problem.robot, problem.obstacles)
    if request.param == "pure Python":
        vars(made)["_native"] = None
    return made


@pytest.fixture(scope="module")
def q():
    share = np.linspace(0, 1, 25)[:, None]  # across the wall, through it
    return (1 - share) * [-1.2, -0.9, 1.5, -2.1, -1.5, 0] + share * [1.2, -0.5, 1.4, -2.4, -1.5, 0]


def every_distance(checker, q):
    rotation, position = checker.robot.body_poses(q)
    poses = zip(rotation, position, strict=True)
    return np.array([checker.distances(*pose, checker.pairs) for pose in poses])


def test_distances_are_exact_where_they_matter_and_lower_bounds_elsewhere(checker, q):
    exact = every_distance(checker, q)
    matters = np.full(exact.shape, MATTERS)
    found = near_distances(checker, q, checker.pairs, matters, np.full(exact.shape, -np.inf))
    near = exact < MATTERS - 1e-6
    assert (exact < 0).any()
    assert near.sum() > 20
    np.testing.assert_allclose(found[near], exact[near], rtol=0, atol=2e-5)
    assert (found <= exact + 2e-5).all()
    assert (found[~near] >= MATTERS - 2e-5).all()


def test_what_is_known_to_be_far_enough_stays_as_it_is(checker, q):
    known = np.full((len(q), len(checker.pairs)), MATTERS + 100.0)
    matters = np.full(known.shape, MATTERS)
    np.testing.assert_array_equal(near_distances(checker, q, checker.pairs, matters, known), known)
