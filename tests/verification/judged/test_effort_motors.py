"""Efforts with friction and limits that differ: closed forms of a bar, dense samples of arms."""

from dataclasses import replace

import numpy as np
import pytest

from cases import INERTIA, anywhere, one_joint, with_motors
from directed_samples import random_motion, random_motors, worst_use
from tubeplanner import JointTrajectory, Tolerance, verify
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.verification.conditions import JUDGED
from tubeplanner.verification.judged_motion import JudgedMotion

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
