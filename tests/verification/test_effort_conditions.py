"""Conditions on efforts: limits, torque-speed lines, rates."""

from dataclasses import replace

import numpy as np
import pytest
from cases import INERTIA, PEAK_JERK, anywhere, changed, one_joint, quintic, unlimited, with_motors
from directed_samples import random_motion, random_motors, worst_curve_use, worst_use

from tubeplanner import JointTrajectory, LimitOverrides, Tolerance, load_robot, verify
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.robot.effort_rate import effort_rate
from tubeplanner.verification.conditions import JUDGED
from tubeplanner.verification.friction_jumps import friction_jumps
from tubeplanner.verification.judged import effort_rate as module
from tubeplanner.verification.judged_motion import JudgedMotion

# Efforts beyond their limits: found with joint and time, the margin on the safe side.


def test_two_parts_in_a_thousand_of_effort_are_found_with_joint_and_time(stored):
    """A motor that is weaker by 0.2 %, under a trajectory that uses all of it."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    tau = effort_shares(problem.robot, trajectory)
    joint = problem.robot.joint_names[int(tau.max(axis=0).argmax())]
    weak = LimitOverrides(
        velocity=unlimited().velocity,
        effort={joint: 0.998 * problem.robot.limits.effort[int(tau.max(axis=0).argmax())]},
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=weak)
    certificate = verify(changed(problem, robot=robot), trajectory)
    assert certificate.failures() == ["effort"]
    condition = certificate.conditions["effort"]
    assert condition.margin == pytest.approx(1 - 1 / 0.998, abs=1e-6)
    assert condition.where.joint == joint
    t = np.linspace(0, trajectory.duration, len(tau))
    assert condition.where.time == pytest.approx(t[tau.max(axis=1).argmax()], abs=1e-3)


def effort_shares(robot, trajectory, count=20_001):
    s = trajectory.at(np.linspace(0, trajectory.duration, count))
    return abs(robot.inverse_dynamics(s.position, s.velocity, s.acceleration)) / robot.limits.effort


def test_the_error_of_an_enclosure_is_taken_off_the_margin(stored, monkeypatch):
    """Polynomials that miss a hundredth: the margin is then a hundredth on the safe side."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    exact = verify(problem, trajectory).conditions["effort"].margin
    monkeypatch.setattr("tubeplanner.verification.judged_motion.EFFORT_ENCLOSURE", 1e-2)
    rough = verify(problem, trajectory).conditions["effort"].margin
    assert exact - 2e-2 < rough < exact - 1e-6


def test_an_undecided_effort_tells_what_was_found(stored, monkeypatch):
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    monkeypatch.setattr("tubeplanner.verification.enclosure._MAX_INTERVALS", 1)
    condition = verify(problem, trajectory).conditions["effort"]
    found = float(condition.coverage.removeprefix("for all t, undecided: the margin found is ")
                  .removesuffix(" relative"))  # fmt: skip
    assert found == pytest.approx(0.0, abs=0.1)
    assert condition.margin < found


# Efforts with friction and limits that differ: closed forms of a bar, dense samples of arms.


VISCOUS, BACK, FORTH, LARGEST = 0.8, 0.9, 0.3, 5.0
FRICTION = {"backwards_friction": BACK, "forwards_friction": FORTH}
ALL = {"viscous_friction": VISCOUS, **FRICTION}


def judged(robot, trajectory):
    return JUDGED["effort"](JudgedMotion(anywhere(robot), trajectory, Tolerance()))


def course(powers, *more, width=1.0):
    """Return a joint's motion by polynomials of the time in each piece, highest power first."""
    rows = np.array([powers, *more]).T[:, :, None]
    return JointTrajectory(["turn"], width * np.arange(1 + rows.shape[1]), rows)


@pytest.fixture
def bar(tmp_path):
    """A bar of known inertia without weight, with motors."""

    def moved(mass=0.0, effort=LARGEST, **motors):
        return with_motors(one_joint(tmp_path, mass, effort=effort, velocity=1e3), **motors)

    return moved


@pytest.mark.parametrize("velocity", [1.5, -1.5])
def test_friction_is_that_of_the_direction(bar, velocity):
    condition = judged(bar(**ALL), course([velocity, 0.2]))
    needed = VISCOUS * 1.5 + (FORTH if velocity > 0 else BACK)
    assert condition.margin == pytest.approx(1 - needed / LARGEST, abs=1e-8)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")
    assert condition.where.joint == "turn"


