"""How often and how far Coulomb friction jumps, in words."""

import numpy as np
import pytest

from cases import anywhere, with_motors
from tubeplanner import JointTrajectory, Tolerance
from tubeplanner.verification.friction_jumps import friction_jumps
from tubeplanner.verification.judged_motion import JudgedMotion

EVERY = np.ones(3, dtype=bool)


def told(robot, rows, breakpoints=(0.0, 1.0), joints=EVERY):
    trajectory = JointTrajectory(robot.joint_names, breakpoints, np.array(rows))
    return friction_jumps(JudgedMotion(anywhere(robot), trajectory, Tolerance()), joints)


@pytest.fixture
def arm(slide):
    """It turns, extends and lifts."""
    return with_motors(slide, backwards_friction=[1.0, 4.0, 2.0], forwards_friction=[2.0, 5.0, 0.0])


def swings(at):
    """Rows of joints that reverse at times within a second; None: moves on, 0: stands still."""
    rows = np.zeros((3, 1, 3))
    for joint, time in enumerate(at):
        if time != 0:
            rows[:2, 0, joint] = (0.0, 1.0) if time is None else (0.5, -time)
    return rows


def test_the_largest_jump_has_its_joint_and_time(arm):
    assert told(arm, swings([0.25, 0.5, 0.75])) == (
        "Coulomb friction, which is apart, jumps at 3 reversals, by at most 9 N (extend, "
        "t = 0.5000 s)"
    )
    assert told(arm, swings([0.25, None, 0])) == (
        "Coulomb friction, which is apart, jumps at 1 reversal, by at most 3 N m (turn, "
        "t = 0.2500 s)"
    )


def test_joints_that_are_not_asked_for_do_not_count(arm):
    only = np.array([True, False, True])
    assert "2 reversals, by at most 3 N m (turn" in told(
        arm, swings([0.25, 0.5, 0.75]), joints=only
    )
    assert told(arm, swings([0.25, 0.5, 0.75]), joints=~EVERY) == ""


def test_uncertain_friction_may_jump_farther(slide):
    arm = with_motors(slide, forwards_friction=1.0, friction_uncertainty=0.5)
    assert "by at most 1.5 N m" in told(arm, swings([0.25, None, None]))


def test_a_reversal_at_a_breakpoint_or_after_a_stop_is_one(arm):
    """It goes on for a second, rests for two, and comes back."""
    rows = np.zeros((2, 3, 3))
    rows[0, :, 0], rows[1, :, 0] = (1.0, 0.0, -1.0), (0.0, 1.0, 1.0)
    text = told(arm, rows, (0.0, 1.0, 3.0, 4.0))
    assert text.endswith("jumps at 1 reversal, by at most 3 N m (turn, t = 3.0000 s)")


def test_without_friction_there_is_nothing_to_tell(slide, arm):
    assert told(slide, swings([0.25, 0.5, 0.75])) == ""
    assert told(arm, swings([None, 0, None])).endswith("no joint reverses")
