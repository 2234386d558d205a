"""Pictures of solids: what is in front is seen, translucent ones over it, the cell cut to size."""

import numpy as np
import pytest

from tubeplanner import Obstacle, placement_of
from tubeplanner.geometry.convex_shapes import box
from tubeplanner.output.drawing import CARRIED_COLOR, rgb, shape_surface
from tubeplanner.output.figures import rendering as rendered_solids
from tubeplanner.output.figures.rendering import RenderedSolid, SpaceView, rendered
from tubeplanner.output.figures.space_panel import obstacle_solids

RED, BLUE = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
ABOVE = SpaceView(np.array([0.0, 0.0, 1.0]))


@pytest.fixture(autouse=True)
def fine_pictures(monkeypatch):
    """Pixels are looked at one by one."""
    monkeypatch.setattr(rendered_solids, "_PIXELS", 250)


def plate(height, color, side=1.0, alpha=1.0, edges=False):
    """Return a thin square plate at a height [m]."""
    placement = np.eye(4)
    placement[2, 3] = height
    surface = shape_surface(box([side, side, 0.01])).moved(placement)
    return RenderedSolid(surface, color, alpha, edges)


def pixel(picture, x, y):
    """Return the colour of a picture at a place on the page [m]."""
    height, width, _ = picture.pixels.shape
    fraction = (np.array([x, y]) - picture.low) / (picture.high - picture.low)
    column, row = (fraction * [width, height]).astype(int)
    return picture.pixels[row, column]


def test_what_is_in_front_is_seen():
    solids = [plate(0.0, RED, 2.0), plate(1.0, BLUE)]
    for ordered in (solids, solids[::-1]):
        picture = rendered(ordered, ABOVE)
        assert pixel(picture, 0.0, 0.0)[2] > 0.5 > pixel(picture, 0.0, 0.0)[0]
        assert pixel(picture, 0.8, 0.0)[0] > 0.5 > pixel(picture, 0.8, 0.0)[2]
    below = SpaceView(np.array([0.0, 0.6, -0.8]))
    assert pixel(rendered(solids, below), 0.0, 0.0)[0] > 0.5


def test_through_what_is_translucent_the_rest_is_seen():
    """Each once, with its own share: the side towards the viewer alone counts."""
    ground = pixel(rendered([plate(0.0, RED, 2.0)], ABOVE), 0.0, 0.0)
    over = pixel(rendered([plate(1.0, BLUE)], ABOVE), 0.0, 0.0)
    picture = rendered([plate(1.0, BLUE, alpha=0.25), plate(0.0, RED, 2.0)], ABOVE)
    expected = 0.25 * over[:3] + 0.75 * ground[:3]
    np.testing.assert_allclose(pixel(picture, 0.0, 0.0), [*expected, 1.0], atol=1e-9)
    hidden = rendered([plate(-1.0, BLUE, alpha=0.25), plate(0.0, RED, 2.0)], ABOVE)
    np.testing.assert_allclose(pixel(hidden, 0.0, 0.0), ground)


def test_translucent_solids_are_laid_over_each_other_from_far_to_near():
    red, blue = plate(0.0, RED, alpha=0.5), plate(1.0, BLUE, alpha=0.5)
    for solids in ([red, blue], [blue, red]):
        color = pixel(rendered(solids, ABOVE), 0.0, 0.0)
        assert color[3] == pytest.approx(0.75)
        assert color[2] == pytest.approx(2 * color[0])


def test_sharp_edges_are_drawn_dark():
    plain = rendered([plate(0.0, RED, alpha=0.5)], ABOVE)
    edged = rendered([plate(0.0, RED, alpha=0.5, edges=True)], ABOVE)
    np.testing.assert_allclose(pixel(edged, 0.1, 0.2), pixel(plain, 0.1, 0.2))
    assert pixel(edged, 0.4995, 0.2)[3] > 0.8 > pixel(plain, 0.4995, 0.2)[3]
    diagonal = [pixel(edged, x, -x)[3] for x in np.linspace(-0.4, 0.4, 9)]
    assert max(diagonal) == pytest.approx(0.5)  # of triangles in one plane none


def drawn(*boxes, handed_over=()):
    """Return the drawn solids of boxes, by sides and position [m], about a cube of 1 m."""
    placed = enumerate(boxes)
    obstacles = [Obstacle.box(f"box{k}", sides, placement_of(at)) for k, (sides, at) in placed]
    return obstacle_solids(obstacles, handed_over, np.zeros(3), np.ones(3))


def test_what_stands_beside_the_box_is_drawn_whole_and_what_is_farther_is_not():
    (beside,) = drawn(((0.2, 0.2, 0.2), (0.5, 1.25, 0.5)))
    np.testing.assert_allclose(np.ptp(beside.surface.vertices, axis=0), 0.2)
    assert not drawn(((0.2, 0.2, 0.2), (0.5, 1.45, 0.5)))


def test_a_floor_is_cut_where_the_last_of_the_others_ends():
    floor, shelf = drawn(((9, 9, 0.1), (0.5, 0.5, -0.05)), ((0.2, 0.2, 0.4), (0.5, 1.2, 0.5)))
    np.testing.assert_allclose(floor.surface.vertices[:, :2].min(axis=0), [0, 0], atol=1e-9)
    np.testing.assert_allclose(floor.surface.vertices[:, :2].max(axis=0), [1, 1.3], atol=1e-9)
    assert shelf.surface.vertices[:, 1].max() == pytest.approx(1.3)


def test_what_the_arm_takes_has_a_colour_of_its_own():
    sides = (0.1, 0.1, 0.1)
    taken, left = drawn((sides, (0.5, 0.5, 0.5)), (sides, (0.2, 0.5, 0.5)), handed_over=["box0"])
    assert (*taken.color, taken.alpha > left.alpha) == (*rgb(CARRIED_COLOR), True)
