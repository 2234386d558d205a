"""Seeds of a robot that stands elsewhere: its own where they lead somewhere, else others."""

import numpy as np

from tubeplanner import Obstacle, PlanningProblem, Seed, Tube, placement_of
from tubeplanner.branches.reference_branch import end_configuration
from tubeplanner.studies.leading_seeds import leading_seeds

POINTS = [[0.4, 0.0, 0.0], [0.35, 0.0, 0.0]]
BELOW = np.array([-0.8, 1.6])  # the elbow is on the right of the way to the tool


def problem(two_link, seed=BELOW, obstacles=(), points=POINTS):
    return PlanningProblem(two_link, Tube(points, 0.02), Seed(seed), Seed(seed), obstacles)


def post(y):
    return Obstacle.cylinder("post", 0.03, 0.4, placement_of((0.2, y, 0.0)))


def test_a_seed_that_leads_to_a_free_configuration_stays(two_link):
    assert leading_seeds(problem(two_link), ("start", "goal")) == {}
    assert leading_seeds(problem(two_link, obstacles=[post(0.22)]), ("start", "goal")) == {}


def test_a_seed_that_leads_into_an_obstacle_gives_way_to_the_nearest_that_does_not(two_link):
    blocked = problem(two_link, obstacles=[post(-0.22)])
    found = leading_seeds(blocked, ("start", "goal"))
    assert set(found) == {"start", "goal"}
    assert set(leading_seeds(blocked, ("goal",))) == {"goal"}
    for end, point in (("start", 0), ("goal", -1)):
        q = end_configuration(blocked, Seed(np.array(found[end])), point)
        np.testing.assert_allclose(q, found[end], atol=2e-6)
        assert q[1] < 0
        others = q + 2 * np.pi * np.array([[1, 0], [-1, 0]])
        assert np.linalg.norm(q - BELOW) < np.linalg.norm(others - BELOW, axis=1).min()


def test_where_nothing_leads_there_the_seed_stays(two_link):
    far = [[0.9, 0.0, 0.0], [0.8, 0.0, 0.0]]
    assert leading_seeds(problem(two_link, points=far), ("start",)) == {}
