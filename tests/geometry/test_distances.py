"""Separating directions of two convex shapes; depth of an overlap, by Coal."""

import numpy as np
import pytest
from numpy.testing import assert_allclose as close
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from tubeplanner.geometry.convex_shapes import box, capsule, convex_hull, sphere
from tubeplanner.geometry.distances import PlacedShapes, separating_directions


def shortest(first, second):
    """Return the distance of two hulls: that of the origin from the hull of all differences."""
    differences = (second[:, None] - first).reshape(-1, 3)
    weights, _ = nnls(np.vstack([differences.T, np.ones(len(differences))]), [0, 0, 0, 1])
    return np.linalg.norm(weights @ differences) / weights.sum()


@pytest.fixture(scope="module")
def hulls():
    rng = np.random.default_rng(8)
    first, second = rng.uniform(-0.2, 0.2, (2, 8, 3))
    rotation = Rotation.random(12, random_state=9).as_matrix()
    origin = rng.normal(size=(12, 3))
    origin *= rng.uniform(0.5, 1.0, (12, 1)) / np.linalg.norm(origin, axis=1, keepdims=True)
    return first, second, rotation, origin


def test_distances_are_those_of_least_squares(hulls):
    first, second, rotation, origin = hulls
    placed = np.einsum("nij,vj->nvi", rotation, first) + origin[:, None]
    gap = second[0] - placed[:, 0]
    distance, direction = separating_directions(
        first, second, rotation, origin, gap, max_steps=3000, loose=1e-5
    )
    exact = np.array([shortest(points, second) for points in placed])
    assert (exact > 0.01).sum() > 8
    apart = exact > 0.01
    assert distance[apart] == pytest.approx(exact[apart], abs=2e-5)
    along = np.einsum("vi,ni->nv", second, direction).min(axis=1)
    along -= np.einsum("nvi,ni->nv", placed, direction).max(axis=1)
    close(along[apart], distance[apart], atol=1e-12)


def test_what_has_enough_is_no_longer_looked_at(hulls):
    first, second, rotation, origin = hulls
    gap = second[0] - np.einsum("nij,j->ni", rotation, first[0]) - origin
    arguments = (first, second, rotation, origin, gap)
    once, _ = separating_directions(*arguments, max_steps=1)
    again, _ = separating_directions(*arguments, max_steps=50, enough=0.0)
    assert (once >= 0).any()
    assert (again[once >= 0] == once[once >= 0]).all()
    assert (again >= once).all()


TABLE = (0.9, 1.6, 0.04)
PART = (0.06, 0.06, 0.1)


def separation(first, second, rotation, position):
    """Return the closest points of two shapes, the second moved."""
    rotations = np.array([np.eye(3), rotation])[None]
    placed = np.array([np.zeros(3), position])[None]
    return PlacedShapes([first, second]).separations(np.array([[0, 1]]), rotations, placed)


def on_the_table(gap, tilt, turn=0.3, part=None):
    """Return a pose of the part that leaves a gap between its lowest corner and the table."""
    rotation = Rotation.from_euler("zxy", [turn, tilt, -tilt]).as_matrix()
    lowest = ((part or box(PART)).vertices @ rotation.T)[:, 2].min()
    return rotation, np.array([0.1, -0.2, TABLE[2] / 2 - lowest + gap])


@pytest.mark.parametrize("tilt", [0.0, 1e-9, 3e-6, 0.05])
@pytest.mark.parametrize("gap", [0.0, -1e-9, -1e-6, -1e-3])
def test_a_part_on_a_table_is_as_deep_as_its_lowest_corner(gap, tilt):
    """FCL ends the process on some of these, and its direction is off on most."""
    result = separation(box(TABLE), box(PART), *on_the_table(gap, tilt))
    assert gap - 5e-7 <= result.distance[0] <= gap + 1e-12
    close(result.direction[0], [0, 0, 1], atol=1e-5)


def test_no_pose_of_solids_that_touch_ends_the_process():
    rng = np.random.default_rng(2)
    for _ in range(100):
        rotation, position = on_the_table(
            rng.choice([0, 1e-7, -1e-7, -2e-6]), rng.choice([0, 1e-6, 2e-6]), rng.uniform(-3, 3)
        )
        position[:2] = rng.uniform(-0.3, 0.3, 2)
        result = separation(box(PART), box(TABLE), rotation.T, -rotation.T @ position)
        assert abs(result.distance[0]) < 3e-6