@pytest.mark.parametrize("acceleration", [3.0, -3.0])
def test_both_sides_of_a_reversal_count(bar, acceleration):
    """It slows down, reverses at 0.371 s between all looks, and goes back no faster."""
    at = 0.371
    condition = judged(bar(**FRICTION), course([acceleration / 2, -acceleration * at, 0.0]))
    before, after = (-BACK, FORTH) if acceleration > 0 else (FORTH, -BACK)
    needed = max(abs(INERTIA * acceleration + dry) for dry in (before, after))
    assert condition.margin == pytest.approx(1 - needed / LARGEST, abs=1e-8)
    late = abs(INERTIA * acceleration + after) > abs(INERTIA * acceleration + before)
    assert (condition.where.time >= at - 1e-9) == late


def test_the_worst_may_be_at_the_reversal_alone(bar):
    """Its acceleration is the largest there: 2 rad/s^2, and falls on either side."""
    at = 0.371
    v = np.poly1d([-1.0, 0.0, 2.0, 0.0])  # of the time from the reversal
    q = np.polyint(v)(np.poly1d([1.0, -at])).coeffs
    for back, forth, side in ((BACK, FORTH, FORTH), (0.1, 2.0, 2.0)):
        motors = {"backwards_friction": back, "forwards_friction": forth}
        condition = judged(bar(**motors), course(q))
        assert condition.margin == pytest.approx(1 - (INERTIA * 2 + side) / LARGEST, abs=1e-8)
        assert condition.where.time == pytest.approx(at, abs=1e-4)


def test_a_short_way_back_is_found(bar):
    """For two milliseconds it moves backwards."""
    v = np.poly1d([0.4, 0.4]) * 0 + np.poly1d([1.0, -0.3]) * np.poly1d([1.0, -0.302])
    motion = course(np.polyint(v).coeffs)
    back = judged(bar(backwards_friction=4.0), motion)
    assert back.margin == pytest.approx(1 - (4.0 + INERTIA * 0.002) / LARGEST, abs=1e-8)
    assert back.where.time == pytest.approx(0.3, abs=1e-6)


@pytest.mark.parametrize("at", [0.5, 0.371])
def test_a_joint_that_stops_and_goes_on_has_the_friction_of_its_way(bar, at):
    """Its velocity touches zero and does not change its sign: nothing is backwards."""
    v = np.poly1d([1.0, -2 * at, at**2])
    motion = course(np.polyint(v).coeffs)
    assert judged(bar(backwards_friction=LARGEST), motion).margin == pytest.approx(
        1 - 2 * INERTIA * max(at, 1 - at) / LARGEST, abs=1e-7
    )
    forth = judged(bar(forwards_friction=1.0), motion)
    assert forth.margin == pytest.approx(1 - (1.0 + 2 * INERTIA * (1 - at)) / LARGEST, abs=1e-8)


def test_a_joint_that_stands_still_has_its_load_alone(bar):
    """Gravity loads it by m g l; friction could hold it as well as not."""
    weight = 0.5 * 9.81 * 0.5
    still = bar(mass=0.5, **{name: 100.0 for name in FRICTION})
    assert judged(still, course([0.0, 0.0])).margin == pytest.approx(1 - weight / LARGEST, abs=1e-8)


def test_at_start_and_goal_the_direction_of_the_motion_counts(bar):
    """Backwards from rest and to rest: all effort is that of the largest acceleration."""
    motion = course([2.0, -3.0, 0.0, 0.0])  # its acceleration is -6 rad/s^2 at first, then 6
    for back, forth, when in ((0.4, 3.0, 0.0), (0.0, 3.0, None)):
        robot = bar(backwards_friction=back, forwards_friction=forth, effort=8.0)
        condition = judged(robot, motion)
        assert condition.margin == pytest.approx(1 - (6 * INERTIA + back) / 8.0, abs=1e-8)
        assert when is None or condition.where.time == pytest.approx(when, abs=1e-6)


def test_across_breakpoints_each_piece_has_its_direction(bar):
    condition = judged(bar(**FRICTION), course([1.0, 0.0], [-1.0, 1.0], [1.0, 0.0], width=0.5))
    assert condition.margin == pytest.approx(1 - BACK / LARGEST, abs=1e-8)
    assert 0.5 <= condition.where.time <= 1.0


