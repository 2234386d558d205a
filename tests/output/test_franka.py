"""libfranka's control of positions, by quintics of known peaks; limits that Franka prints."""

from dataclasses import replace

import numpy as np
import pytest
from cases import PEAK_ACCELERATION, PEAK_JERK, PEAK_VELOCITY

from tubeplanner import JointTrajectory, OptionError, load_robot
from tubeplanner.output.controllers import Effect, franka_limits, judged_by_franka

FER, FR3 = franka_limits("fer"), franka_limits("fr3")


def limited(limits, **most):
    rows = {name: np.full(7, value) for name, value in most.items()}
    return replace(limits, most={**limits.most, **rows})


FREE = limited(FER, velocity=1e3, acceleration=1e6, jerk=1e9, effort_rate=1e9)
START = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.5])
SHAPE = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
POSITION = "joint_motion_generator_position_limits_violation"
VELOCITY = "joint_motion_generator_velocity_limits_violation"
ACCELERATION = "joint_motion_generator_velocity_discontinuity"
JERK = "joint_motion_generator_acceleration_discontinuity"


def test_the_velocity_is_limited_near_the_ends_of_the_second_joint():
    for q in np.linspace(-1.9, 1.9, 41):
        lower, upper = FR3.velocity_bounds(np.full((1, 7), q))
        assert upper[0, 1] == pytest.approx(
            min(2.62, max(0, -0.2 + np.sqrt(max(0, 5.17 * (1.7918 - q)))))
        )
        assert lower[0, 1] == pytest.approx(
            max(-2.62, min(0, 0.2 - np.sqrt(max(0, 5.17 * (1.7918 + q)))))
        )


def test_of_the_fr3_some_joints_have_other_ends_below_than_above_and_the_panda_one_limit():
    q = np.array([[0, 0, 0, -3.0, 0, 0.6, 0]])
    lower, upper = FR3.velocity_bounds(q)
    assert upper[0, [3, 5]] == pytest.approx([2.62, 4.18])
    assert lower[0, 3] == pytest.approx(0.3 - np.sqrt(8 * (3.0481 - 3.0)))
    assert lower[0, 5] == pytest.approx(0.35 - np.sqrt(11 * (0.6 - 0.54092)))

    lower, upper = FER.velocity_bounds(np.full((3, 7), 2.8))
    assert upper == pytest.approx(np.tile(FER.most["velocity"], (3, 1)))
    assert lower == pytest.approx(-upper)


def turning(robot, angle, duration, joint=2, start=START):
    """Return a quintic of one joint from rest to rest."""
    coefficients = np.zeros((6, 1, 7))
    coefficients[:, 0, joint] = angle * SHAPE
    coefficients[-1, 0] = start
    return JointTrajectory(robot.joint_names, [0, 1.0], coefficients).scaled(duration)


def refusals(robot, trajectory, limits):
    verdict = judged_by_franka("fer", robot, trajectory, limits)
    assert verdict.accepted == (verdict.summary == "accepted")
    return {each.error: each for each in verdict.findings if each.effect is Effect.REFUSED}


@pytest.mark.parametrize(
    ("order", "error", "peak"),
    [(1, VELOCITY, PEAK_VELOCITY), (2, ACCELERATION, PEAK_ACCELERATION), (3, JERK, PEAK_JERK)],
)
def test_a_quintic_just_below_a_limit_is_accepted_and_one_above_it_aborts(
    panda, order, error, peak
):
    """Differences over a millisecond are means: a fraction of the peak is lost, below 2 %."""
    angle, duration, limit = 0.9, 1.0, 10.0**order
    field = ("velocity", "acceleration", "jerk")[order - 1]
    limits = limited(FREE, **{field: limit})
    exact = duration * (peak * angle / duration**order / limit) ** (1 / order)
    assert refusals(panda, turning(panda, angle, 1.001 * exact), limits) == {}
    result = refusals(panda, turning(panda, angle, 0.95 * exact), limits)
    assert list(result) == [error]
    assert result[error].joint == "panda_joint3"
    assert abs(result[error].value) == pytest.approx(limit / 0.95**order, rel=0.05)
    assert result[error].limit == pytest.approx(np.sign(result[error].value) * limit)
    assert 0 < result[error].first_time <= result[error].time


def test_differences_are_those_that_a_loop_over_commands_takes(panda):
    """The robot's own bookkeeping, command by command, in plain numbers."""
    trajectory = turning(panda, 0.9, 0.1234)
    last = [float(START[2])] * 3 + [0.0] * 2
    worst = {1: 0.0, 2: 0.0, 3: 0.0}
    q, v, a = last[0], 0.0, 0.0
    for k in range(130):
        command = float(trajectory.position(min(k * 1e-3, 0.1234))[2])
        rate = (command - q) / 1e-3
        bend = (rate - v) / 1e-3
        jerk = (bend - a) / 1e-3
        q, v, a = command, rate, bend
        worst = {n: max(worst[n], abs(x)) for n, x in zip(worst, (rate, bend, jerk), strict=True)}
    limits = limited(FREE, velocity=1e-3, acceleration=1e-3, jerk=1e-3)
    result = refusals(panda, trajectory, limits)
    values = [abs(result[error].value) for error in (VELOCITY, ACCELERATION, JERK)]
    assert values == pytest.approx(list(worst.values()), rel=1e-5)


