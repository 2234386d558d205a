"""How multiples of a point's speed change with an arm's path."""

import numpy as np

from tubeplanner.constraints.speed_of_points import speed_by_path

STEP = 1e-6


def test_they_are_the_derivatives_of_the_speed(ur5):
    q, v = np.random.default_rng(1).uniform(-1, 1, (2, 6, 6))
    scale = np.linspace(0.5, 2.0, 6)

    def speed(q, v):
        return scale * np.linalg.norm(ur5.tool_velocity(q, v)[0], axis=1)

    by_q, by_v = speed_by_path(ur5.tool_velocity(q, v), scale)
    for j, direction in enumerate(np.eye(6)):
        along_q = (speed(q + STEP * direction, v) - speed(q - STEP * direction, v)) / (2 * STEP)
        along_v = (speed(q, v + STEP * direction) - speed(q, v - STEP * direction)) / (2 * STEP)
        np.testing.assert_allclose(by_q[:, j], along_q, atol=1e-7)
        np.testing.assert_allclose(by_v[:, j], along_v, atol=1e-7)


def test_where_the_point_rests_there_is_none(ur5):
    found = speed_by_path(ur5.tool_velocity(*np.zeros((2, 3, 6))), np.ones(3))
    assert all((each == 0).all() for each in found)
