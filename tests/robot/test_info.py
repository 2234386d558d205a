"""What is in a robot: sources of limits, tool frames, other joints, what is missing."""

import numpy as np
import pytest

from tubeplanner import LimitOverrides, MotorOverrides, RobotError, read_limits_file, read_preset
from tubeplanner.robot.robot_info import robot_info
from tubeplanner.robot.tool_frames import likely_tool_frame
from tubeplanner.robot.typical_configurations import typical_configurations
from tubeplanner.robot.urdf import read_urdf


def _limits(info, quantity):
    return [(joint.limits[quantity].value, joint.limits[quantity].source) for joint in info.joints]


def test_each_limit_has_the_uppermost_layer_that_gives_it(tmp_path):
    moveit = tmp_path / "joint_limits.yaml"
    moveit.write_text(
        "joint_limits:\n  panda_joint1: {has_velocity_limits: true, max_velocity: 1.5}\n"
        "  panda_joint2: {has_jerk_limits: true, max_jerk: 77}\n"
    )
    own = LimitOverrides(velocity={"panda_joint3": 0.7}, scale={"velocity": 0.5})
    layers = [read_preset("fer"), read_limits_file(moveit), own]
    info = robot_info("example:panda", limits=layers)
    velocity = _limits(info, "velocity")
    assert velocity[0] == (0.75, "limits_file joint_limits.yaml x 0.5")
    assert velocity[2] == (0.35, "problem file x 0.5")
    assert velocity[3][1] == "preset fer x 0.5"
    assert _limits(info, "jerk")[1] == (77.0, "limits_file joint_limits.yaml")
    assert _limits(info, "position")[0][1] == "URDF"


def test_limits_that_are_lifted_on_purpose_are_not_missing():
    info = robot_info("example:ur5", limits=LimitOverrides(effort=np.inf))
    assert _limits(info, "effort")[0] == (None, "problem file")
    assert info.missing == ()


def test_an_effort_that_varies_is_named_as_the_most_of_a_range():
    info = robot_info("example:ur5", limits=LimitOverrides(effort={"elbow_joint": (50, 80)}))
    assert _limits(info, "effort")[2] == (80.0, "problem file, most of a range")
    assert _limits(info, "effort")[1] == (150.0, "URDF")


def test_motors_have_their_sources():
    motors = MotorOverrides(
        coulomb_friction={"joint1": (1, 2)}, saturation_effort=5, no_load_velocity=9
    )
    info = robot_info("example:z1", motors=motors)
    motor = info.joints[0].motor
    assert motor["coulomb_friction"].value == (1.0, 2.0)
    assert motor["saturation_effort"].source == "problem file"
    assert "viscous_friction" not in motor
    stated = robot_info("example:z1", motors=MotorOverrides(friction_from_urdf=True))
    assert stated.joints[0].motor["viscous_friction"].value == 1.0
    assert stated.joints[0].motor["viscous_friction"].source == "URDF"
    assert stated.joints[0].motor["coulomb_friction"].value == 1.0  # one number for both ways
    assert robot_info("example:z1").joints[0].motor == {}


FOLLOWER = """<robot name="pair"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>
<joint name="lead" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="5" velocity="4"/></joint>
<joint name="follow" type="revolute"><parent link="base"/><child link="b"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="5" velocity="2"/>
  <mimic joint="lead" multiplier="-2" offset="0.5"/></joint>
<joint name="lone" type="revolute"><parent link="base"/><child link="c"/><axis xyz="0 0 1"/>
  <limit lower="0.3" upper="2" effort="5" velocity="2"/></joint></robot>"""


def test_followers_and_locked_joints_are_listed(tmp_path):
    (tmp_path / "pair.urdf").write_text(FOLLOWER)
    info = robot_info(tmp_path / "pair.urdf", "a")
    assert _limits(info, "velocity") == [(1.0, "follower follow")]
    assert _limits(info, "position") == [((-0.75, 1.25), "follower follow")]
    follow, lone = info.other_joints
    assert (follow.follows, follow.multiplier, follow.position) == ("lead", -2.0, 0.5)
    assert (lone.follows, lone.position) == (None, 0.3)
    assert len(info.missing) == 2 and "<inertial>" in info.missing[0]
    assert "collision geometry" in info.missing[1]


def test_a_follower_that_cuts_one_end_of_a_range_is_named(tmp_path):
    (tmp_path / "pair.urdf").write_text(
        FOLLOWER.replace('upper="2" effort="5" velocity="4"', 'upper="1" effort="5" velocity="4"')
    )
    info = robot_info(tmp_path / "pair.urdf", "a")
    assert _limits(info, "position") == [((-0.75, 1.0), "follower follow")]


def test_what_stands_in_for_a_missing_limit_is_shown_as_none(tmp_path):
    info = robot_info("example:double_pendulum")
    for quantity in ("position", "velocity", "effort", "acceleration"):
        assert _limits(info, quantity) == [(None, "none")] * 2
    rail = FOLLOWER.replace('"lone" type="revolute"', '"lone" type="prismatic"')
    rail = rail.replace('lower="0.3" upper="2"', 'lower="-inf" upper="inf"')
    (tmp_path / "pair.urdf").write_text(rail)
    info = robot_info(tmp_path / "pair.urdf", "c")
    assert _limits(info, "position") == [(None, "none")]
    assert "position limits of lone" in info.missing[0]


def test_masses_are_not_asked_where_efforts_are_free_on_purpose(tmp_path):
    (tmp_path / "pair.urdf").write_text(FOLLOWER)
    info = robot_info(tmp_path / "pair.urdf", "a", limits=LimitOverrides(effort=np.inf))
    assert not any("<inertial>" in each for each in info.missing)


def test_meshes_that_are_not_found_are_missing(tmp_path):
    mesh = '<collision><geometry><mesh filename="package://nowhere/a.stl"/></geometry></collision>'
    text = FOLLOWER.replace('<link name="a"/>', f'<link name="a">{mesh}</link>')
    (tmp_path / "pair.urdf").write_text(text)
    assert "package://nowhere/a.stl" in robot_info(tmp_path / "pair.urdf", "a").missing[-1]


@pytest.mark.parametrize(
    ("name", "frame"),
    [
        ("two_link", "hand"),
        ("ur5", "ee_link"),
        ("panda", "panda_hand_tcp"),  # above two fingers, beyond the hand
        ("xarm7", "link_eef"),
        ("kinova", "j2s6s200_end_effector"),
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
    with pytest.raises(RobotError, match="no joint can move"):
        likely_tool_frame(read_urdf(path))


def test_mobile_bases_are_listed(tmp_path):
    text = FOLLOWER.replace(
        "</robot>",
        '<link name="world"/><joint name="base_joint" type="floating"><parent link="world"/>'
        '<child link="base"/></joint></robot>',
    )
    (tmp_path / "pair.urdf").write_text(text)
    last = robot_info(tmp_path / "pair.urdf", "a").other_joints[-1]
    assert (last.name, last.type) == ("base_joint", "floating")


@pytest.mark.parametrize("name", ["ur5", "panda", "two_link", "kinova"])
def test_typical_configurations_are_within_limits_and_far_from_singular(name):
    arm = robot_info(f"example:{name}").arm
    q = typical_configurations(arm)
    np.testing.assert_array_equal(arm.limits.clip(q), q)

    def gain(rows):
        gains = np.linalg.svd(arm.tool_jacobian(rows)[1][:, :3], compute_uv=False)
        return gains[:, min(arm.joint_count, 3) - 1]

    assert gain(q[:20]).min() > np.median(gain(q))
