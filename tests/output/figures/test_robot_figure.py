"""The picture of an arm: frames named apart, all inside; meshes of links: few triangles."""

import struct

import numpy as np
import pytest

from tubeplanner import BasePose, Obstacle, RobotError, load_robot, placement_of
from tubeplanner.output.drawing import grid_surface, shape_surface
from tubeplanner.output.figures.robot_figure import plot_robot
from tubeplanner.output.link_visuals import link_parts, read_visual_mesh, simplified
from tubeplanner.robot.info import robot_info
from tubeplanner.studies.tubes.starter_problem import typical_configurations


def test_frames_are_named_apart_and_all_is_inside():
    arm = robot_info("example:ur5").arm
    q = typical_configurations(arm)[0]
    figure = plot_robot(arm, q)
    (axis,) = figure.axes
    texts = axis.texts
    named = ", ".join(text.get_text() for text in texts)
    for name in (arm.tool_frame, *(arm.urdf.joints[joint].child for joint in arm.joint_names)):
        assert name in named
    boxes = [text.get_window_extent() for text in texts]
    width, height = figure.get_size_inches() * figure.dpi
    for k, box in enumerate(boxes):
        assert box.x0 >= 0 and box.x1 <= width
        assert box.y0 >= 0 and box.y1 <= height
        assert not any(box.overlaps(other) for other in boxes[k + 1 :])
    lines = [line.get_data_3d() for line in axis.lines]
    assert any(np.allclose(np.array(line)[:, -1], arm.tool_position(q)) for line in lines)


def test_an_arm_is_drawn_where_it_stands():
    pose = BasePose((0.3, -0.2, 1.1), (0.4, -1.2, 2.5))
    far = np.array([2.0, 3.0, 5.0])
    locations = {None: far, pose: pose.placement[:3, :3] @ far + pose.placement[:3, 3]}
    away = []
    for base, seen_from in locations.items():
        arm = load_robot("example:two_link", "hand", base=base)
        rotation, position = arm.body_poses(np.full(2, 0.4))
        parts, _ = link_parts(arm, 10**9)
        at = [p.surface.vertices @ rotation[p.body].T + position[p.body] for p in parts]
        seen = [np.linalg.norm(each - seen_from, axis=1) for each in at]
        away.append([(each.min(), each.max()) for each in seen])
        assert any(part.link == "base" for part in parts)
    np.testing.assert_allclose(away[1], away[0], rtol=0, atol=2e-3)  # meshes are simplified


def test_a_mesh_has_as_few_triangles_as_asked_for():
    turn = np.linspace(0, 2 * np.pi, 120)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    grid = np.stack([np.column_stack([ring, np.full(120, z)]) for z in np.linspace(0, 2, 60)], 1)
    (fewer,) = simplified([grid_surface(grid)], 3000)
    assert 500 < len(fewer.faces) <= 3000
    a, b, c = fewer.vertices[fewer.faces].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(4 * np.pi, rel=0.06)


def test_edges_stay_sharp_and_round_parts_smooth():
    box = shape_surface(Obstacle.box("box", [1, 1, 1], np.eye(4)).shapes[0])
    ball = shape_surface(Obstacle.sphere("ball", 1, np.eye(4)).shapes[0])
    sharp, smooth = simplified([box, ball], 1000)
    assert len(sharp.vertices) == 24
    assert len(smooth.vertices) == len(ball.vertices)


@pytest.mark.parametrize("content", [b"nothing", b"", b"<COLLADA", "<?xml?>".encode("utf-16")])
def test_a_mesh_that_is_none_is_refused_by_name_on_one_line(tmp_path, content):
    path = tmp_path / "broken.dae"
    path.write_bytes(content)
    with pytest.raises(RobotError, match=r"broken\.dae cannot be read") as caught:
        read_visual_mesh(path)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("size", [1e38, np.nan])
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


def test_a_cell_is_drawn_around_the_arm():
    arm = load_robot("example:two_link", "hand")
    wall = Obstacle.box("wall", [0.1, 0.4, 0.2], placement_of([1.5, 0, 0]))
    (axis,) = plot_robot(arm, np.full(2, 0.4), None, [wall]).axes
    assert axis.get_xlim()[1] == pytest.approx(1.55)
