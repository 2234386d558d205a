"""Bundled presets are named for the robots that they are for."""

import pytest

from tubeplanner import LimitOverrides, load_robot
from tubeplanner.problem.fitting_presets import fitting_presets


def test_the_panda_has_one_and_other_arms_have_none(panda, ur5):
    assert fitting_presets(panda) == ["fer"]
    assert fitting_presets(ur5) == []
    assert fitting_presets(load_robot("example:xarm7", "link7")) == []  # seven joints as well


def test_the_order_of_the_group_does_not_matter(panda):
    turned = load_robot("example:panda", "panda_hand_tcp", joints=panda.joint_names[::-1])
    assert fitting_presets(turned) == ["fer"]


def test_an_arm_of_which_less_is_planned_has_none():
    names = [f"panda_joint{k}" for k in range(1, 7)]
    assert fitting_presets(load_robot("example:panda", "panda_hand_tcp", joints=names)) == []


@pytest.mark.parametrize(("old", "new"), [("2.175", "2.1"), ("87.0", "80.0")])
def test_another_velocity_or_effort_is_another_arm(panda, tmp_path, old, new):
    text = panda.urdf.path.read_text()
    assert old in text
    (tmp_path / "other.urdf").write_text(text.replace(old, new))
    robot = load_robot(tmp_path / "other.urdf", "panda_hand_tcp")
    assert fitting_presets(robot) == []


def test_a_urdf_that_does_not_say_is_of_no_known_arm(panda, tmp_path):
    text = panda.urdf.path.read_text().replace('effort="87.0" ', "", 1)
    (tmp_path / "other.urdf").write_text(text)
    limits = LimitOverrides(effort={"panda_joint1": 87.0})
    robot = load_robot(tmp_path / "other.urdf", "panda_hand_tcp", limits=limits)
    assert fitting_presets(robot) == []
