"""Link meshes as they are drawn: few triangles, sharp edges."""

import struct

import numpy as np
import pytest

from tubeplanner import Obstacle, RobotError, placement_of
from tubeplanner.views.surface import grid_surface, shape_surface
from tubeplanner.views.visual_mesh import read_visual_mesh, simplified


def area(surface):
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_a_mesh_has_as_few_triangles_as_asked_for():
    turn = np.linspace(0, 2 * np.pi, 120)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    grid = np.stack([np.column_stack([ring, np.full(120, z)]) for z in np.linspace(0, 2, 60)], 1)
    round_wall = grid_surface(grid)
    (fewer,) = simplified([round_wall], 3000)
    assert 500 < len(fewer.faces) <= 3000
    assert area(fewer) == pytest.approx(area(round_wall), rel=0.06)


def test_edges_stay_sharp_and_round_parts_smooth():
    box = shape_surface(Obstacle.box("box", [1, 1, 1], np.eye(4)).shapes[0])
    ball = shape_surface(Obstacle.sphere("ball", 1, np.eye(4)).shapes[0])
    sharp, smooth = simplified([box, ball], 1000)
    assert len(sharp.vertices) == 24
    assert len(smooth.vertices) == len(ball.vertices)


def test_a_mesh_that_is_none_is_refused_by_name(tmp_path):
    path = tmp_path / "broken.dae"
    path.write_text("nothing")
    with pytest.raises(RobotError, match=r"broken\.dae cannot be read"):
        read_visual_mesh(path)


@pytest.mark.parametrize(
    "content", [b"\0\0", b"<a\0", b"", b"<COLLADA", "<?xml?>".encode("utf-16")]
)
def test_the_reason_is_on_one_line(tmp_path, content):
    path = tmp_path / "broken.dae"
    path.write_bytes(content)
    with pytest.raises(RobotError, match=r"broken\.dae cannot be read") as caught:
        read_visual_mesh(path)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("size", [1e38, np.inf, np.nan])
def test_numbers_that_make_no_sense_are_refused_as_a_solid_and_nothing_warns(tmp_path, size):
    corners = np.vstack([np.zeros(3), np.diag([size] * 3)])
    triangles = [corners[list(rows)] for rows in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))]
    rows = [struct.pack("<12fH", 0, 0, 1, *triangle.ravel(), 0) for triangle in triangles]
    path = tmp_path / "solid.stl"
    path.write_bytes(b" " * 80 + struct.pack("<I", 4) + b"".join(rows))
    with pytest.raises(RobotError, match=r"solid\.stl"):
        Obstacle.mesh("part", path, placement_of())
    try:
        read_visual_mesh(path)
    except RobotError as error:
        assert not np.isfinite(size), error