def test_crossed_edges_are_as_deep_as_the_edges():
    """The direction is across both edges, no normal of a face."""
    diagonal = np.sqrt(2) * 0.05
    lower = convex_hull(
        box((0.1, 1.0, 0.1)).vertices @ Rotation.from_euler("y", 45, True).as_matrix().T
    )
    upper = Rotation.from_euler("x", 45, True).as_matrix()
    depth = 0.01
    result = separation(lower, box((1.0, 0.1, 0.1)), upper, [0, 0, 2 * diagonal - depth])
    assert result.distance[0] == pytest.approx(-depth, abs=1e-6)
    close(result.direction[0], [0, 0, 1], atol=1e-4)
    close(result.second[0] - result.first[0], [0, 0, -depth], atol=1e-5)


@pytest.mark.parametrize("shape", [sphere(0.02), capsule(0.02, 0.1)], ids=["ball", "capsule"])
@pytest.mark.parametrize("deep", [0.0, 0.005])
def test_balls_and_capsules_whose_centre_is_inside(shape, deep):
    rotation = Rotation.from_euler("x", 90, True).as_matrix()
    result = separation(box(TABLE), shape, rotation, [0.1, 0.2, TABLE[2] / 2 - deep])
    assert result.distance[0] == pytest.approx(-deep - 0.02, abs=2e-9)


def test_the_points_lie_on_the_faces_across_from_each_other():
    rotation, position = on_the_table(-0.003, 0.05)
    result = separation(box(TABLE), box(PART), rotation, position)
    close(result.first[0][2], TABLE[2] / 2, atol=1e-8)
    corners = box(PART).vertices @ rotation.T + position
    close(result.second[0], corners[corners[:, 2].argmin()], atol=1e-5)
    close(result.first[0][:2], result.second[0][:2], atol=1e-5)


@pytest.mark.parametrize("gap", [0.0, -1e-6])
def test_an_edge_on_a_face_that_no_other_is_parallel_to(gap):
    """The normal of the second shape's face alone is exact."""
    corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0.2, 0.1, -1]]
    wedge = convex_hull(np.array(corners, dtype=float))
    rotation = Rotation.from_euler("y", 45, True).as_matrix()
    height = np.sqrt(2) * 0.05 + gap
    result = separation(box((0.1, 0.8, 0.1)), wedge, rotation.T, rotation.T @ [0, 0, -height])
    assert gap - 1e-9 <= result.distance[0] <= gap + 1e-12
    close(rotation @ result.direction[0], [0, 0, -1], atol=1e-9)


def test_a_disc_of_many_corners_is_as_deep_as_it_is():
    """Its faces' triangles all meet at one corner; Coal takes at most 255 of them."""
    corners = 300
    angle = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    rim = np.column_stack([0.1 * np.cos(angle), 0.1 * np.sin(angle)])
    disc = convex_hull(np.vstack([np.c_[rim, np.full(corners, z)] for z in (-0.02, 0.02)]))
    assert np.bincount(disc.faces.ravel()).max() > corners / 2
    for tilt, accuracy in ((0.0, 1e-9), (0.4, 1e-6)):
        result = separation(box(TABLE), disc, *on_the_table(-0.003, tilt, part=disc))
        assert result.distance[0] == pytest.approx(-0.003, abs=accuracy)
        close(result.direction[0], [0, 0, 1], atol=1e-5)


@pytest.mark.parametrize("counts", [(300, 12), (20, 150)])
def test_an_overlap_is_no_deeper_than_any_normal_of_both_shapes_says(counts):
    rng = np.random.default_rng(4)
    for _ in range(25):
        points = [rng.normal(size=(count, 3)) * rng.uniform(0.05, 0.3, 3) for count in counts]
        first, second = (convex_hull(each / np.linalg.norm(each)) for each in points)
        rotation = Rotation.random(random_state=rng.integers(1000)).as_matrix()
        position = rng.uniform(-0.02, 0.02, 3)
        placed = second.vertices @ rotation.T + position
        normals = np.vstack([first.normals, -second.normals @ rotation.T])
        gaps = (placed @ normals.T).min(axis=0) - (first.vertices @ normals.T).max(axis=0)
        result = separation(first, second, rotation, position)
        assert gaps.max() - 1e-12 <= result.distance[0] < 0
        along = (placed @ result.direction[0]).min() - (first.vertices @ result.direction[0]).max()
        close(along, result.distance[0], atol=1e-12)
