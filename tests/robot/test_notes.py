"""Notes on a robot: unused URDF values, implausible values."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from cases import SLIDE

from tubeplanner import LimitOverrides, MotorOverrides, load_robot
from tubeplanner.geometry.link_geometry import link_extents
from tubeplanner.robot.info import robot_info
from tubeplanner.robot.notes import (
    angles_of,
    doubts,
    implausible_values,
    robot_notes,
    unlimited_notes,
    unused_note,
)
from tubeplanner.robot.urdf_elements import unused_values

UNUSED = "the URDF says, and nothing here uses: "
LAW = "position_based_velocity_limits"
SLOWING = f'<{LAW} deceleration_limit="6" velocity_offset="0.3"/>'
FAST = SLIDE.replace('effort="60"', 'acceleration="15" effort="60"')


@pytest.fixture
def arm(tmp_path):
    """Return a function that loads the sliding arm with tags added to its joints."""

    def load(limits=None, motors=None, text=SLIDE, **inner):
        for joint, tags in inner.items():
            begin = f'<joint name="{joint}" type="'
            kind = text.split(begin)[1].split('"')[0]
            text = text.replace(f'{begin}{kind}">', f'{begin}{kind}">{tags}')
        (tmp_path / "arm.urdf").write_text(text)
        return load_robot(tmp_path / "arm.urdf", "tip", limits=limits, motors=motors)

    return load


LIMIT = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
VALUES = {
    LIMIT + '<dynamics damping="0" friction="0.0"/>': {},
    LIMIT + '<dynamics damping="0.5" friction="2" mu_viscous="16"/>': {
        "dynamics damping": "0.5",
        "dynamics friction": "2",
    },
    '<limit upper="2" jerk=" 7500 "/>': {"limit jerk": "7500"},
    # Soft limits, one as the hard one.
    LIMIT + '<safety_controller k_position="9" soft_lower_limit="-1.0" soft_upper_limit="1"/>': {
        "safety_controller soft_upper_limit": "1"
    },
    '<safety_controller soft_lower_limit="-1" soft_upper_limit="0"/>': {
        "safety_controller soft_lower_limit": "-1"
    },
    '<dynamics damping="${d}"/>': {"dynamics damping": "${d}"},
}


@pytest.mark.parametrize("inner", VALUES)
def test_values_that_are_not_used_are_found(inner):
    assert unused_values(ElementTree.fromstring(f"<joint>{inner}</joint>")) == VALUES[inner]


def damped(damping, friction=None):
    rest = "" if friction is None else f' friction="{friction}"'
    return f'<dynamics damping="{damping}"{rest}/>'


def test_friction_is_named_with_its_joints_and_share_and_equal_values_stand_once(arm):
    limits = LimitOverrides(velocity=[0.5, 2, 4], effort=[50, 50, 100])
    note = unused_note(arm(limits, turn=damped(5), extend=damped(2, 1), lift=damped(5)))
    assert note == (
        f"{UNUSED}<dynamics damping> 5 (turn, lift), 2 (extend); "
        "<dynamics friction> 1 (extend); that friction would at full speed take 20 % of the effort "
        "limit (lift); to keep it, give robot.motors.friction_from_urdf: true"
    )
    every = unused_note(arm(turn=damped(5), extend=damped(5), lift=damped(5)))
    assert "damping> 5 (every joint)" in every


def test_friction_that_is_given_is_not_named(arm):
    one_way = {"lift": [1, 0], "extend": [0, 1]}
    given = MotorOverrides(viscous_friction={"turn": 1}, coulomb_friction=one_way)
    extend = '<dynamics friction="3"/>'
    note = unused_note(arm(motors=given, turn=damped(2, 1), lift=damped(2, 1), extend=extend))
    assert "<dynamics friction> 1 (turn); <dynamics damping> 2 (lift); that friction" in note
    assert "take 30 % of the effort limit (lift); to keep" in note
    taken = MotorOverrides(friction_from_urdf=True)
    assert unused_note(arm(motors=taken, turn=damped(2, 1), lift=damped(2, 1))) is None


def test_a_placeholder_is_called_one_and_what_is_no_number_is_named_as_it_is_written(arm):
    note = unused_note(arm(lift=damped(2, 1)))
    assert "take 35 % of the effort limit (lift), more than a third: rather a placeholder" in note
    assert "placeholder" not in unused_note(arm(lift=damped(2, 0.5)))
    note = unused_note(arm(lift=damped("much")))
    assert "<dynamics damping> much (lift); to keep it, give robot.motors" in note


@pytest.mark.parametrize("free", ["velocity", "effort"])
def test_without_a_limit_no_share_is_named(arm, free):
    limits = LimitOverrides(**{free: {"lift": np.inf}})
    note = unused_note(arm(limits, lift=damped(2)))
    assert note.startswith(f"{UNUSED}<dynamics damping> 2 (lift); to k")
    note = unused_note(arm(limits, lift=damped(2), extend='<dynamics friction="6"/>'))
    assert "take 7.5 % of the effort limit (extend)" in note


def test_limits_that_the_problem_gives_itself_are_not_named(arm):
    """There is no field that takes soft limits."""
    note = unused_note(arm(text=FAST))
    remedy = "; to keep it, give robot.limits."
    assert note == f"{UNUSED}<limit acceleration> 15 (turn){remedy}acceleration"
    assert unused_note(arm(LimitOverrides(jerk={"turn": 9.0}), text=FAST)) == note
    assert unused_note(arm(LimitOverrides(acceleration={"turn": 12.0}), text=FAST)) is None
    prefixed = FAST.replace(" acceleration", " drake:acceleration")
    assert unused_note(arm(text=prefixed)) == note.replace("limit acc", "limit drake:acc")
    values = f"<{LAW} deceleration_limit> 6 (lift); <{LAW} velocity_offset> 0.3 (lift)"
    for joint, expected in (
        ("lift", None),
        ("turn", f"{UNUSED}{values}{remedy}velocity_by_position"),
    ):
        own = LimitOverrides(velocity_by_position={joint: {"deceleration": 6.0, "offset": 0.3}})
        assert unused_note(arm(own, lift=SLOWING)) == expected
    soft = '<safety_controller soft_lower_limit="-1" soft_upper_limit="3"/>'
    expected = f"{UNUSED}<safety_controller soft_lower_limit> -1 (turn)"
    assert unused_note(arm(turn=soft)) == expected


def test_ends_of_a_continuous_joint_are_named(arm):
    endless = SLIDE.replace('name="turn" type="revolute"', 'name="turn" type="continuous"')
    assert endless != SLIDE
    note = unused_note(arm(text=endless))
    assert "<limit lower>" in note and "<limit upper>" in note
    assert note.endswith("; to keep it, give robot.limits.position")
    assert unused_note(arm(LimitOverrides(position={"turn": (-1, 1)}), text=endless)) is None


def test_a_smaller_deceleration_is_named_unless_the_problem_has_its_own(arm):
    newer = SLIDE.replace("<robot", '<robot version="1.2"')
    newer = newer.replace('effort="60"', 'acceleration="15" deceleration="9" effort="60"')
    assert robot_notes(arm(text=newer)) == (
        "the URDF limits acceleration 15, deceleration 9 (turn); a limit holds in both directions "
        "here, so the smaller counts; robot.limits.acceleration replaces it",
    )
    assert robot_notes(arm(LimitOverrides(acceleration={"turn": 12}), text=newer)) == ()


def notes(name="ur5", tool="tool0", limits=None, **motors):
    motors = MotorOverrides(**motors)
    return robot_notes(load_robot(f"example:{name}", tool, limits=limits, motors=motors))


# Limits, motors, and where friction takes what fraction of the effort. The elbow of a UR5 turns at
# 3.15 rad/s and has 150 N m.
FRACTIONS = {
    "above a third": (
        None,
        {"viscous_friction": {"elbow_joint": 10}, "coulomb_friction": {"elbow_joint": [20, 18.6]}},
        "34 % of the effort limit (elbow_joint)",
    ),
    "below a third": (
        None,
        {"viscous_friction": {"elbow_joint": 10}, "coulomb_friction": {"elbow_joint": 18.4}},
        None,
    ),
    "of every joint": (
        LimitOverrides(velocity=1.0, effort=10.0),
        {"viscous_friction": 4},
        "40 % of the effort limit (every joint)",
    ),
    "of no limit": (LimitOverrides(effort=np.inf), {"coulomb_friction": 1000}, None),
}


@pytest.mark.parametrize(("limits", "motors", "fraction"), FRACTIONS.values(), ids=FRACTIONS)
def test_friction_that_no_gear_has_is_named_with_its_joint(limits, motors, fraction):
    expected = (
        f"at full speed friction takes {fraction}, more than a third: implausible for a geared "
        "arm; have it identified, or leave it out of robot.motors"
    )
    assert notes(limits=limits, **motors) == (() if fraction is None else (expected,))


def test_a_urdfs_placeholder_is_named_before_and_after_it_is_taken():
    (before,) = notes("xarm7", "link7")
    (after,) = notes("xarm7", "link7", friction_from_urdf=True)
    most = "65 % of the effort limit (joint1, joint2), more than a third"
    assert f"would at full speed take {most}" in before
    assert f"at full speed friction takes {most}" in after


def test_prefixes_that_are_not_declared_are_named_with_what_stands_under_them(arm):
    inner = "".join(f"<drake:part{k}/>" for k in range(9)) + "<other:x/>"
    robot = arm(text=SLIDE.replace('<link name="base"/>', f'{inner}<link name="base"/>'))
    named = ", ".join(f"drake:part{k}" for k in range(8))
    why = "it is read all the same, and nothing here uses what stands under it"
    assert robot_notes(robot) == (
        f"the URDF does not declare the prefix 'drake'; {why}: {named} and 1 more",
        f"the URDF does not declare the prefix 'other'; {why}: other:x",
    )


# Values that no arm has, each with its sentence.

MOMENTS = 'ixx="0.02" iyy="0.2" izz='
BODILY = SLIDE.replace(f'{MOMENTS}"0.3"', f'{MOMENTS}"0.2"')
BOOM = '<box size="0.4 0.06 0.06"/>'
DOUBTS = {
    # Ranges and speeds in degrees, a slide in millimetres.
    ('lower="-3" upper="3" effort="60"', 'lower="-170" upper="170" effort="60"'): (
        "position range 340 rad (turn), more than 62.9: that is ten turns; degrees? "
    ),
    ('effort="60" velocity="3"', 'effort="60" velocity="180"'): (
        "velocity limit 180 rad/s (turn), more than 30: a placeholder, or degrees? "
    ),
    ('lower="-1" upper="1"', 'lower="0" upper="800"'): (
        "position range 800 m (extend), more than 100: millimetres? "
    ),
    ('effort="80" velocity="1"', 'effort="80" velocity="250"'): (
        "velocity limit 250 m/s (extend), more than 30: a placeholder, or millimetres? "
    ),
    # A joint, a solid and a centre of mass in millimetres; angles in degrees.
    ('xyz="0.4 0 0"', 'xyz="400 0 0"'): "length of the arm 401 m (slide), more than 100: ",
    (BOOM, '<box size="400 60 60"/>'): (
        "farthest point 204.6 m, 66 times the arm's reach (link 'boom'), more than 10: millimetres?"
    ),
    ('xyz="0.3 0.1 0"', 'xyz="300 0.1 0"'): (
        "centre of mass outside the geometry by 300 m, 733 times the link's size (link 'boom'), "
    ),
    ('rpy="0.2 0.1 0.3"', 'rpy="0 90 0"'): (
        "rpy 90 rad (<collision> of link 'tip'), more than 6.3: degrees? "
    ),
    # Inertias: a decimal point, a placeholder.
    (f'{MOMENTS}"0.2"', f'{MOMENTS}"0.9"'): (
        "principal moments 0.02, 0.2, 0.9 kg m^2, the largest 4.09 times the sum of the others "
        "(link 'boom'), more than 1: no body has such"
    ),
    ('ixx="0.01" iyy="0.01" izz="0.01"', 'ixx="1" iyy="1" izz="1"'): (
        "radius of gyration 1 m, 3.55 times the link's size (link 'tip'), more than 2: "
    ),
}
RIGHT = {
    "a continuous joint has no range": ('"turn" type="revolute"', '"turn" type="continuous"'),
    "a rail": ('lower="-1" upper="1"', 'lower="-30" upper="30"'),
    "moments as rounded": ('ixx="0.1" iyy="0.2" izz="0.3"', 'ixx="1e-4" iyy="1e-4" izz="3e-4"'),
    "a frame without mass": ('<mass value="1"/>', '<mass value="1e-6"/>'),
    "a whole turn": ('rpy="0.2 0.1 0.3"', 'rpy="0 0 6.28319"'),
}


def implausible(arm, old, new):
    assert old in BODILY
    robot = arm(text=BODILY.replace(old, new))
    return implausible_values(robot, link_extents(robot))


@pytest.mark.parametrize(("change", "sentence"), DOUBTS.items(), ids=DOUBTS.values())
def test_what_no_arm_has_is_named_with_value_owner_bound_and_cause(arm, change, sentence):
    (doubt,) = implausible(arm, *change)
    assert doubt.startswith(sentence)


@pytest.mark.parametrize("change", RIGHT.values(), ids=RIGHT)
def test_what_arms_have_is_not_questioned(arm, change):
    assert implausible(arm, *change) == ()


def test_of_the_bundled_arms_only_the_wrist_of_the_ur5_and_a_placeholder_are_questioned():
    of_arms = {
        name: implausible_values(arm, link_extents(arm))
        for name in ("panda", "xarm7", "ur10", "ur5", "two_link")
        for arm in [robot_info(f"example:{name}").arm]
    }
    questioned = {name: [each[:22] for each in own] for name, own in of_arms.items() if own}
    assert questioned == {
        "ur5": ["radius of gyration 0.4"],  # as in the maker's file, for links of 0.15 m
        "two_link": ["velocity limit 100 rad"],
    }


def test_a_joint_that_does_not_move_the_tool_is_named(tmp_path):
    (tmp_path / "arm.urdf").write_text(BODILY)
    robot = load_robot(tmp_path / "arm.urdf", "boom", joints=["turn", "extend", "lift"])
    (doubt,) = implausible_values(robot, {})
    assert doubt.startswith("planned, but not moving tool_frame 'boom': lift; ")


def test_joints_with_neither_effort_nor_acceleration_limit_are_named():
    def notes_with(**limits):
        effort = {"joint1": np.inf, "joint2": np.inf}
        limits = LimitOverrides(effort=effort, velocity=1.0, **limits)
        return unlimited_notes(load_robot("example:two_link", "hand", limits=limits))

    (note,) = notes_with(acceleration={"joint1": 5.0})
    assert note.startswith("NEITHER an effort NOR an acceleration limit: joint2; ")
    assert notes_with(acceleration=5.0) == ()


def test_angles_of_fields_are_found_wherever_they_stand():
    fields = {
        "obstacles": [{"name": "box", "rpy": [0, 90.0, 0]}, {"name": "wall", "rpy": None}],
        "moves": [{"tube": {"rotation_tolerance": [0.1, [np.inf, 5, 5]], "points": [[9.0] * 3]}}],
        "robot": {"base": {"rpy": [3.2, 0, 0]}},
    }
    assert [each[:46] for each in doubts(angles_of(fields))] == [
        "rpy 90 rad (obstacles.box.rpy), more than 6.3:",
        "rotation tolerance 5 rad (moves.0.tube.rotatio",
    ]
