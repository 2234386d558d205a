"""Solids that change hands: where they stand, by hand and against their shapes."""

from pathlib import Path

import numpy as np
import pytest

from tubeplanner import Obstacle, placement_of
from tubeplanner.collision.handed_over import left, taken

MESH = Path(__file__).parent.parent / "cases" / "mesh_U.obj"
QUARTER = placement_of([1.0, 2.0, 3.0], rpy=[0, 0, np.pi / 2])
TILTED = placement_of([0.3, -0.2, 0.5], rpy=[0.3, -0.8, 2.0])
KINDS = {
    "box": Obstacle.box("part", [0.2, 0.1, 0.4], placement_of([1.0, 2.5, 3.0])),
    "sphere": Obstacle.sphere("part", 0.1, placement_of([1.0, 2.5, 3.0])),
    "cylinder": Obstacle.cylinder("part", 0.1, 0.4, placement_of([1.0, 2.5, 3.0])),
    "mesh": Obstacle.mesh("part", MESH, placement_of([1.0, 2.5, 3.0]), 0.01),
}


def corners(solid):
    return np.concatenate([shape.vertices for shape in solid.shapes])


def test_a_box_ahead_of_a_turned_tool_is_ahead_of_it_in_its_frame():
    """The tool looks along y, so 0.5 m along y is 0.5 m along its x; its sides turn likewise."""
    part = taken(KINDS["box"], QUARTER)
    assert part.name == "part"
    assert part.touch_links == ()
    half = abs(corners(part) - [0.5, 0, 0]).max(axis=0)
    np.testing.assert_allclose(half, [0.05, 0.1, 0.2], atol=1e-12)


def test_what_is_let_go_elsewhere_stands_where_the_tool_is_then():
    """Taken half a metre ahead of the tool along y, let go half a metre ahead of it along z."""
    up = placement_of([0.0, 0.0, 1.0], rpy=[0, -np.pi / 2, 0])  # its x is up, its z along -x
    stands = left(taken(KINDS["box"], QUARTER), up)
    middle = (corners(stands).min(axis=0) + corners(stands).max(axis=0)) / 2
    np.testing.assert_allclose(middle, [0.0, 0.0, 1.5], atol=1e-12)
    extent = corners(stands).max(axis=0) - corners(stands).min(axis=0)
    np.testing.assert_allclose(extent, [0.4, 0.2, 0.1], atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_let_go_where_it_was_taken_stands_as_before(kind):
    back = left(taken(KINDS[kind], TILTED), TILTED)
    np.testing.assert_allclose(corners(back), corners(KINDS[kind]), atol=1e-12)
    np.testing.assert_allclose(back.contents.placement, KINDS[kind].contents.placement, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_what_pictures_show_moves_with_what_is_judged(kind):
    moved = taken(KINDS[kind], TILTED)
    expected = np.linalg.inv(TILTED) @ KINDS[kind].contents.placement
    np.testing.assert_allclose(moved.contents.placement, expected, atol=1e-12)
    same = KINDS[kind].contents
    assert (moved.contents.kind, moved.contents.sizes) == (same.kind, same.sizes)
