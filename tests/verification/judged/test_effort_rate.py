"""How fast efforts change: closed forms, breakpoints, defects that only samples between show."""

from dataclasses import replace

import numpy as np
import pytest

from cases import INERTIA, PEAK_JERK, anywhere, changed, one_joint, quintic, with_motors
from tubeplanner import JointTrajectory, LimitOverrides, Tolerance, load_robot, verify
from tubeplanner.robot.effort_rate import effort_rate
from tubeplanner.verification.conditions import JUDGED
from tubeplanner.verification.judged import effort_rate as module
from tubeplanner.verification.judged_motion import JudgedMotion


def judged(problem, trajectory):
    motion = JudgedMotion(problem, trajectory, Tolerance())
    return JUDGED["effort_rate"](motion)


def bar(tmp_path, rate, mass=0.0):
    return anywhere(one_joint(tmp_path, mass, velocity=1e3, effort=np.inf, effort_rate=rate))


@pytest.mark.parametrize("share", [0.5, 1 - 2e-6, 1 + 2e-6, 3.0])
def test_the_margin_is_what_the_largest_jerk_leaves(tmp_path, share):
    """Without gravity the rate is inertia times jerk, 60 rad/s^3 at both ends of the quintic."""
    problem = bar(tmp_path, share * INERTIA * PEAK_JERK)
    condition = judged(problem, quintic(1.0))
    assert condition.margin == pytest.approx(1 - 1 / share, abs=2e-8 / share)
    assert condition.where.joint == "turn"
    assert min(condition.where.time, 1 - condition.where.time) == pytest.approx(0.0, abs=1e-6)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")
    assert ("effort_rate" in verify(problem, quintic(1.0)).failures()) == (share < 1)


def test_a_pendulums_own_weight_counts(tmp_path):
    """Turned uniformly, its effort is m g l cos(q): the rate is the largest where it is upright."""
    speed, largest = 2.0, 0.5 * 9.81 * 0.5 * 2.0
    trajectory = JointTrajectory(["turn"], [0, 1.5], [[[speed]], [[0.1]]])
    condition = judged(bar(tmp_path, 1.25 * largest, mass=0.5), trajectory)
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
    condition = judged(bar(tmp_path, INERTIA * 7), trajectory)
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
    assert judged(problem, JointTrajectory(robot.joint_names, times, rows)).margin > 0.9
    share = np.poly1d([1.0, 0.0])
    bump = ((share * (1 - share)) ** 3).coeffs / width ** np.arange(6, -1, -1)
    still = np.zeros((1, 2))
    inertia = robot.inverse_dynamics_derivatives(0.3 * times[1:2, None] + still, still, still)[2]
    size = 1.2 * 50.0 / (6 / width**3 * inertia[0, 1, 1])  # its jerk is the largest at its ends
    rows[:, 1, 1] += size * bump
    condition = judged(problem, JointTrajectory(robot.joint_names, times, rows))
    assert condition.margin == pytest.approx(-0.2, abs=0.01)
    assert condition.where.joint == "joint2"
    assert 0.5 <= condition.where.time <= 0.501


def test_without_a_limit_it_is_not_required(tmp_path):
    condition = judged(anywhere(one_joint(tmp_path)), quintic())
    assert (condition.margin, condition.coverage) == (None, "no joint has this limit")


def test_the_error_of_the_enclosure_is_taken_off_the_margin(tmp_path, monkeypatch):
    problem = bar(tmp_path, 20.0, mass=0.5)
    exact = judged(problem, quintic(3.0, 1.5)).margin
    monkeypatch.setattr(module, "_RATE_ENCLOSURE", 1e-2)
    rough = judged(problem, quintic(3.0, 1.5)).margin
    assert exact - 2.1e-2 < rough < exact - 1e-7


def test_an_undecided_rate_tells_what_was_found(tmp_path, monkeypatch):
    problem = bar(tmp_path, 20.0, mass=0.5)
    exact = judged(problem, quintic(3.0, 1.5))
    monkeypatch.setattr("tubeplanner.verification.enclosure._MAX_INTERVALS", 1)
    condition = judged(problem, quintic(3.0, 1.5))
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
    condition = judged(anywhere(robot), motion)
    assert condition.margin == pytest.approx(1 - (3 * (INERTIA + 0.3) + 0.8 * 4.5) / 20, abs=2e-8)
    assert condition.coverage == "for all t"


def test_jumps_of_coulomb_friction_are_told_apart(tmp_path):
    """They change nothing but the coverage."""
    plain = one_joint(tmp_path, velocity=1e3, effort=np.inf, effort_rate=20.0)
    robot = with_motors(plain, backwards_friction=1.25, forwards_friction=0.5)
    v = np.poly1d([1.0, -0.2]) * np.poly1d([1.0, -0.7])
    motion = JointTrajectory(["turn"], [0, 1.0], np.polyint(v).coeffs[:, None, None])
    condition = judged(anywhere(robot), motion)
    assert condition.margin == judged(anywhere(plain), motion).margin
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
    condition = judged(anywhere(robot.with_limits(rates, robot.motors)), motion)
    assert condition.coverage.endswith("; Coulomb friction does not jump: no joint reverses")
