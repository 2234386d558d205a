"""Convex shapes, hulls, bounding boxes, evenly spread directions."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose as close
from scipy.optimize import nnls
from scipy.spatial import ConvexHull, Delaunay

from tubeplanner import Obstacle, placement_of
from tubeplanner.geometry.convex_shapes import (
    MAX_THINNED_CORNERS,
    ConvexShape,
    bounding_boxes,
    box,
    capsule,
    convex_hull,
    cylinder,
    sphere,
)


def directions(count, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def support(shape, direction):
    """Return the extent of the grown polytope along unit directions (N, 3)."""
    return (direction @ shape.vertices.T).max(axis=1) + shape.radius


SOLIDS = {
    "box": (box([0.2, 0.4, 0.6]), lambda d: abs(d) @ [0.1, 0.2, 0.3]),
    "sphere": (sphere(0.3), lambda d: np.full(len(d), 0.3)),
    "capsule": (capsule(0.1, 0.8), lambda d: 0.1 + 0.4 * abs(d[:, 2])),
}


@pytest.mark.parametrize(("shape", "exact"), SOLIDS.values(), ids=SOLIDS.keys())
def test_box_sphere_and_capsule_are_exact(shape, exact):
    d = directions(500)
    close(support(shape, d), exact(d), atol=1e-14)


def test_a_cylinder_becomes_a_prism_around_it_at_most_one_percent_wider():
    shape, d = cylinder(0.2, 1.0), directions(2000)
    flat = np.hypot(d[:, 0], d[:, 1])
    exact = 0.2 * flat + 0.5 * abs(d[:, 2])
    assert (support(shape, d) >= exact - 1e-14).all()
    assert (support(shape, d) <= exact + 0.2 * 0.0087 * flat).all()


PLACEMENT = placement_of([4.0, 5.0, 6.0], rpy=[1.0, 2.0, 3.0])
POLYTOPES = {
    "box": box([1, 2, 3]),
    "cylinder": cylinder(0.2, 1.0),
    "hull": convex_hull(np.random.default_rng(0).normal(size=(50, 3))),
    "flat": convex_hull(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.0]])),
}


@pytest.mark.parametrize("shape", POLYTOPES.values(), ids=POLYTOPES.keys())
def test_faces_are_turned_outward_and_close_the_surface(shape):
    a, b, c = shape.vertices[shape.faces].transpose(1, 0, 2)
    volume = np.einsum("fi,fi->", a, np.cross(b, c)) / 6
    close(volume, ConvexHull(shape.vertices).volume, rtol=1e-12)
    outward = np.einsum("fi,fi->f", np.cross(b - a, c - a), a - shape.center)
    assert (outward > 0).all()


@pytest.mark.parametrize("shape", [*(case[0] for case in SOLIDS.values()), cylinder(0.2, 1.0)])
def test_the_bounding_sphere_and_the_reach_hold_the_whole_shape(shape):
    d = directions(300, seed=1)
    surface = shape.vertices[(d @ shape.vertices.T).argmax(axis=1)] + shape.radius * d
    point = np.array([0.3, -0.2, 0.5])
    assert np.linalg.norm(surface - shape.center, axis=1).max() <= shape.bounding_radius + 1e-14
    assert np.linalg.norm(surface - point, axis=1).max() <= shape.reach(point) + 1e-14
    farthest = shape.vertices[np.linalg.norm(shape.vertices - point, axis=1).argmax()]
    away = (farthest - point) / np.linalg.norm(farthest - point)
    close(np.linalg.norm(farthest + shape.radius * away - point), shape.reach(point))


def test_a_transformed_shape_is_turned_and_moved_and_keeps_its_radius():
    shape = capsule(0.1, 0.8)
    image, d = shape.transformed(PLACEMENT), directions(200)
    local = d @ PLACEMENT[:3, :3]
    close(support(image, d), support(shape, local) + d @ PLACEMENT[:3, 3])
    assert image.radius == 0.1


def test_a_hull_keeps_corners_only_and_holds_every_point():
    points = np.random.default_rng(2).normal(size=(400, 3))
    hull = convex_hull(points)
    assert len(hull.vertices) < 100
    assert {tuple(vertex) for vertex in hull.vertices} <= {tuple(point) for point in points}
    d = directions(200)
    close(support(hull, d), (d @ points.T).max(axis=1))


def distance_from_hull(point, corners):
    """Return the distance of a point (3,) from the hull of corners [m], by least squares."""
    heavy = 1e6  # weights add up to 1
    rows = np.vstack([corners.T, np.full(len(corners), heavy)])
    weights, _ = nnls(rows, [*point, heavy])
    return np.linalg.norm(weights @ corners / weights.sum() - point)


ROUND = np.random.default_rng(3).normal(size=(150, 3))
ROUND /= np.linalg.norm(ROUND, axis=1, keepdims=True)
MANY_CORNERS = {
    "ball": ConvexShape(ROUND * [0.3, 0.2, 0.05], 0.01),
    "prism": ConvexShape(np.vstack([cylinder(0.06, 0.1).vertices, cylinder(0.04, 0.3).vertices])),
}


@pytest.mark.parametrize("shape", MANY_CORNERS.values(), ids=MANY_CORNERS.keys())
def test_a_thinned_shape_has_few_corners_and_grows_by_no_more_than_it_lacks(shape):
    thinned, d = shape.thinned, directions(2000)
    assert len(thinned.vertices) == MAX_THINNED_CORNERS < len(shape.vertices)
    away = [distance_from_hull(vertex, thinned.vertices) for vertex in shape.vertices]
    close(thinned.radius - shape.radius, max(away), atol=1e-8)
    assert (support(thinned, d) >= support(shape, d)).all()
    moved = replace(shape, known_thinning=shape.thinning).transformed(PLACEMENT)
    assert moved.thinning is shape.thinning
    close(moved.thinned.vertices, shape.thinned.transformed(PLACEMENT).vertices)


@pytest.mark.parametrize("shape", [sphere(0.3), capsule(0.1, 0.8), cylinder(0.2, 1.0)])
def test_a_shape_with_few_corners_is_its_own_thinned_one(shape):
    assert shape.thinned is shape


FLAT = {
    "a rectangle": [[0, 0, 0.5], [1, 0, 0.5], [0, 2, 0.5], [1, 2, 0.5]],
    "a tilted triangle": [[0, 0, 0], [1, 0, 1], [0, 1, 1]],
    "an edge": [[0, 0, 0], [1, 1, 1]],
    "a point": [[0.1, 0.2, 0.3]],
}


@pytest.mark.parametrize("points", FLAT.values(), ids=FLAT.keys())
def test_a_flat_set_becomes_a_thin_solid_that_holds_it(points):
    points = np.array(points, dtype=float)
    hull = convex_hull(points)
    assert ConvexHull(hull.vertices).volume > 0
    assert (Delaunay(hull.vertices).find_simplex(points) >= 0).all()
    low, high = points.min(axis=0), points.max(axis=0)
    close(hull.vertices.min(axis=0), low, atol=2e-6)
    close(hull.vertices.max(axis=0), high, atol=2e-6)


def test_vertices_cannot_be_written_to_and_shapes_are_compared_by_identity():
    shapes = [box([1, 1, 1]), sphere(1), capsule(1, 1), cylinder(1, 1)]
    shapes += [shape.transformed(np.eye(4)) for shape in shapes]
    assert not any(shape.vertices.flags.writeable for shape in shapes)
    assert shapes[0] == shapes[0]
    assert shapes[0] != ConvexShape(shapes[0].vertices, shapes[0].radius)


def plate(azimuth):
    placement = placement_of([0.2, 0, 0], rpy=(0, 0, azimuth))
    return Obstacle.box("plate", [1.0, 0.5, 0.02], placement).shapes[0]


def test_a_turned_plate_has_a_box_as_flat_as_itself_and_distances_are_those_of_the_box():
    close(sorted(bounding_boxes([plate(0.6)]).half[0]), [0.01, 0.25, 0.5], atol=1e-9)
    points = np.array([[0.2, 0, 0.31], [0.2, 0.1, 0], [1, 0, 0]])
    close(bounding_boxes([plate(0)] * 3).distance(np.arange(3), points), [0.3, 0, 0.3])
    assert bounding_boxes([]).axes.shape == (0, 3, 3)


def test_bounds_are_below_the_distances_and_beside_a_plate_closer_than_spheres(bundled):
    checker = bundled("ur5/over_the_wall").collision
    q = np.random.default_rng(5).uniform(-2, 2, (20, checker.robot.joint_count))
    rotation, position = checker.robot.body_poses(q)
    spheres = checker.sphere_distances(rotation, position, checker.pairs)
    row, pair = np.nonzero(np.isfinite(spheres))
    pairs = checker.pairs[pair]
    boxes = checker.box_distances(rotation, position, row, pairs)
    exact = checker.closest_points(rotation[row], position[row], pairs).distance
    assert (boxes <= np.maximum(exact, 0) + 1e-9).all()
    assert (boxes > spheres[row, pair] + 0.1).mean() > 0.1
