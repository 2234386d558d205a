"""Notes on a robot: unused URDF values, implausible friction."""

import numpy as np
import pytest
from cases import SLIDE

from tubeplanner import LimitOverrides, MotorOverrides, load_robot
from tubeplanner.robot.robot_notes import robot_notes
from tubeplanner.robot.unused_note import unused_note

# The sentence on what a URDF says in vain: short, with joints and values.


@pytest.fixture
def arm(tmp_path):
    """Return a function that loads the sliding arm with tags added to its joints."""

    def load(limits=None, motors=None, **inner):
        text = SLIDE
        for joint, tags in inner.items():
            begin = f'<joint name="{joint}" type="'
            kind = text.split(begin)[1].split('"')[0]
            text = text.replace(f'{begin}{kind}">', f'{begin}{kind}">{tags}')
        (tmp_path / "arm.urdf").write_text(text)
        return load_robot(tmp_path / "arm.urdf", "tip", limits=limits, motors=motors)

    return load


def test_an_arm_that_says_nothing_more_has_no_note(slide):
    assert unused_note(slide) is None


def test_equal_values_stand_once(arm):
    damped, rubbing = '<dynamics damping="5"/>', '<dynamics damping="2" friction="1"/>'
    limits = LimitOverrides(velocity=[0.5, 2, 4], effort=[50, 50, 100])
    assert unused_note(arm(limits, turn=damped, extend=rubbing, lift=damped)) == (
        "the URDF says, and nothing here uses: <dynamics damping> 5 (turn, lift), 2 (extend); "
        "<dynamics friction> 1 (extend); that friction would at full speed take 20 % of the effort "
        "limit (lift); to keep it, give robot.motors.friction_from_urdf: true"
    )
    assert "damping> 5 (every joint)" in unused_note(arm(turn=damped, extend=damped, lift=damped))


def test_friction_that_is_given_is_not_named(arm):
    rubbing = '<dynamics damping="2" friction="1"/>'
    one_way = {"lift": [1, 0], "extend": [0, 1]}
    given = MotorOverrides(viscous_friction={"turn": 1}, coulomb_friction=one_way)
    note = unused_note(
        arm(motors=given, turn=rubbing, lift=rubbing, extend='<dynamics friction="3"/>')
    )
    assert "<dynamics friction> 1 (turn); <dynamics damping> 2 (lift); that friction" in note
    assert "take 30 % of the effort limit (lift); to keep" in note
    taken = MotorOverrides(friction_from_urdf=True)
    assert unused_note(arm(motors=taken, turn=rubbing, lift=rubbing)) is None


def test_a_placeholder_is_called_one(arm):
    note = unused_note(arm(lift='<dynamics damping="2" friction="1"/>'))
    assert "take 35 % of the effort limit (lift), more than a third: rather a placeholder" in note
    assert "placeholder" not in unused_note(arm(lift='<dynamics damping="2" friction="0.5"/>'))


@pytest.mark.parametrize("free", ["velocity", "effort"])
def test_without_a_limit_no_share_is_named(arm, free):
    tags, limits = '<dynamics damping="2"/>', LimitOverrides(**{free: {"lift": np.inf}})
    note = unused_note(arm(limits, lift=tags))
    assert note.startswith(
        "the URDF says, and nothing here uses: <dynamics damping> 2 (lift); to k"
    )
    assert "take 7.5 % of the effort limit (extend)" in unused_note(
        arm(limits, lift=tags, extend='<dynamics friction="6"/>')
    )


def test_what_is_no_friction_is_named_as_it_is_written(arm):
    note = unused_note(arm(lift='<dynamics damping="much"/>'))
    assert "<dynamics damping> much (lift); to keep it, give robot.motors" in note


def test_a_limit_that_the_problem_gives_itself_is_not_named(arm, tmp_path):
    text = SLIDE.replace('effort="60"', 'acceleration="15" effort="60"')
    path = tmp_path / "fast.urdf"
    path.write_text(text)
    note = unused_note(load_robot(path, "tip"))
    assert note.endswith(
        "<limit acceleration> 15 (turn); to keep it, give robot.limits.acceleration"
    )
    assert unused_note(load_robot(path, "tip", limits=LimitOverrides(jerk={"turn": 9.0}))) == note
    given = LimitOverrides(acceleration={"turn": 12.0})
    assert unused_note(load_robot(path, "tip", limits=given)) is None


def test_velocities_by_position_are_named_unless_they_are_given(arm):
    law = '<position_based_velocity_limits deceleration_limit="6" velocity_offset="0.3"/>'
    assert unused_note(arm(lift=law)) == (
        "the URDF says, and nothing here uses: <position_based_velocity_limits deceleration_limit> "
        "6 (lift); <position_based_velocity_limits velocity_offset> 0.3 (lift); to keep it, give "
        "robot.limits.velocity_by_position"
    )
    given = {"deceleration": 6.0, "offset": 0.3}
    assert unused_note(arm(LimitOverrides(velocity_by_position={"lift": given}), lift=law)) is None
    other = LimitOverrides(velocity_by_position={"turn": given})
    assert unused_note(arm(other, lift=law)) is not None


def test_soft_limits_are_named_without_a_field_that_takes_them(arm):
    soft = '<safety_controller soft_lower_limit="-1" soft_upper_limit="3"/>'
    assert unused_note(arm(turn=soft)) == (
        "the URDF says, and nothing here uses: <safety_controller soft_lower_limit> -1 (turn)"
    )


def test_bundled_arms_are_named(panda, ur5):
    assert "<dynamics damping> 0.003 (every joint)" in unused_note(panda)
    assert unused_note(ur5) is None


def test_a_value_under_a_prefix_that_is_not_declared(tmp_path):
    path = tmp_path / "fast.urdf"
    path.write_text(SLIDE.replace('effort="60"', 'drake:acceleration="2.5" effort="60"'))
    assert unused_note(load_robot(path, "tip")) == (
        "the URDF says, and nothing here uses: <limit drake:acceleration> 2.5 (turn); to keep it, "
        "give robot.limits.acceleration"
    )


# Notes on a robot as it is described.


def robot_arm(name="ur5", tool="tool0", **motors):
    return load_robot(f"example:{name}", tool, motors=MotorOverrides(**motors))


def test_a_robot_that_is_plain_has_none():
    assert robot_notes(robot_arm()) == ()


def test_friction_that_no_gear_has_is_named_with_its_joint():
    """The elbow of a UR5 turns at 3.15 rad/s and has 150 N m."""
    viscous, coulomb = {"elbow_joint": 10}, {"elbow_joint": [20, 18.6]}
    assert robot_notes(robot_arm(viscous_friction=viscous, coulomb_friction=coulomb)) == (
        "at full speed friction takes 34 % of the effort limit (elbow_joint), more than a third: "
        "implausible for a geared arm; have it identified, or leave it out of robot.motors",
    )
    coulomb = {"elbow_joint": 18.4}
    assert robot_notes(robot_arm(viscous_friction=viscous, coulomb_friction=coulomb)) == ()


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
    (before,) = robot_notes(robot_arm("xarm7", "link7"))
    (after,) = robot_notes(robot_arm("xarm7", "link7", friction_from_urdf=True))
    most = "65 % of the effort limit (joint1, joint2), more than a third"
    assert f"would at full speed take {most}" in before
    assert f"at full speed friction takes {most}" in after


def test_more_than_the_whole_effort_is_written_out():
    (note,) = robot_notes(robot_arm(coulomb_friction={"elbow_joint": 300}))
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
