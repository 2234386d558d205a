"""Notes on a robot: unused URDF values, implausible friction."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from cases import SLIDE

from tubeplanner import LimitOverrides, MotorOverrides, load_robot
from tubeplanner.robot.notes import robot_notes, unused_note
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


# Limits, motors, and where friction takes what share of the effort. The elbow of a UR5 turns at
# 3.15 rad/s and has 150 N m.
SHARES = {
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


@pytest.mark.parametrize(("limits", "motors", "share"), SHARES.values(), ids=SHARES)
def test_friction_that_no_gear_has_is_named_with_its_joint(limits, motors, share):
    expected = (
        f"at full speed friction takes {share}, more than a third: implausible for a geared arm; "
        "have it identified, or leave it out of robot.motors"
    )
    assert notes(limits=limits, **motors) == (() if share is None else (expected,))


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
