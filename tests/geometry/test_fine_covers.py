"""Closer covers: nothing of a mesh lies outside, hollows are free."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from arms import OPENED, opened
from cases import outside

from tubeplanner.geometry.fine_covers import OUTER_ERROR, cover_error, fine_cover
from tubeplanner.geometry.mesh_solids import MeshSolid
from tubeplanner.geometry.meshes import MeshFile

CASES = Path(__file__).parents[1] / "data/cases"


def solid_of(mesh):
    return MeshSolid(np.asarray(mesh.vertices), np.asarray(mesh.faces))


MESHES = {
    "U": lambda: trimesh.load(CASES / "mesh_U.obj"),
    "torus": lambda: trimesh.creation.torus(0.1, 0.03, major_sections=12, minor_sections=6),
    "two balls": lambda: trimesh.util.concatenate(
        [
            trimesh.creation.icosphere(1, 0.05),
            trimesh.creation.icosphere(1, 0.05).apply_translation([0.2, 0.1, 0]),
        ]
    ),
}


@pytest.mark.parametrize("name", MESHES)
def test_nothing_of_a_mesh_lies_outside_and_little_else_inside(name):
    mesh = MESHES[name]()
    solid = solid_of(mesh)
    cover = fine_cover(solid)
    surface = trimesh.sample.sample_surface(mesh, 1000, seed=1)[0]
    assert outside(cover.shapes, np.vstack([mesh.vertices, surface])).max() < 1e-9
    box = np.random.default_rng(2).uniform(*mesh.bounds, (1000, 3))
    inside = solid.contains(box)
    assert outside(cover.shapes, box[inside]).max() < 1e-9
    standing_off = solid.distance(box[~inside & (outside(cover.shapes, box) < 0)])
    stated = max(cover.outer_error, OUTER_ERROR)
    assert standing_off.max(initial=0) < 1.5 * stated
    assert cover_error(solid, cover.shapes) < 1.5 * stated
    if name in ("U", "two balls"):
        assert cover.outer_error <= OUTER_ERROR


@pytest.mark.parametrize("kind", OPENED)
def test_what_a_closed_mesh_covers_its_open_twin_covers(tmp_path, kind):
    mesh = MESHES["U"]()
    box = np.random.default_rng(2).uniform(*mesh.bounds, (1000, 3))
    inside = solid_of(mesh).contains(box)
    twin = MeshFile("twin", opened(mesh, kind, tmp_path / "twin.stl"))
    for solids in (twin.cover(), twin.close_cover()):
        assert outside(solids, box[inside]).max() < 1e-6


def test_the_inside_of_a_thick_solid_is_covered_where_no_surface_is():
    block = trimesh.creation.box([0.4, 0.4, 0.4])
    solid = solid_of(block)
    cuts = [(axis, height) for axis in range(3) for height in (-0.1, 0.1)]
    cover = fine_cover(solid, cuts=cuts)
    points = np.random.default_rng(3).uniform(-0.2, 0.2, (3000, 3))
    # The cell in the middle has no surface at all: its neighbours' hulls do not reach it.
    assert (abs(points) < 0.1).all(axis=1).any()
    assert outside(cover.shapes, points).max() < 1e-9


def test_pieces_between_cuts_across_one_axis_end_at_both():
    """Else their sides count as surface, and they are cut again and again in vain."""
    solid = solid_of(MESHES["U"]())
    cover = fine_cover(solid, cuts=[(0, 0.075), (0, 0.15), (0, 0.225)])
    assert len(cover.shapes) == 6
    assert cover.outer_error < 1e-6


def test_a_notch_is_where_a_piece_is_cut():
    """A block with a slanted notch that no common coordinate and no middle meets."""
    outline = [(0, 0), (0.3, 0), (0.3, 0.2), (0.131, 0.2), (0.113, 0.047), (0.083, 0.2), (0, 0.2)]
    vertices = np.array([(x, y, z) for z in (0.0, 0.1) for x, y in outline])
    top = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (4, 5, 6), (4, 6, 0)]) + 7
    ends = [(k, (k + 1) % 7) for k in range(7)]
    sides = [face for i, j in ends for face in ((i, j, j + 7), (i, j + 7, i + 7))]
    solid = MeshSolid(vertices, np.vstack([top, top[:, ::-1] - 7, sides]))
    cover = fine_cover(solid, max_pieces=4)
    assert cover.outer_error < OUTER_ERROR


def test_only_pieces_that_something_comes_near_are_cut_and_their_number_is_limited():
    solid = solid_of(MESHES["torus"]())
    far, middle = np.array([[0.5, 0.5, 0.5]]), np.zeros((1, 3))
    assert len(fine_cover(solid, far).shapes) == 1
    cover = fine_cover(solid, middle)
    assert 1 < len(cover.shapes) < len(fine_cover(solid).shapes)
    assert outside(cover.shapes, middle)[0] > 0
    assert len(fine_cover(solid, max_pieces=5).shapes) == 5