@pytest.mark.parametrize(("angle", "limit", "sign"), [(3.0, 2.8973, ">"), (-3.0, -2.8973, "<")])
def test_positions_beyond_a_limit_abort(panda, angle, limit, sign):
    refusal = refusals(panda, turning(panda, angle, 20.0), FREE)[POSITION]
    assert (refusal.value, refusal.limit) == pytest.approx((angle, limit))
    assert sign in refusal.message
    assert refusal.first_time < refusal.time <= 20.0


@pytest.mark.parametrize("at_end", [False, True])
def test_a_motion_that_does_not_rest_aborts(panda, at_end):
    """Half a quintic: from rest to full speed, or the other way round."""
    whole = turning(panda, 0.5, 4.0)
    half = whole.between(0.0, 2.0) if at_end else whole.between(2.0, 4.0)
    velocity, instant = PEAK_VELOCITY * 0.5 / 4.0, 2.0 * at_end
    findings = judged_by_franka("fer", panda, half, FER).findings
    jump, rest = [each for each in findings if each.error == ACCELERATION]
    assert f"at the {'end' if at_end else 'start'}, t = {instant:.4f} s" in rest.message
    assert (rest.limit, rest.value) == (0, pytest.approx(velocity))
    # From one command to the next, since the arm stands still before and after.
    assert abs(jump.value) == pytest.approx(velocity / 1e-3, rel=0.01)
    assert jump.time == pytest.approx(instant, abs=1.5e-3)


def test_an_end_with_acceleration_alone_aborts(panda):
    """At rest, but still pushed: a parabola that begins at its tip."""
    coefficients = np.zeros((3, 1, 7))
    coefficients[:, 0] = np.array([0.01, 0.0, 0.0])[:, None] + [[0.0], [0.0], [1.0]] * START
    tip = JointTrajectory(panda.joint_names, [0, 1.0], coefficients)
    errors = {each.error for each in judged_by_franka("fer", panda, tip, FER).findings}
    assert JERK in errors
    assert refusals(panda, tip, FER)[JERK].value == pytest.approx(0.02)


def test_near_its_end_the_fr3_is_slower(panda):
    """The second joint moves at up to 1.3 rad/s where the formula allows less."""
    high = START.copy()
    high[1] = 1.2
    slow = turning(panda, 0.5, 0.7, joint=1, start=high)
    result = refusals(panda, slow, FR3)[VELOCITY]
    q = float(slow.position(result.time - 1e-3)[1])
    assert result.limit == pytest.approx(-0.2 + np.sqrt(5.17 * (1.7918 - q)), rel=1e-6)
    assert VELOCITY not in refusals(panda, turning(panda, -0.5, 0.7, joint=1, start=high), FR3)


def test_torques_and_the_tool_are_noted_and_abort_nothing(panda):
    weak = replace(limited(FREE, effort=1.0, effort_rate=1e-3), tool_rates=(1e-3,) * 3)
    verdict = judged_by_franka("fer", panda, turning(panda, 0.5, 2.0), weak)
    assert verdict.accepted
    assert {each.effect for each in verdict.findings} == {Effect.NOTED}
    words = " ".join(each.message for each in verdict.findings)
    for quantity in ("torque ", "torque rate", "tool speed", "tool acceleration", "tool jerk"):
        assert quantity in words
    effort = verdict.findings[0]
    index = panda.joint_names.index(effort.joint)
    sample = turning(panda, 0.5, 2.0).at(np.array([effort.time]))
    known = panda.inverse_dynamics(sample.position, sample.velocity, sample.acceleration)
    assert effort.value == pytest.approx(known[0, index])


def test_joints_may_come_in_any_order(panda):
    motion = turning(panda, 0.9, 0.1)
    other = motion.reordered(panda.joint_names[::-1])
    assert judged_by_franka("fer", panda, other, FER) == judged_by_franka("fer", panda, motion, FER)
    reordered = load_robot("example:panda", "panda_hand_tcp", joints=panda.joint_names[::-1])
    findings = [
        [(each.error, each.joint) for each in judged_by_franka("fer", arm, motion, FER).findings]
        for arm in (reordered, panda)
    ]
    assert findings[0] == findings[1]


def test_an_arm_with_six_joints_is_no_panda(ur5):
    motion = JointTrajectory(ur5.joint_names, [0, 1.0], np.zeros((1, 1, 6)))
    with pytest.raises(OptionError, match="has 7 joints; the problem plans 6"):
        judged_by_franka("fer", ur5, motion, FER)
