"""Arc lengths and points between, against what a drawing says."""

import numpy as np
import pytest

from tubeplanner.polyline import arc_lengths, densified

CORNERS = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0], [3.0, 5.0]])


def test_arc_lengths_are_those_of_a_drawing():
    assert arc_lengths(CORNERS) == pytest.approx([0, 5, 5, 6])


def test_arc_lengths_of_a_circle_come_near_its_circumference():
    angle = np.linspace(0, 2 * np.pi, 2001)
    points = np.column_stack([np.cos(angle), np.sin(angle)])
    assert arc_lengths(points)[-1] == pytest.approx(2 * np.pi, rel=1e-5)


def test_points_between_are_evenly_on_the_lines():
    found = densified(CORNERS, 1.5)
    lines = [[0, 0], [1, 4 / 3], [2, 8 / 3], [3, 4], [3, 4], [3, 5]]
    np.testing.assert_allclose(found, lines)


def test_no_coordinate_steps_farther_and_corners_stay():
    corners = np.random.default_rng(0).normal(size=(6, 7))
    found = densified(corners, 0.1)
    assert abs(np.diff(found, axis=0)).max() <= 0.1 + 1e-12
    assert all((found == corner).all(axis=1).any() for corner in corners)
