"""What is in a robot: sources of limits, tool frames, other joints, what is missing."""

import numpy as np
import pytest
from cases import SLIDE, refusal

from tubeplanner import LimitOverrides, MotorOverrides, RobotError, read_limits_file, read_preset
from tubeplanner.robot.info import robot_info
from tubeplanner.robot.loader import likely_tool_frame
from tubeplanner.robot.urdf import read_urdf
from tubeplanner.studies.tubes.starter_problem import typical_configurations

PAIR = """<robot name="pair"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>
<joint name="lead" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="5" velocity="4"/></joint>
<joint name="follow" type="revolute"><parent link="base"/><child link="b"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="5" velocity="2"/>
  <mimic joint="lead" multiplier="-2" offset="0.5"/></joint>
<joint name="lone" type="revolute"><parent link="base"/><child link="c"/><axis xyz="0 0 1"/>
  <limit lower="0.3" upper="2" effort="5" velocity="2"/></joint></robot>"""
MESH = '<collision><geometry><mesh filename="package://nowhere/a.stl"/></geometry></collision>'
CART = """<link name="world"/><joint name="base_joint" type="floating"><parent link="world"/>
<child link="base"/></joint></robot>"""


@pytest.fixture
def pair(tmp_path):
    """Return a function from replacements in the text of the pair to what is in the robot."""

    def info_of(*replacements, tool="a", **options):
        text = PAIR
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "pair.urdf").write_text(text)
        return robot_info(tmp_path / "pair.urdf", tool, **options)

    return info_of


def limits_of(info, quantity):
    return [(joint.limits[quantity].value, joint.limits[quantity].source) for joint in info.joints]


def test_each_limit_has_the_uppermost_layer_that_gives_it(tmp_path):
    moveit = tmp_path / "joint_limits.yaml"
    moveit.write_text(
        "joint_limits:\n  panda_joint1: {has_velocity_limits: true, max_velocity: 1.5}\n"
        "  panda_joint2: {has_jerk_limits: true, max_jerk: 77}\n"
    )
    own = LimitOverrides(velocity={"panda_joint3": 0.7}, scale={"velocity": 0.5})
    info = robot_info("example:panda", limits=[read_preset("fer"), read_limits_file(moveit), own])
    velocity = limits_of(info, "velocity")
    assert velocity[0] == (0.75, "limits_file joint_limits.yaml x 0.5")
    assert velocity[2] == (0.35, "problem file x 0.5")
    assert velocity[3][1] == "preset fer x 0.5"
    assert limits_of(info, "jerk")[1] == (77.0, "limits_file joint_limits.yaml")
    assert limits_of(info, "position")[0][1] == "URDF"
    own = LimitOverrides(position={"panda_joint2": (-1.0, 1.0)}, position_margin=0.25)
    position = limits_of(robot_info("example:panda", limits=own), "position")
    assert position[0][1] == "URDF, less 0.25"
    assert position[1] == ((-0.75, 0.75), "problem file, less 0.25")


def test_limits_that_are_lifted_on_purpose_are_not_missing_and_ranges_show_the_most():
    info = robot_info("example:ur5", limits=LimitOverrides(effort=np.inf))
    assert limits_of(info, "effort")[0] == (None, "problem file")
    assert info.missing == ()
    info = robot_info("example:ur5", limits=LimitOverrides(effort={"elbow_joint": (50, 80)}))
    effort = [(150.0, "URDF"), (80.0, "problem file, most of a range")]
    assert limits_of(info, "effort")[1:3] == effort


def test_what_a_newer_urdf_limits_has_its_source_and_unused_values_are_noted(tmp_path):
    newer = SLIDE.replace("<robot", '<robot version="1.2"')
    newer = newer.replace('effort="60"', 'acceleration="15" jerk="0" effort="60"')
    newer = newer.replace("<limit", '<dynamics friction="2"/><limit')
    (tmp_path / "slide.urdf").write_text(newer)
    info = robot_info(tmp_path / "slide.urdf")
    turn, extend = info.joints[:2]
    assert (turn.limits["acceleration"].value, turn.limits["acceleration"].source) == (15, "URDF")
    assert extend.limits["acceleration"].is_missing and turn.limits["jerk"].is_missing
    jerk = "jerk limit of turn (the URDF has 0): give the maker's in robot.limits.jerk"
    assert info.missing[0].startswith(jerk)
    (note,) = info.notes
    assert "<dynamics friction> 2 (every joint)" in note


