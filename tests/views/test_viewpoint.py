"""From where a scene is looked at, and the floor it stands on."""

import numpy as np
import pytest

from tubeplanner import Obstacle, placement_of
from tubeplanner.views.surface import coarse_hull_points, directions
from tubeplanner.views.viewpoint import best_direction, floor_grid, outline


def test_whoever_looks_is_not_behind_a_wall():
    path = np.array([[0, -0.3, 0.2], [0, -0.3, 0.5], [0, 0.3, 0.5], [0, 0.3, 0.2]])
    seen = {}
    for x in (-0.5, 0.5):
        wall = Obstacle.box("wall", [0.02, 4, 8], placement_of([x, 0, 0])).shapes
        seen[x] = best_direction(path, [], [wall])
        assert seen[x][2] > 0
    assert seen[-0.5][0] > 0 > seen[0.5][0]


def test_the_floor_is_a_grid_of_round_lengths_under_all():
    for size, expected in ((0.5, 0.1), (1.2, 0.5), (30.0, 5.0)):
        edges, step = floor_grid(np.array([[0.01, 0, 0], [size, size / 2, 1]]))
        assert step == expected
        assert np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) == pytest.approx(step)
        assert edges[..., 0].min() <= 0
        assert edges[..., 0].max() >= size
        assert (edges[..., 2] == 0).all()


def test_an_outline_holds_all_points():
    flat = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0.5, 0.5, 0]])
    assert (outline(flat).min(axis=0) == 0).all()
    assert (outline(flat).max(axis=0) == [1, 2, 0]).all()
    cloud = directions(500) * np.array([1, 2, 3])
    assert len(coarse_hull_points(cloud)) <= 48
    assert np.ptp(outline(cloud), axis=0) == pytest.approx(np.ptp(cloud, axis=0))