@pytest.mark.parametrize("share", [0.0, 0.25])
@pytest.mark.parametrize("drives", [True, False])
def test_uncertain_friction_is_the_worst_it_may_be(bar, drives, share):
    """More where it adds to the effort, less where it helps to brake."""
    acceleration = 2.0 if drives else -4.0
    motion = course([acceleration / 2, 3.0, 0.0], width=0.1)
    v = 3.0 + (0.1 * acceleration if drives else 0.0)
    friction = VISCOUS * (v if drives else 3.0 - 0.4) + FORTH
    way = 1 if drives else -1
    most = way * (INERTIA * acceleration + friction) + share * friction
    condition = judged(bar(**ALL, friction_uncertainty=share, effort=9.0), motion)
    assert condition.margin == pytest.approx(1 - most / 9.0, abs=1e-8)
    assert condition.where.time == pytest.approx(0.1, abs=1e-6)


def test_viscous_friction_alone_may_be_uncertain(bar):
    condition = judged(bar(viscous_friction=VISCOUS, friction_uncertainty=0.5), course([-2.0, 0.0]))
    assert condition.margin == pytest.approx(1 - 1.5 * VISCOUS * 2 / LARGEST, abs=1e-8)


@pytest.mark.parametrize(("velocity", "side"), [(1.0, FORTH), (1.0, 3.5), (-1.0, BACK)])
def test_limits_may_differ_by_the_efforts_sign(bar, velocity, side):
    """Margins are relative to the larger one."""
    pair = EffortRange(0, np.zeros(1), np.array([2.0]), np.array([4.0]))
    friction = {"backwards_friction": side, "forwards_friction": side}
    condition = judged(bar(**friction, effort_ranges=[pair]), course([velocity, 0.0]))
    forwards, backwards = (4.0 - side, 2.0 + side) if velocity > 0 else (4.0 + side, 2.0 - side)
    assert condition.margin == pytest.approx(min(forwards, backwards) / 4.0, abs=1e-8)


@pytest.mark.parametrize("velocity", [1.0, -1.0])
def test_a_table_is_kept_between_its_corners(bar, velocity):
    """What is left is the least at a corner of the table that the joint passes inside a piece."""
    table = EffortRange(
        0, np.array([-0.3, 0.123, 0.4]), np.array([3.0, 1.0, 2.0]), np.array([2.0, 1.5, 4.0])
    )
    robot = bar(**FRICTION, effort_ranges=[table])
    condition = judged(robot, course([velocity, -0.5 * velocity]))
    least = 1.5 - FORTH if velocity > 0 else 1.0 - BACK
    assert condition.margin == pytest.approx(least / 4.0, abs=1e-8)
    at = 0.5 + 0.123 * velocity
    assert condition.where.time == pytest.approx(at, abs=1e-6)


def test_beyond_its_ends_a_table_goes_on(bar):
    table = EffortRange(0, np.array([0.0, 0.2]), np.array([9.0, 9.0]), np.array([1.0, 3.0]))
    robot = bar(**FRICTION, effort_ranges=[table])
    assert judged(robot, course([0.1, -0.5])).margin == pytest.approx((1.0 - FORTH) / 9, abs=1e-8)
    assert judged(robot, course([0.1, 0.5])).margin == pytest.approx((3.0 - FORTH) / 9, abs=1e-8)


def test_a_table_without_friction_is_kept_too(bar):
    table = EffortRange(0, np.array([0.0, 1.0]), np.array([6.0, 6.0]), np.array([4.0, 2.0]))
    condition = judged(bar(effort_ranges=[table]), course([2.0, 0.0, 0.0]))
    assert condition.margin == pytest.approx((2.0 - 4 * INERTIA) / 6.0, abs=1e-8)


def test_the_judge_finds_two_parts_in_a_thousand_of_friction(tmp_path, bar):
    motion = course([1.0, 0.0])
    exact = bar(forwards_friction=LARGEST)
    assert "effort" not in verify(anywhere(exact), motion).failures()
    more = bar(forwards_friction=1.002 * LARGEST)
    assert verify(anywhere(more), motion).failures()[0] == "effort"


