"""Few corners of a path."""

from itertools import pairwise

import numpy as np
import pytest

from tubeplanner.tube_sources.simplification import farthest_from_line, simplified

CORNER = np.array([[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, 1, 0.0]])


def test_corners_are_kept_and_points_on_lines_are_not():
    assert simplified(CORNER, 0.01) == [0, 2, 4]


@pytest.mark.parametrize("deviation", [0.003, 0.01, 0.05])
def test_every_point_is_within_the_deviation_of_the_kept_lines(deviation):
    rng = np.random.default_rng(3)
    points = np.cumsum(rng.normal(0, 0.01, (300, 3)), axis=0)
    kept = simplified(points, deviation)
    assert kept[0] == 0 and kept[-1] == 299
    for i, j in pairwise(kept):
        ahead = points[j] - points[i]
        for point in points[i : j + 1]:
            share = np.clip((point - points[i]) @ ahead / (ahead @ ahead), 0, 1)
            assert np.linalg.norm(point - points[i] - share * ahead) <= deviation + 1e-12


def test_a_way_back_is_measured_from_the_segment_not_from_its_line():
    there_and_back = np.array([[0, 0, 0], [2.0, 0, 0], [1.0, 0, 0]])
    assert farthest_from_line(there_and_back, 0, 2) == (1, 1.0)


def test_equal_ends_and_neighbours_have_no_corner():
    still = np.zeros((3, 3))
    assert farthest_from_line(still, 0, 2) == (1, 0.0)
    assert farthest_from_line(still, 0, 1) == (0, 0.0)
