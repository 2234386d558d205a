"""Mesh files: size bounds, units, first covers, solids, all cached."""

import os
import struct

import numpy as np
import pytest
import trimesh
from cases import refusal

from tubeplanner import Obstacle, ProblemError, placement_of
from tubeplanner.errors import RobotError
from tubeplanner.geometry.meshes import MeshFile, files_beside, load_mesh
from tubeplanner.output.link_visuals import read_visual_mesh

OBJ = (
    "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl a\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
)


def put(path, kind):
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "zeros":
        path.symlink_to("/dev/zero")
    else:
        path.touch()
        os.truncate(path, 300_000_000)


def readers(path):
    """Yield the readers of a mesh, for shapes and for pictures."""
    yield lambda: load_mesh("obstacle 'part'", path)
    yield lambda: read_visual_mesh(path)


@pytest.mark.parametrize("kind", ["pipe", "zeros", "huge"])
def test_what_is_no_mesh_file_is_not_opened(tmp_path, kind):
    path = tmp_path / "part.stl"
    put(path, kind)
    reason = "larger than 200 MB" if kind == "huge" else "no regular file"
    for read in readers(path):
        message = refusal(RobotError, read)
        assert "part.stl cannot be read" in message
        assert reason in message
    assert MeshFile("part", path).key is None


@pytest.mark.parametrize("kind", ["pipe", "huge"])
def test_nor_is_what_a_mesh_names(tmp_path, kind):
    put(tmp_path / "paint.mtl", kind)
    path = tmp_path / "part.obj"
    path.write_text(OBJ.format("paint.mtl"))
    with pytest.raises(ValueError):
        files_beside(path).get("paint.mtl")
    for read in readers(path):
        try:
            assert read()
        except RobotError as error:
            assert "part.obj" in str(error)


def test_colours_beside_a_mesh_are_read(tmp_path):
    (tmp_path / "paint.mtl").write_text("newmtl a\nKd 1 0 0\n")
    path = tmp_path / "part.obj"
    path.write_text(OBJ.format("paint.mtl"))
    [(color, _)] = read_visual_mesh(path)
    assert color == (1.0, 0.0, 0.0)


GOOD = [[[0, 0, 0], [1, 0, 0], [0, 0, 1]]]


def stl(*triangles):
    """Return a binary STL of triangles (3, 3)."""
    data = b"\0" * 80 + struct.pack("<I", len(triangles))
    for triangle in triangles:
        points = np.asarray(triangle, dtype="<f4")
        data += np.zeros(3, "<f4").tobytes() + points.tobytes() + b"\0\0"
    return data


PLY = b"""ply\nformat ascii 1.0\nelement vertex 4
property float x\nproperty float y\nproperty float z
element face 2\nproperty list uchar int vertex_index\nend_header
0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 1 99\n"""
FACES = b"element face 2\nproperty list uchar int vertex_index\n"
CLOUD = PLY.replace(FACES, b"").removesuffix(b"3 0 1 2\n3 0 1 99\n")
REFUSED = {
    "infinite.stl": (stl([[0, 0, 0], [np.inf, 0, 0], [0, 1, 0]], *GOOD), "that are not finite"),
    "empty.stl": (stl(), "has no triangles; points alone, as of a scan, are no solid"),
    "cloud.ply": (CLOUD, "has no triangles; points alone, as of a scan, are no solid"),
    "huge.stl": (stl([[0, 0, 0], [1e38, 0, 0], [0, 1, 0]]), r"reaches 1e\+38 m from its origin"),
    "out_of_range.ply": (PLY, "has a triangle of vertex 99; it has 4 vertices"),
    "flat.obj": (b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", "has points of 2 coordinates; a solid has 3"),
    "malformed.dae": (b"<COLLADA><asset>", "is no readable DAE file"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_solid_is_refused_by_name(tmp_path, name):
    data, message = REFUSED[name]
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(RobotError, match=message) as caught:
        Obstacle.mesh("part", path, placement_of())
    assert str(caught.value).startswith(f"obstacle 'part': mesh {path} ")
    assert "export it again" in str(caught.value)


def test_a_format_that_takes_another_package_names_the_extra(tmp_path, monkeypatch):
    path = tmp_path / "part.3mf"
    path.write_bytes(trimesh.creation.box().export(file_type="3mf"))
    assert len(load_mesh("obstacle 'part'", path).faces) == 12

    def load(*_, **options):
        raise ModuleNotFoundError("No module named 'networkx'")

    monkeypatch.setattr(trimesh, "load", load)
    with pytest.raises(RobotError, match=r"reading 3MF takes .*\[meshes\].* or export .* as STL$"):
        load_mesh("obstacle 'part'", path)


def test_a_scale_that_leads_too_far_is_refused(tmp_path):
    path = tmp_path / "part.stl"
    path.write_bytes(stl([[0, 0, 0], [10, 0, 0], [0, 1, 0]], *GOOD))
    with pytest.raises(RobotError, match=r"reaches 1e\+05 m from its origin"):
        load_mesh("link 'a'", path, [1e4, 1.0, 1.0])
    for scale, values in (("a", "'a'"), (0.0, "0")):
        message = refusal(ProblemError, Obstacle.mesh, "part", path, placement_of(), scale)
        assert message.startswith(f"obstacle 'part': scale {values}; 1e-06 to 10000 are accepted")


@pytest.mark.parametrize("triangle", [[[0, 0, 0], [1, 0, 0], [0, 1, 1e-9]], [[1, 1, 1]] * 3])
def test_what_is_flat_becomes_a_thin_solid(tmp_path, triangle):
    path = tmp_path / "flat.stl"
    path.write_bytes(stl(triangle))
    points = np.vstack([each.vertices for each in Obstacle.mesh("p", path, placement_of()).shapes])
    assert (points.min(axis=0) <= np.min(triangle, axis=0)).all()
    assert (points.max(axis=0) >= np.max(triangle, axis=0)).all()


def test_equal_triangles_count_once_and_the_two_sides_of_a_sheet_are_two(tmp_path):
    rolled, back = np.roll(GOOD, 1, axis=1), [GOOD[0][::-1]]
    meshes = []
    for triangles in (GOOD, [*GOOD, *rolled, *GOOD], [*GOOD, *back]):
        (tmp_path / "part.stl").write_bytes(stl(*triangles))
        meshes.append(load_mesh("m", tmp_path / "part.stl"))
    once, often, sheet = meshes
    assert [len(mesh.faces) for mesh in meshes] == [1, 1, 2]
    assert (often.triangles == once.triangles).all()
    assert (sheet.triangles[0] == once.triangles[0]).all()