@pytest.mark.parametrize("seed", range(6))
def test_no_sample_needs_more_and_one_as_much(request, seed):
    """Arms with random motors, on random motions with reversals and breakpoints that jump."""
    robot = request.getfixturevalue(["two_link", "slide", "ur5"][seed % 3])
    rng = np.random.default_rng(seed)
    arm, motion = random_motors(robot, rng), random_motion(robot, rng)
    condition = judged(arm, motion)
    sampled = 1 - worst_use(arm, motion)
    assert sampled - 1e-6 <= condition.margin <= sampled + 1e-9
    assert condition.coverage == "for all t"


def test_joints_with_and_without_friction_are_held_against_their_own(ur5):
    """Friction of one joint alone: what the others use is as it was, to the last bit."""
    rng = np.random.default_rng(3)
    motion = random_motion(ur5, rng)
    plain = judged(ur5, motion)
    other = 5 if plain.where.joint != ur5.joint_names[5] else 4
    dry = np.zeros(6)
    dry[other] = 1e-6
    assert judged(with_motors(ur5, forwards_friction=dry), motion) == plain
    dry[other] = 1e6
    assert (
        judged(with_motors(ur5, forwards_friction=dry), motion).where.joint
        == (ur5.joint_names[other])
    )


def test_a_joint_without_a_limit_is_not_asked(ur5):
    """However much friction it has."""
    limits, dry = ur5.limits.effort.copy(), np.zeros(6)
    limits[2], dry[2], dry[3] = np.inf, 1e6, 500.0
    rubbing = with_motors(ur5, forwards_friction=dry)
    robot = rubbing.with_limits(replace(rubbing.limits, effort=limits), rubbing.motors)
    condition = judged(robot, random_motion(ur5, np.random.default_rng(3)))
    assert condition.where.joint == ur5.joint_names[3]
    assert condition.margin == pytest.approx(1 - 500.0 / limits[3], abs=3.0)


def test_the_error_of_the_enclosure_is_taken_off_and_told(bar, monkeypatch):
    robot, motion = bar(mass=0.5, **FRICTION), course([3.0, -1.0, 0.0])
    exact = judged(robot, motion)
    monkeypatch.setattr("tubeplanner.verification.enclosure._MAX_INTERVALS", 1)
    rough = judged(robot, motion)
    assert rough.margin < exact.margin - 1e-9
    assert "undecided: the margin found is" in rough.coverage
    found = float(rough.coverage.split("found is ")[1].removesuffix(" relative"))
    assert found == pytest.approx(exact.margin, abs=0.02)


# Torque-speed lines: closed forms of a bar that turns, dense samples of arms.


STALL, FASTEST = 6.0, 10.0


def motor_curve_judged(robot, trajectory):
    return JUDGED["motor_curve"](JudgedMotion(anywhere(robot), trajectory, Tolerance()))


def motor_curve_course(powers, width=1.0):
    return JointTrajectory(["turn"], [0, width], np.array(powers)[:, None, None])


@pytest.fixture
def motor_curve_bar(tmp_path):
    def moved(effort=np.inf, **motors):
        curve = {"saturation_effort": STALL, "no_load_velocity": FASTEST}
        return with_motors(one_joint(tmp_path, effort=effort, velocity=1e3), **{**curve, **motors})

    return moved


@pytest.mark.parametrize("way", [1, -1])
def test_a_motor_that_drives_has_less_the_faster_it_is(motor_curve_bar, way):
    """From 1 to 4 rad/s in a second: the end decides."""
    condition = motor_curve_judged(
        motor_curve_bar(), motor_curve_course([way * 1.5, way * 1.0, 0.0])
    )
    assert condition.margin == pytest.approx(1 - 3 * INERTIA / STALL - 0.4, abs=1e-8)
    assert condition.where.joint == "turn"
    assert condition.where.time == pytest.approx(1.0, abs=1e-6)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")


@pytest.mark.parametrize("way", [1, -1])
def test_a_motor_that_brakes_has_more_than_its_stall_effort(motor_curve_bar, way):
    """From 9 to 8 rad/s within 0.1 s: 7 N m of braking."""
    condition = motor_curve_judged(
        motor_curve_bar(), motor_curve_course([way * -5.0, way * 9.0, 0.0], 0.1)
    )
    braking = 1 - (7.0 / STALL - 0.8)
    driving = 1 - (0.9 - 7.0 / STALL)
    assert condition.margin == pytest.approx(min(braking, driving), abs=1e-8)
    assert condition.margin > 0


