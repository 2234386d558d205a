"""A note on jerk where nothing limits it."""

import numpy as np
import pytest

from cases import one_joint
from tubeplanner import JointTrajectory, LimitOverrides, load_robot
from tubeplanner.planning.jerk_note import jerk_note, largest_jerk

NAMES = ("joint1", "joint2")


def cubic(names, *jerks):
    """Return two pieces; jerks of the joints in the first, half of them in the second."""
    coefficients = np.zeros((4, 2, len(names)))
    coefficients[0] = np.array([jerks, np.array(jerks) / 2]) / 6
    return JointTrajectory(names, [0.0, 0.1, 0.2], coefficients)


def two_link(**limits):
    return load_robot("example:two_link", "hand", limits=LimitOverrides(**limits))


def test_it_names_the_joint_whose_jerk_is_largest_and_the_knots():
    (note,) = jerk_note(two_link(), cubic(NAMES, 1234.0, -56789.0))
    assert "here up to 5.7e+04 rad/s^3 ('joint2')" in note
    assert "number of knots (2)" in note


@pytest.mark.parametrize("kind", ["jerk", "effort_rate"])
def test_joints_that_a_limit_holds_are_not_named(kind):
    robot, trajectory = two_link(**{kind: {"joint2": 1e9}}), cubic(NAMES, 1234.0, -56789.0)
    (note,) = jerk_note(robot, trajectory)
    assert "1.2e+03 rad/s^3 ('joint1')" in note
    assert largest_jerk(robot, trajectory) == (56789.0, "5.7e+04 rad/s^3 ('joint2')")
    assert largest_jerk(robot, trajectory, unlimited=True)[0] == 1234.0


def test_with_a_limit_on_every_joint_there_is_none():
    robot = two_link(jerk={"joint1": 1e9}, effort_rate={"joint2": 1e9})
    assert jerk_note(robot, cubic(NAMES, 1234.0, -56789.0)) == ()


def test_nor_is_there_one_of_joints_that_do_not_jerk(tmp_path):
    assert jerk_note(one_joint(tmp_path), cubic(["turn"], 0.0)) == ()


def test_sliding_joints_have_their_unit(slide):
    (note,) = jerk_note(slide, cubic(slide.joint_names, 1.0, 3.0, 2.0))
    assert "3 m/s^3 ('extend')" in note
