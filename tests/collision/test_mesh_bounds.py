"""Mesh files, and what they name, are regular files of some size."""

import os

import pytest

from tubeplanner.collision.mesh_bounds import files_beside, mesh_bytes
from tubeplanner.collision.mesh_cover import load_mesh
from tubeplanner.documents import DocumentError
from tubeplanner.errors import RobotError
from tubeplanner.views.visual_mesh import read_visual_mesh

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


@pytest.mark.parametrize("kind", ["pipe", "zeros", "huge"])
def test_what_is_no_mesh_file_is_not_opened(tmp_path, kind):
    path = tmp_path / "part.stl"
    put(path, kind)
    reason = "larger than 200 MB" if kind == "huge" else "no regular file"
    for read in (lambda: load_mesh("obstacle 'part'", path), lambda: read_visual_mesh(path)):
        with pytest.raises(RobotError, match=f"mesh .*part.stl cannot be read.*{reason}"):
            read()
    with pytest.raises(DocumentError, match=reason):
        mesh_bytes(path)


@pytest.mark.parametrize("kind", ["pipe", "zeros", "huge"])
def test_nor_is_what_a_mesh_names(tmp_path, kind):
    put(tmp_path / "paint.mtl", kind)
    path = tmp_path / "part.obj"
    path.write_text(OBJ.format("paint.mtl"))
    with pytest.raises(ValueError):
        files_beside(path).get("paint.mtl")
    for read in (lambda: load_mesh("obstacle 'part'", path), lambda: read_visual_mesh(path)):
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