@pytest.mark.parametrize("way", [1, -1])
def test_friction_counts_and_its_uncertainty(motor_curve_bar, way):
    motors = {"viscous_friction": 0.2, "forwards_friction": 0.7, "backwards_friction": 1.1}
    condition = motor_curve_judged(
        motor_curve_bar(**motors, friction_uncertainty=0.1), motor_curve_course([way * 4.0, 0.0])
    )
    friction = 0.2 * 4 + (0.7 if way > 0 else 1.1)
    assert condition.margin == pytest.approx(1 - 1.1 * friction / STALL - 0.4, abs=1e-8)


@pytest.mark.parametrize("share", [1 - 1e-5, 1 + 1e-5])
def test_a_line_that_is_touched_between_samples_decides(motor_curve_bar, share):
    """A bump of the velocity; the line is touched where its effort falls and velocity rises."""
    q = np.polyint(np.poly1d([16.0, -32.0, 16.0, 0.0, 1.0])).coeffs  # v = 1 + (4 t (1 - t))^2
    t = np.linspace(0, 1, 1_000_001)
    used = (
        INERTIA * np.polyval(np.polyder(q, 2), t) / STALL + np.polyval(np.polyder(q), t) / FASTEST
    )
    line = {"saturation_effort": STALL * used.max() * share}
    line["no_load_velocity"] = FASTEST * used.max() * share
    condition = motor_curve_judged(motor_curve_bar(**line), motor_curve_course(q))
    assert condition.margin == pytest.approx(1 - 1 / share, abs=1e-8)
    assert condition.where.time == pytest.approx(t[used.argmax()], abs=1e-3)
    failures = verify(anywhere(motor_curve_bar(**line)), motor_curve_course(q)).failures()
    assert ("motor_curve" in failures) == (share < 1)


def test_effort_limits_still_cap_it(motor_curve_bar):
    """The line has what it takes; the motor does not."""
    robot, motion = motor_curve_bar(effort=2.0), motor_curve_course([2.0, 0.0, 0.0], 0.1)
    certificate = verify(anywhere(robot), motion)
    assert certificate.conditions["effort"].margin == pytest.approx(1 - 4 * INERTIA / 2.0, abs=1e-8)
    assert certificate.conditions["motor_curve"].margin > 0


