"""The picture of an arm: names of frames, apart from each other, and all that is drawn inside."""

import numpy as np
import pytest

from tubeplanner.robot.robot_info import robot_info
from tubeplanner.robot.typical_configurations import typical_configurations
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
