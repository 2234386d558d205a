"""What of a cell is drawn in space: what is in the box or beside it, large things cut."""

import numpy as np
import pytest

from tubeplanner import Obstacle, placement_of
from tubeplanner.views.palette import CARRIED_COLOR, rgb
from tubeplanner.views.space_solids import obstacle_solids

LOW, HIGH = np.zeros(3), np.ones(3)


def drawn(*boxes, handed_over=()):
    obstacles = [
        Obstacle.box(f"box{k}", sides, placement_of(at)) for k, (sides, at) in enumerate(boxes)
    ]
    return obstacle_solids(obstacles, handed_over, LOW, HIGH)


@pytest.mark.parametrize(("beside", "count"), [(1.25, 1), (1.45, 0)])
def test_what_stands_beside_the_box_is_drawn_whole_and_what_is_farther_is_not(beside, count):
    found = drawn(((0.2, 0.2, 0.2), (0.5, beside, 0.5)))
    assert len(found) == count
    for solid in found:
        np.testing.assert_allclose(np.ptp(solid.surface.vertices, axis=0), 0.2)


def test_a_floor_is_cut_where_the_last_of_the_others_ends():
    floor, shelf = drawn(((9, 9, 0.1), (0.5, 0.5, -0.05)), ((0.2, 0.2, 0.4), (0.5, 1.2, 0.5)))
    np.testing.assert_allclose(floor.surface.vertices[:, :2].min(axis=0), [0, 0], atol=1e-9)
    np.testing.assert_allclose(floor.surface.vertices[:, :2].max(axis=0), [1, 1.3], atol=1e-9)
    assert shelf.surface.vertices[:, 1].max() == pytest.approx(1.3)


def test_what_the_arm_takes_has_a_colour_of_its_own():
    taken, left = drawn(
        ((0.1, 0.1, 0.1), (0.5, 0.5, 0.5)),
        ((0.1, 0.1, 0.1), (0.2, 0.5, 0.5)),
        handed_over=["box0"],
    )
    np.testing.assert_array_equal(taken.color, rgb(CARRIED_COLOR))
    assert taken.alpha == 1.0 and left.alpha < 1.0