def test_motors_have_their_sources():
    friction = {"joint1": (1, 2)}
    motors = MotorOverrides(coulomb_friction=friction, saturation_effort=5, no_load_velocity=9)
    motor = robot_info("example:z1", motors=motors).joints[0].motor
    assert motor["coulomb_friction"].value == (1.0, 2.0)
    assert motor["saturation_effort"].source == "problem file"
    assert "viscous_friction" not in motor
    stated = MotorOverrides(friction_from_urdf=True)
    motor = robot_info("example:z1", motors=stated).joints[0].motor
    assert (motor["viscous_friction"].value, motor["viscous_friction"].source) == (1.0, "URDF")
    assert motor["coulomb_friction"].value == 1.0  # one number for both ways
    assert robot_info("example:z1").joints[0].motor == {}


def test_followers_locked_joints_and_mobile_bases_are_listed(pair):
    info = pair(("</robot>", CART))
    assert limits_of(info, "velocity") == [(1.0, "follower follow")]
    assert limits_of(info, "position") == [((-0.75, 1.25), "follower follow")]
    follow, lone, base = info.other_joints
    assert (follow.follows, follow.multiplier, follow.position) == ("lead", -2.0, 0.5)
    assert (lone.follows, lone.position) == (None, 0.3)
    assert (base.name, base.type) == ("base_joint", "floating")
    one_end = pair(('upper="2" effort="5" velocity="4"', 'upper="1" effort="5" velocity="4"'))
    assert limits_of(one_end, "position") == [((-0.75, 1.0), "follower follow")]


def test_what_is_missing_is_named(pair):
    """Masses are not asked for where efforts are free on purpose."""
    masses, geometry = pair().missing
    assert "<inertial>" in masses and "collision geometry" in geometry
    free = pair(limits=LimitOverrides(effort=np.inf))
    assert not any("<inertial>" in each for each in free.missing)
    mesh = pair(('<link name="a"/>', f'<link name="a">{MESH}</link>'))
    assert "package://nowhere/a.stl" in mesh.missing[-1]


def test_what_stands_in_for_a_missing_limit_is_shown_as_none(pair):
    info = robot_info("example:double_pendulum")
    for quantity in ("position", "velocity", "effort", "acceleration"):
        assert limits_of(info, quantity) == [(None, "none")] * 2
    rail = ('"lone" type="revolute"', '"lone" type="prismatic"')
    info = pair(rail, ('lower="0.3" upper="2"', 'lower="-inf" upper="inf"'), tool="c")
    assert limits_of(info, "position") == [(None, "none")]
    assert "position limits of lone" in info.missing[0]


@pytest.mark.parametrize(
    ("name", "frame"),
    [
        ("two_link", "hand"),
        ("panda", "panda_hand_tcp"),  # above two fingers, beyond the hand
        ("tiago", "hand_grasping_frame"),  # above five fingers of several joints
        ("icub", "l_gripper"),  # the torso parts into arms, which are no fingers
    ],
)
def test_the_tool_frame_is_the_end_of_the_longest_chain(name, frame):
    info = robot_info(f"example:{name}")
    assert info.tool_frame == frame
    assert frame in info.leaf_links


def test_a_robot_that_cannot_move_is_refused(tmp_path):
    path = tmp_path / "rock.urdf"
    path.write_text('<robot name="rock"><link name="base"/></robot>')
    assert "no joint can move" in refusal(RobotError, likely_tool_frame, read_urdf(path))


@pytest.mark.parametrize("name", ["ur5", "two_link", "kinova"])
def test_typical_configurations_are_within_limits_and_far_from_singular(name):
    arm = robot_info(f"example:{name}").arm
    q = typical_configurations(arm)
    np.testing.assert_array_equal(arm.limits.clip(q), q)

    def gain(rows):
        gains = np.linalg.svd(arm.tool_jacobian(rows)[1][:, :3], compute_uv=False)
        return gains[:, min(arm.joint_count, 3) - 1]

    assert gain(q[:20]).min() > np.median(gain(q))
