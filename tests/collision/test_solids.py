"""Obstacle and AttachedSolid: placement, contents, hand-over between cell and tool."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from tubeplanner import (
    AttachedSolid,
    Obstacle,
    ProblemError,
    RobotError,
    parse_problem,
    placement_of,
)
from tubeplanner.collision.handed_over import left, taken
from tubeplanner.resources import bundled_folder

PART = bundled_folder() / "ur5" / "part.stl"


def covered(obstacle, points):
    """Return whether points (N, 3) lie in the union of an obstacle's shapes."""
    inside = np.zeros(len(points), dtype=bool)
    for shape in obstacle.shapes:
        hull = trimesh.Trimesh(shape.vertices, shape.faces)
        normals, origins = hull.face_normals, hull.triangles[:, 0]
        height = np.einsum("nfi,fi->nf", points[:, None] - origins, normals)
        inside |= (height <= 1e-9).all(axis=1)
    return inside


def test_a_mesh_is_covered_scaled_and_placed():
    placement = placement_of([0.1, 0.2, 0.3], rpy=[0.4, 0.5, 0.6])
    obstacle = Obstacle.mesh("part", PART, placement, scale=2.0)
    mesh = trimesh.load(str(PART), force="mesh")
    mesh.apply_scale(2.0)
    mesh.apply_transform(placement)
    surface, _ = trimesh.sample.sample_surface(mesh, 500, seed=1)
    assert covered(obstacle, np.array(surface)).all()
    points = np.vstack([shape.vertices for shape in obstacle.shapes])
    np.testing.assert_allclose(points.min(axis=0), mesh.bounds[0], atol=1e-9)
    np.testing.assert_allclose(points.max(axis=0), mesh.bounds[1], atol=1e-9)


def test_a_long_bent_mesh_gets_several_shapes(tmp_path):
    """A banana of spheres: one hull would fill its bend."""
    angles = np.linspace(0, np.pi / 2, 5)
    balls = [
        trimesh.creation.icosphere(1, radius=0.03).apply_translation([np.cos(a), np.sin(a), 0])
        for a in angles
    ]
    path = tmp_path / "banana.obj"
    trimesh.util.concatenate(balls).export(path)
    obstacle = Obstacle.mesh("banana", path, np.eye(4))
    assert len(obstacle.shapes) > 1
    assert not covered(obstacle, np.array([[0.6, 0.6, 0.0]]))[0]


@pytest.mark.parametrize(
    ("text", "scale", "error", "message"),
    [
        ("solid nothing", 1.0, RobotError, r"obstacle 'part': mesh .*bad\.stl"),
        (None, 0.0, ProblemError, "obstacle 'part': scale 0; 1e-06 to 10000 are accepted"),
    ],
)
def test_a_mesh_that_cannot_be_used_is_named(tmp_path, text, scale, error, message):
    path = PART
    if text is not None:
        path = tmp_path / "bad.stl"
        path.write_text(text)
    with pytest.raises(error, match=message):
        Obstacle.mesh("part", path, np.eye(4), scale)


def test_a_problem_finds_its_mesh_beside_its_file():
    fields = {
        "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
        "tube": {"points": [[0.3, -0.3, 0], [0.3, 0.3, 0]], "radius": 0.03},
        "start": {"seed": [0, -1]},
        "obstacles": [{"name": "part", "mesh": "part.stl", "position": [1, 1, 0]}],
    }
    problem = parse_problem(fields, PART.parent)
    assert problem.obstacles[0].shapes
    message = r"obstacles: 'part': mesh .*part\.stl, named in .*, does not exist"
    with pytest.raises(ProblemError, match=message):
        parse_problem(fields, PART.parent.parent)


def test_the_unit_of_a_collada_file_counts(tmp_path):
    """The same box, once in metres and once in millimetres."""
    path = tmp_path / "box.dae"
    text = trimesh.exchange.dae.export_collada(trimesh.creation.box((1.0, 2.0, 3.0)))
    text = text.decode() if isinstance(text, bytes) else text
    assert "<unit" not in text
    sizes = []
    for meter in ("1.0", "0.001"):
        path.write_text(text.replace("</asset>", f'<unit name="u" meter="{meter}"/></asset>'))
        vertices = np.vstack([s.vertices for s in Obstacle.mesh("b", path, np.eye(4)).shapes])
        sizes.append(np.ptp(vertices, axis=0))
    np.testing.assert_allclose(sizes[0], [1, 2, 3])
    np.testing.assert_allclose(sizes[1], [1e-3, 2e-3, 3e-3])


@pytest.mark.parametrize("name", [5, "", "a\nFAKE: passes", "x" * 300])
def test_an_obstacle_needs_a_name_that_can_be_shown(name):
    with pytest.raises(ProblemError, match="the name of an obstacle is"):
        Obstacle.box(name, [1, 1, 1], placement_of())
    with pytest.raises(ProblemError, match="the name of an obstacle is"):
        AttachedSolid(name, ())


@pytest.mark.parametrize(
    ("placement", "message"),
    [
        (np.zeros((4, 4)), "is no rotation and translation"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "is no rotation and translation"),
        (np.eye(4) + np.diag([1.0], -3), "is no rotation and translation"),
        (np.eye(3), "must be finite numbers of shape"),
        (np.full((4, 4), np.nan), "must be finite numbers of shape"),
        (np.eye(4) * 1j, "must be finite numbers of shape"),
        ("a", "must be finite numbers of shape"),
        (np.eye(4) + np.diag([1e9], 3), "position .* must be within 10000 m"),
    ],
)
def test_a_placement_is_a_rotation_and_a_translation(placement, message):
    with pytest.raises(ProblemError, match=f"obstacle 'part': .*{message}"):
        Obstacle.sphere("part", 0.1, placement)


@pytest.mark.parametrize("size", ["ab", 1.0, [1, 1, "a"], [1, 1, True], [1, 1, np.nan]])
def test_a_size_is_of_numbers(size):
    with pytest.raises(ProblemError, match="obstacle 'part': box "):
        Obstacle.box("part", size, placement_of())


# Solids that change hands: where they stand, by hand and against their shapes.


MESH = Path(__file__).parents[1] / "data/cases" / "mesh_U.obj"
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
def test_what_is_let_go_where_it_was_taken_stands_as_before_and_pictures_show_it_there(kind):
    solid = KINDS[kind]
    moved = taken(solid, TILTED)
    expected = np.linalg.inv(TILTED) @ solid.contents.placement
    np.testing.assert_allclose(moved.contents.placement, expected, atol=1e-12)
    same = solid.contents
    assert (moved.contents.kind, moved.contents.sizes) == (same.kind, same.sizes)
    back = left(moved, TILTED)
    np.testing.assert_allclose(corners(back), corners(solid), atol=1e-12)
    np.testing.assert_allclose(back.contents.placement, same.placement, atol=1e-12)
