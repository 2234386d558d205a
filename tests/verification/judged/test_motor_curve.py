"""Torque-speed lines: closed forms of a bar that turns, dense samples of arms."""

import numpy as np
import pytest

from cases import INERTIA, anywhere, one_joint, with_motors
from directed_samples import random_motion, random_motors, worst_curve_use
from tubeplanner import JointTrajectory, Tolerance, verify
from tubeplanner.verification.conditions import JUDGED
from tubeplanner.verification.judged_motion import JudgedMotion

STALL, FASTEST = 6.0, 10.0


def judged(robot, trajectory):
    return JUDGED["motor_curve"](JudgedMotion(anywhere(robot), trajectory, Tolerance()))


def course(powers, width=1.0):
    return JointTrajectory(["turn"], [0, width], np.array(powers)[:, None, None])


@pytest.fixture
def bar(tmp_path):
    def moved(effort=np.inf, **motors):
        curve = {"saturation_effort": STALL, "no_load_velocity": FASTEST}
        return with_motors(one_joint(tmp_path, effort=effort, velocity=1e3), **{**curve, **motors})

    return moved


@pytest.mark.parametrize("way", [1, -1])
def test_a_motor_that_drives_has_less_the_faster_it_is(bar, way):
    """From 1 to 4 rad/s in a second: the end decides."""
    condition = judged(bar(), course([way * 1.5, way * 1.0, 0.0]))
    assert condition.margin == pytest.approx(1 - 3 * INERTIA / STALL - 0.4, abs=1e-8)
    assert condition.where.joint == "turn"
    assert condition.where.time == pytest.approx(1.0, abs=1e-6)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")


@pytest.mark.parametrize("way", [1, -1])
def test_a_motor_that_brakes_has_more_than_its_stall_effort(bar, way):
    """From 9 to 8 rad/s within 0.1 s: 7 N m of braking."""
    condition = judged(bar(), course([way * -5.0, way * 9.0, 0.0], 0.1))
    braking = 1 - (7.0 / STALL - 0.8)
    driving = 1 - (0.9 - 7.0 / STALL)
    assert condition.margin == pytest.approx(min(braking, driving), abs=1e-8)
    assert condition.margin > 0


@pytest.mark.parametrize("way", [1, -1])
def test_friction_counts_and_its_uncertainty(bar, way):
    motors = {"viscous_friction": 0.2, "forwards_friction": 0.7, "backwards_friction": 1.1}
    condition = judged(bar(**motors, friction_uncertainty=0.1), course([way * 4.0, 0.0]))
    friction = 0.2 * 4 + (0.7 if way > 0 else 1.1)
    assert condition.margin == pytest.approx(1 - 1.1 * friction / STALL - 0.4, abs=1e-8)


@pytest.mark.parametrize("share", [1 - 1e-5, 1 + 1e-5])
def test_a_line_that_is_touched_between_samples_decides(bar, share):
    """A bump of the velocity; the line is touched where its effort falls and velocity rises."""
    q = np.polyint(np.poly1d([16.0, -32.0, 16.0, 0.0, 1.0])).coeffs  # v = 1 + (4 t (1 - t))^2
    t = np.linspace(0, 1, 1_000_001)
    used = (
        INERTIA * np.polyval(np.polyder(q, 2), t) / STALL + np.polyval(np.polyder(q), t) / FASTEST
    )
    line = {"saturation_effort": STALL * used.max() * share}
    line["no_load_velocity"] = FASTEST * used.max() * share
    condition = judged(bar(**line), course(q))
    assert condition.margin == pytest.approx(1 - 1 / share, abs=1e-8)
    assert condition.where.time == pytest.approx(t[used.argmax()], abs=1e-3)
    failures = verify(anywhere(bar(**line)), course(q)).failures()
    assert ("motor_curve" in failures) == (share < 1)


def test_effort_limits_still_cap_it(bar):
    """The line has what it takes; the motor does not."""
    robot, motion = bar(effort=2.0), course([2.0, 0.0, 0.0], 0.1)
    certificate = verify(anywhere(robot), motion)
    assert certificate.conditions["effort"].margin == pytest.approx(1 - 4 * INERTIA / 2.0, abs=1e-8)
    assert certificate.conditions["motor_curve"].margin > 0


def test_only_joints_with_a_line_are_asked(ur5):
    rng = np.random.default_rng(0)
    motion = random_motion(ur5, rng)
    saturation, fastest = np.full((2, 6), np.inf)
    saturation[3], fastest[3] = 30.0, 5.0
    arm = with_motors(ur5, saturation_effort=saturation, no_load_velocity=fastest)
    condition = judged(arm, motion)
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
    condition = judged(arm, motion)
    sampled = 1 - worst_curve_use(arm, motion)
    assert sampled - 1e-6 <= condition.margin <= sampled + 1e-9


def test_without_a_line_it_is_not_required(tmp_path):
    condition = judged(with_motors(one_joint(tmp_path), forwards_friction=1.0), course([1.0, 0.0]))
    assert (condition.margin, condition.coverage) == (None, "no motor has a torque-speed line")


def test_the_error_of_the_enclosure_is_told(tmp_path, monkeypatch):
    curve = {"saturation_effort": STALL, "no_load_velocity": FASTEST}
    robot = with_motors(one_joint(tmp_path, mass=0.5, effort=np.inf), **curve)
    motion = course([3.0, -1.0, 0.0])
    exact = judged(robot, motion)
    monkeypatch.setattr("tubeplanner.verification.enclosure._MAX_INTERVALS", 1)
    rough = judged(robot, motion)
    assert rough.margin < exact.margin - 1e-9
    assert "undecided" in rough.coverage
