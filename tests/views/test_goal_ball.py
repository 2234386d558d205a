"""The ball of a goal in the scene: as large as its tolerance, about its position."""

import numpy as np
import pytest

from tubeplanner import GoalRegion
from tubeplanner.views.goal_ball import goal_ball


def test_it_is_the_ball_itself(bundled):
    problem = bundled("two_link/around_a_post")
    position = problem.tube.points[-1] + np.array([0.0, 0.01, 0.0])
    (ball,) = goal_ball(GoalRegion(position, 0.02))
    away = np.linalg.norm(ball.vertices - position, axis=1)
    np.testing.assert_allclose(away, 0.02, rtol=1e-5)
    np.testing.assert_allclose(ball.vertices.mean(axis=0), position, atol=1e-3)


@pytest.mark.parametrize("tolerance", [None, 0.0])
def test_a_point_has_none(tolerance, bundled):
    problem = bundled("two_link/around_a_post")
    end = None if tolerance is None else GoalRegion(problem.tube.points[-1], tolerance)
    assert goal_ball(end) == []
