"""The picture of an arm: names of frames, apart from each other, and all that is drawn inside."""

import numpy as np
import pytest

from tubeplanner import BasePose, load_robot
from tubeplanner.robot.robot_info import robot_info
from tubeplanner.robot.typical_configurations import typical_configurations
from tubeplanner.views.link_visuals import link_parts
from tubeplanner.views.robot_plot import plot_robot


@pytest.mark.parametrize("name", ["two_link", "ur5"])
def test_frames_are_named_apart_and_inside(name):
    arm = robot_info(f"example:{name}").arm
    figure = plot_robot(arm, typical_configurations(arm)[0])
    (axis,) = figure.axes
    texts = axis.texts
    named = ", ".join(text.get_text() for text in texts)
    for joint in arm.joint_names:
        assert arm.urdf.joints[joint].child in named
    assert arm.tool_frame in named
    boxes = [text.get_window_extent() for text in texts]
    width, height = figure.get_size_inches() * figure.dpi
    for k, box in enumerate(boxes):
        assert box.x0 >= 0 and box.x1 <= width
        assert box.y0 >= 0 and box.y1 <= height
        assert not any(box.overlaps(other) for other in boxes[k + 1 :])


def test_everything_drawn_is_inside_the_axes():
    arm = robot_info("example:two_link").arm
    q = np.array([0.3, 0.5])
    (axis,) = plot_robot(arm, q).axes
    tool = arm.tool_position(q)
    for value, (low, high) in zip(
        tool, (axis.get_xlim(), axis.get_ylim(), axis.get_zlim()), strict=True
    ):
        assert low <= value <= high
    lines = [line.get_data_3d() for line in axis.lines]
    assert any(np.allclose(np.array(line)[:, -1], tool, atol=1e-9) for line in lines)


def test_an_arm_is_drawn_where_it_stands():
    pose = BasePose((0.3, -0.2, 1.1), (0.4, -1.2, 2.5))
    far = np.array([2.0, 3.0, 5.0])
    places = {None: far, pose: pose.placement[:3, :3] @ far + pose.placement[:3, 3]}
    away = []
    for base, seen_from in places.items():
        arm = load_robot("example:ur5", "tool0", base=base)
        rotation, position = arm.body_poses(np.full(6, 0.4))
        parts, _ = link_parts(arm, 10**9)
        at = [p.surface.vertices @ rotation[p.body].T + position[p.body] for p in parts]
        seen = [np.linalg.norm(each - seen_from, axis=1) for each in at]
        away.append([(each.min(), each.max()) for each in seen])
        assert any(part.link == "base_link" for part in parts)
    np.testing.assert_allclose(away[1], away[0], rtol=0, atol=2e-3)  # meshes are simplified
