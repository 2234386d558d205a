"""What is said of a motor that is too weak."""

import numpy as np
import pytest

from cases import anywhere, one_joint, with_motors
from tubeplanner.constraints.effort_refusal import effort_refusal
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.outcome import PlanStatus


def said(robot, joint=0, sample=0, q=(0.0,)):
    path = np.zeros((3, len(q), robot.joint_count))
    path[0, :, 0] = q
    return effort_refusal(PathSamples(anywhere(robot), path), sample, joint, 7.126, 5.0)


@pytest.mark.parametrize(
    ("motors", "against"),
    [
        ({}, "gravity alone"),
        ({"viscous_friction": 9.0}, "gravity alone"),
        ({"forwards_friction": 1.0}, "gravity and friction"),
        ({"backwards_friction": 1.0}, "gravity and friction"),
    ],
)
def test_friction_is_spoken_of_where_there_is_some(tmp_path, motors, against):
    found = said(with_motors(one_joint(tmp_path), **motors))
    assert found.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    expected = f"joint 'turn' needs 7.13 N m against {against}, its effort limit is 5.00; lighten"
    assert str(found).startswith(expected)


def test_the_place_is_where_the_tool_is(slide):
    """Of the sample that is meant; forces have another unit than moments."""
    found = said(slide, joint=1, sample=1, q=(0.0, np.pi / 2))
    assert "needs 7.13 N against" in str(found)
    np.testing.assert_allclose(found.place.position, [0.0, 0.6, 0.5], atol=1e-9)
    assert found.place.joint == "extend"
