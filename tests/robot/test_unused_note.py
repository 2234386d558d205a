"""The sentence on what a URDF says in vain: short, with joints and values."""

import pytest

from cases import SLIDE
from tubeplanner import LimitOverrides, load_robot
from tubeplanner.robot.unused_note import unused_note


@pytest.fixture
def arm(tmp_path):
    """Return a function that loads the sliding arm with tags added to its joints."""

    def load(limits=None, **inner):
        text = SLIDE
        for joint, tags in inner.items():
            begin = f'<joint name="{joint}" type="'
            kind = text.split(begin)[1].split('"')[0]
            text = text.replace(f'{begin}{kind}">', f'{begin}{kind}">{tags}')
        (tmp_path / "arm.urdf").write_text(text)
        return load_robot(tmp_path / "arm.urdf", "tip", limits=limits)

    return load


def test_an_arm_that_says_nothing_more_has_no_note(slide):
    assert unused_note(slide) is None


def test_equal_values_stand_once(arm):
    damped, rubbing = '<dynamics damping="5"/>', '<dynamics damping="2" friction="1"/>'
    assert unused_note(arm(turn=damped, extend=rubbing, lift=damped)) == (
        "the URDF says, and nothing here uses: <dynamics damping> 5 (turn, lift), 2 (extend); "
        "<dynamics friction> 1 (extend)"
    )
    assert "damping> 5 (every joint)" in unused_note(arm(turn=damped, extend=damped, lift=damped))


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


def test_bundled_arms_are_named(panda, ur5):
    assert "<dynamics damping> 0.003 (every joint)" in unused_note(panda)
    assert unused_note(ur5) is None