def test_only_joints_with_a_line_are_asked(ur5):
    rng = np.random.default_rng(0)
    motion = random_motion(ur5, rng)
    saturation, fastest = np.full((2, 6), np.inf)
    saturation[3], fastest[3] = 30.0, 5.0
    arm = with_motors(ur5, saturation_effort=saturation, no_load_velocity=fastest)
    condition = motor_curve_judged(arm, motion)
    assert condition.where.joint == ur5.joint_names[3]
    at = np.linspace(0, motion.duration, 5000)
    states = motion.at(at)
    effort = arm.inverse_dynamics(states.position, states.velocity, states.acceleration)[:, 3]
    used = max((way * (effort / 30 + states.velocity[:, 3] / 5)).max() for way in (1, -1))
    assert condition.margin == pytest.approx(1 - used, abs=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_no_sample_uses_more_and_one_as_much(request, seed):
    robot = request.getfixturevalue(["two_link", "slide", "ur5"][seed])
    rng = np.random.default_rng(10 + seed)
    arm, motion = random_motors(robot, rng), random_motion(robot, rng)
    condition = motor_curve_judged(arm, motion)
    sampled = 1 - worst_curve_use(arm, motion)
    assert sampled - 1e-6 <= condition.margin <= sampled + 1e-9


def test_without_a_line_it_is_not_required(tmp_path):
    condition = motor_curve_judged(
        with_motors(one_joint(tmp_path), forwards_friction=1.0), motor_curve_course([1.0, 0.0])
    )
    assert (condition.margin, condition.coverage) == (None, "no motor has a torque-speed line")


def test_the_error_of_the_enclosure_is_told(tmp_path, monkeypatch):
    curve = {"saturation_effort": STALL, "no_load_velocity": FASTEST}
    robot = with_motors(one_joint(tmp_path, mass=0.5, effort=np.inf), **curve)
    motion = motor_curve_course([3.0, -1.0, 0.0])
    exact = motor_curve_judged(robot, motion)
    monkeypatch.setattr("tubeplanner.verification.enclosure._MAX_INTERVALS", 1)
    rough = motor_curve_judged(robot, motion)
    assert rough.margin < exact.margin - 1e-9
    assert "undecided" in rough.coverage


# How often and how far Coulomb friction jumps, in words.


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


# How fast efforts change: closed forms, breakpoints, defects that only samples between show.


def rate_judged(problem, trajectory):
    motion = JudgedMotion(problem, trajectory, Tolerance())
    return JUDGED["effort_rate"](motion)


def rate_bar(tmp_path, rate, mass=0.0):
    return anywhere(one_joint(tmp_path, mass, velocity=1e3, effort=np.inf, effort_rate=rate))


@pytest.mark.parametrize("share", [0.5, 1 - 2e-6, 1 + 2e-6, 3.0])
def test_the_margin_is_what_the_largest_jerk_leaves(tmp_path, share):
    """Without gravity the rate is inertia times jerk, 60 rad/s^3 at both ends of the quintic."""
    problem = rate_bar(tmp_path, share * INERTIA * PEAK_JERK)
    condition = rate_judged(problem, quintic(1.0))
    assert condition.margin == pytest.approx(1 - 1 / share, abs=2e-8 / share)
    assert condition.where.joint == "turn"
    assert min(condition.where.time, 1 - condition.where.time) == pytest.approx(0.0, abs=1e-6)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")
    assert ("effort_rate" in verify(problem, quintic(1.0)).failures()) == (share < 1)


def test_a_pendulums_own_weight_counts(tmp_path):
    """Turned uniformly, its effort is m g l cos(q): the rate is the largest where it is upright."""
    speed, largest = 2.0, 0.5 * 9.81 * 0.5 * 2.0
    trajectory = JointTrajectory(["turn"], [0, 1.5], [[[speed]], [[0.1]]])
    condition = rate_judged(rate_bar(tmp_path, 1.25 * largest, mass=0.5), trajectory)
    assert condition.margin == pytest.approx(0.2, abs=2e-8)
    assert condition.where.time == pytest.approx((np.pi / 2 - 0.1) / speed, abs=1e-3)


@pytest.mark.parametrize("early", [True, False])
def test_both_sides_of_a_breakpoint_are_judged(tmp_path, early):
    """The jerk jumps there: from 6 to 2 rad/s^3, or the other way."""
    first, second = (1.0, 1 / 3) if early else (1 / 3, 1.0)
    width = 0.5
    q, v, a = first * width**3, 3 * first * width**2, 6 * first * width
    rows = np.array([[first, second], [0.0, a / 2], [0.0, v], [0.0, q]])[:, :, None]
    trajectory = JointTrajectory(["turn"], [0, width, 2 * width], rows)
    condition = rate_judged(rate_bar(tmp_path, INERTIA * 7), trajectory)
    assert condition.margin == pytest.approx(1 / 7, abs=2e-8)
    assert (condition.where.time <= width) == early


def test_two_parts_in_a_thousand_are_found_with_joint_and_time(stored):
    """A motor that may change its effort less by 0.2 % than a trajectory does, at one instant."""
    problem, trajectory = stored("two_link/around_a_post", "branch-and-bound")
    pieces, local = len(trajectory.widths), np.linspace(0, 1, 5001)
    piece = np.repeat(np.arange(pieces), len(local))
    local = (local * trajectory.widths[:, None]).ravel()
    states = (trajectory.within(piece, local, order) for order in range(4))
    rates = abs(effort_rate(problem.robot, *states))
    row, joint = np.unravel_index(rates.argmax(), rates.shape)
    name = problem.robot.joint_names[joint]
    velocity = dict.fromkeys(problem.robot.joint_names, np.inf)
    limits = LimitOverrides(velocity=velocity, effort_rate={name: 0.998 * rates[row, joint]})
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    certificate = verify(changed(problem, robot=robot), trajectory)
    assert certificate.failures() == ["effort_rate"]
    condition = certificate.conditions["effort_rate"]
    assert condition.margin == pytest.approx(1 - 1 / 0.998, abs=1e-6)
    assert condition.where.joint == name
    time = trajectory.breakpoints[piece[row]] + local[row]
    assert condition.where.time == pytest.approx(time, abs=1e-3)


def test_a_bump_between_samples_is_found():
    """A fifth beyond the limit within a millisecond alone, of a motion at 0.3 rad/s."""
    limits = LimitOverrides(effort_rate={"joint2": 50.0})
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    times, width = np.array([0.0, 0.5, 0.501, 1.0]), 1e-3
    rows = np.zeros((7, 3, 2))
    rows[-2], rows[-1] = 0.3, 0.3 * times[:3, None]
    problem = anywhere(robot)
    assert rate_judged(problem, JointTrajectory(robot.joint_names, times, rows)).margin > 0.9
    share = np.poly1d([1.0, 0.0])
    bump = ((share * (1 - share)) ** 3).coeffs / width ** np.arange(6, -1, -1)
    still = np.zeros((1, 2))
    inertia = robot.inverse_dynamics_derivatives(0.3 * times[1:2, None] + still, still, still)[2]
    size = 1.2 * 50.0 / (6 / width**3 * inertia[0, 1, 1])  # its jerk is the largest at its ends
    rows[:, 1, 1] += size * bump
    condition = rate_judged(problem, JointTrajectory(robot.joint_names, times, rows))
    assert condition.margin == pytest.approx(-0.2, abs=0.01)
    assert condition.where.joint == "joint2"
    assert 0.5 <= condition.where.time <= 0.501


def test_without_a_limit_it_is_not_required(tmp_path):
    condition = rate_judged(anywhere(one_joint(tmp_path)), quintic())
    assert (condition.margin, condition.coverage) == (None, "no joint has this limit")


def test_the_error_of_the_enclosure_is_taken_off_the_margin(tmp_path, monkeypatch):
    problem = rate_bar(tmp_path, 20.0, mass=0.5)
    exact = rate_judged(problem, quintic(3.0, 1.5)).margin
    monkeypatch.setattr(module, "_RATE_ENCLOSURE", 1e-2)
    rough = rate_judged(problem, quintic(3.0, 1.5)).margin
    assert exact - 2.1e-2 < rough < exact - 1e-7


def test_an_undecided_rate_tells_what_was_found(tmp_path, monkeypatch):
    problem = rate_bar(tmp_path, 20.0, mass=0.5)
    exact = rate_judged(problem, quintic(3.0, 1.5))
    monkeypatch.setattr("tubeplanner.verification.enclosure._MAX_INTERVALS", 1)
    condition = rate_judged(problem, quintic(3.0, 1.5))
    assert exact.coverage == "for all t"
    assert condition.coverage.startswith("for all t, undecided: the margin found is ")
    assert condition.margin < exact.margin


def test_viscous_friction_and_rotors_count(tmp_path):
    """At constant jerk j: (I + J) j + d a, the largest at the end."""
    robot = with_motors(
        one_joint(tmp_path, velocity=1e3, effort=np.inf, effort_rate=20.0),
        armature=0.3,
        viscous_friction=0.8,
    )
    motion = JointTrajectory(["turn"], [0, 1.5], np.array([0.5, 0, 0.2, 0])[:, None, None])
    condition = rate_judged(anywhere(robot), motion)
    assert condition.margin == pytest.approx(1 - (3 * (INERTIA + 0.3) + 0.8 * 4.5) / 20, abs=2e-8)
    assert condition.coverage == "for all t"


def test_jumps_of_coulomb_friction_are_told_apart(tmp_path):
    """They change nothing but the coverage."""
    plain = one_joint(tmp_path, velocity=1e3, effort=np.inf, effort_rate=20.0)
    robot = with_motors(plain, backwards_friction=1.25, forwards_friction=0.5)
    v = np.poly1d([1.0, -0.2]) * np.poly1d([1.0, -0.7])
    motion = JointTrajectory(["turn"], [0, 1.0], np.polyint(v).coeffs[:, None, None])
    condition = rate_judged(anywhere(robot), motion)
    assert condition.margin == rate_judged(anywhere(plain), motion).margin
    assert condition.coverage == (
        "for all t; Coulomb friction, which is apart, jumps at 2 reversals, by at most 1.75 N m "
        "(turn, t = 0.2000 s)"
    )


def test_friction_of_joints_without_this_limit_is_not_told(ur5):
    robot = with_motors(ur5, forwards_friction=1.0)
    rates = replace(robot.limits, effort_rate=np.full(6, np.inf))
    rates.effort_rate[2] = 1e4
    rows = np.zeros((3, 1, 6))
    rows[:2, 0, 1] = 1.0, -0.5
    motion = JointTrajectory(ur5.joint_names, [0, 1.0], rows)
    condition = rate_judged(anywhere(robot.with_limits(rates, robot.motors)), motion)
    assert condition.coverage.endswith("; Coulomb friction does not jump: no joint reverses")
