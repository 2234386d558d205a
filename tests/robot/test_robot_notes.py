"""Notes on a robot as it is described."""

import numpy as np

from cases import SLIDE
from tubeplanner import LimitOverrides, MotorOverrides, load_robot
from tubeplanner.robot.robot_notes import robot_notes


def arm(name="ur5", tool="tool0", **motors):
    return load_robot(f"example:{name}", tool, motors=MotorOverrides(**motors))


def test_a_robot_that_is_plain_has_none():
    assert robot_notes(arm()) == ()


def test_friction_that_no_gear_has_is_named_with_its_joint():
    """The elbow of a UR5 turns at 3.15 rad/s and has 150 N m."""
    viscous, coulomb = {"elbow_joint": 10}, {"elbow_joint": [20, 18.6]}
    assert robot_notes(arm(viscous_friction=viscous, coulomb_friction=coulomb)) == (
        "at full speed friction takes 34 % of the effort limit (elbow_joint), more than a third: "
        "implausible for a geared arm; have it identified, or leave it out of robot.motors",
    )
    coulomb = {"elbow_joint": 18.4}
    assert robot_notes(arm(viscous_friction=viscous, coulomb_friction=coulomb)) == ()


def test_friction_of_every_joint_is_named_shortly():
    free = LimitOverrides(velocity=1.0, effort=10.0)
    motors = MotorOverrides(viscous_friction=4)
    (note,) = robot_notes(load_robot("example:ur5", "tool0", limits=free, motors=motors))
    assert note.startswith("at full speed friction takes 40 % of the effort limit (every joint), ")


def test_without_limits_friction_has_no_share():
    free = LimitOverrides(effort=np.inf)
    motors = MotorOverrides(coulomb_friction=1000)
    assert robot_notes(load_robot("example:ur5", "tool0", limits=free, motors=motors)) == ()


def test_a_urdfs_placeholder_is_named_before_and_after_it_is_taken():
    (before,) = robot_notes(arm("xarm7", "link7"))
    (after,) = robot_notes(arm("xarm7", "link7", friction_from_urdf=True))
    most = "65 % of the effort limit (joint1, joint2), more than a third"
    assert f"would at full speed take {most}" in before
    assert f"at full speed friction takes {most}" in after


def test_more_than_the_whole_effort_is_written_out():
    (note,) = robot_notes(arm(coulomb_friction={"elbow_joint": 300}))
    assert note.startswith("at full speed friction takes 200 % of the effort limit (elbow_joint), ")


def test_prefixes_that_are_not_declared_are_named_with_what_stands_under_them(tmp_path):
    inner = "".join(f"<drake:part{k}/>" for k in range(9)) + "".join(
        f"<other:x{k}/>" for k in range(8)
    )
    path = tmp_path / "arm.urdf"
    path.write_text(SLIDE.replace('<link name="base"/>', f'{inner}<link name="base"/>'))
    robot = load_robot(path, "tip")
    named = ", ".join(f"drake:part{k}" for k in range(8))
    others = ", ".join(f"other:x{k}" for k in range(8))
    why = "it is read all the same, and nothing here uses what stands under it"
    assert robot_notes(robot) == (
        f"the URDF does not declare the prefix 'drake'; {why}: {named} and 1 more",
        f"the URDF does not declare the prefix 'other'; {why}: {others}",
    )
