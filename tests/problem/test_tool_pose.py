"""A pose of the tool: what is one, and how far another is from it."""

import numpy as np
import pytest

from tubeplanner import ProblemError, ToolPose, placement_of
from tubeplanner.orientation import matrix_of_rpy


@pytest.mark.parametrize(
    "placement",
    [
        np.eye(3),
        np.diag([1, 1, -1, 1]),
        np.diag([2, 2, 2, 1]),
        np.diag([1, 1, 1, 2]),
        np.full((4, 4), np.nan),
        placement_of() + np.array([0, 0, 0, 2e4]) * np.array([[1], [0], [0], [0]]),
        "here",
        [[1, 0], [0]],
    ],
)
def test_what_is_no_placement_is_refused(placement):
    with pytest.raises(ProblemError, match="give a rotation and translation"):
        ToolPose(placement)


def test_a_pose_cannot_be_changed_from_outside():
    placement = placement_of([1, 2, 3])
    pose = ToolPose(placement)
    placement[0, 3] = 5
    assert pose.position.tolist() == [1, 2, 3]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, np.pi - 1e-9, np.pi])
def test_errors_are_the_distance_and_the_angle_of_the_turn_between(angle):
    pose = ToolPose(placement_of([1, 2, 3], rpy=[0.3, -0.5, 1.1]))
    turned = pose.rotation @ matrix_of_rpy(0, angle, 0)
    away, turn = pose.errors(turned, pose.position + np.array([0.3, 0, 0.4]))
    assert away == pytest.approx(0.5)
    assert turn == pytest.approx(angle, abs=1e-15)
