"""Boxes around shapes, and the bounds on distances that they give."""

import numpy as np
import pytest

from tubeplanner import Obstacle, placement_of
from tubeplanner.collision.bounding_box import bounding_boxes


def plate(rpy=(0, 0, 0.6)):
    return Obstacle.box("plate", [1.0, 0.5, 0.02], placement_of([0.2, 0, 0], rpy=rpy)).shapes[0]


def test_a_turned_plate_has_a_box_as_flat_as_itself():
    boxes = bounding_boxes([plate()])
    np.testing.assert_allclose(sorted(boxes.half[0]), [0.01, 0.25, 0.5], atol=1e-9)


def test_distances_are_those_of_the_box():
    boxes, point = (
        bounding_boxes([plate((0, 0, 0))] * 3),
        [[0.2, 0, 0.31], [0.2, 0.1, 0], [1, 0, 0]],
    )
    np.testing.assert_allclose(boxes.distance(np.arange(3), np.array(point)), [0.3, 0, 0.3])


def test_no_shapes_have_no_boxes():
    assert bounding_boxes([]).axes.shape == (0, 3, 3)


@pytest.mark.parametrize("name", ["ur5/over_the_wall", "panda/between_shelves"])
def test_bounds_are_below_the_distances_and_beside_a_plate_closer_than_spheres(name, bundled):
    checker = bundled(name).collision
    q = np.random.default_rng(5).uniform(-2, 2, (20, checker.robot.joint_count))
    rotation, position = checker.robot.body_poses(q)
    spheres = checker.sphere_distances(rotation, position, checker.pairs)
    row, pair = np.nonzero(np.isfinite(spheres))
    pairs = checker.pairs[pair]
    boxes = checker.box_distances(rotation, position, row, pairs)
    exact = checker.closest_points(rotation[row], position[row], pairs).distance
    assert (boxes <= np.maximum(exact, 0) + 1e-9).all()
    assert (boxes > spheres[row, pair] + 0.1).mean() > 0.1
