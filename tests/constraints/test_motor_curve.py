"""Torque-speed lines: closed forms of a bar, and which speeds a motor can have."""

import numpy as np
import pytest

from cases import INERTIA, anywhere, one_joint, with_motors
from tubeplanner.constraints.motor_curve import MotorCurve
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.outcome import PlanStatus

STALL, NO_LOAD, BACK, FORTH, VISCOUS = 6.0, 4.0, 0.9, 0.3, 0.8


@pytest.fixture
def bar(tmp_path):
    def made(mass=0.0, **motors):
        line = {"saturation_effort": STALL, "no_load_velocity": NO_LOAD}
        return with_motors(one_joint(tmp_path, mass=mass), **line | motors)

    return made


def path(robot, q, v, a):
    return PathSamples(anywhere(robot), np.array([[[q]], [[v]], [[a]]], dtype=float))


def speed(robot, v, a):
    limit = MotorCurve(robot.motors)
    return float(limit.used(path(robot, 0.0, v, a)).largest_speed(limit.signs).min())


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_without_acceleration_it_is_as_fast_as_without_load(bar, way):
    assert speed(bar(), way * 2.0, 0.0) == pytest.approx(NO_LOAD / 2)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("drives", [True, False])
def test_who_drives_has_less_than_who_brakes(bar, way, drives):
    """(I a) s^2 / S +- v s / V = 1, whose first root counts."""
    v, a = way * 2.0, way * (3.0 if drives else -3.0)
    inertia, slope = INERTIA * 3.0 / STALL, 2.0 / NO_LOAD
    roots = np.roots([inertia, slope if drives else -slope, -1])
    assert speed(bar(), v, a) == pytest.approx(max(roots))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_friction_leaves_less_of_it(bar, way):
    dry = FORTH if way > 0 else BACK
    robot = bar(backwards_friction=BACK, forwards_friction=FORTH, viscous_friction=VISCOUS)
    expected = (STALL - dry) / (STALL * 2 / NO_LOAD + VISCOUS * 2)
    assert speed(robot, way * 2.0, 0.0) == pytest.approx(expected)


def test_its_change_with_the_path_is_that_of_differences(bar):
    robot = bar(mass=0.5, viscous_friction=VISCOUS, forwards_friction=FORTH)
    limit, here, step = MotorCurve(robot.motors), np.array([0.7, 0.9, 2.0]), 1e-6
    exact = limit.by_path(path(robot, *here), 1.3)
    for order, shift in enumerate(step * np.eye(3)):
        sides = [limit.used(path(robot, *(here + s * shift))).at(1.3) for s in (1, -1)]
        slope = (sides[0] - sides[1]) / (2 * step)
        np.testing.assert_allclose(exact[order][:, :, 0], slope, atol=1e-8)


def test_only_joints_with_a_line_have_one(ur5):
    stall, no_load = np.full((2, 6), np.inf)
    stall[[1, 4]], no_load[[1, 4]] = (300.0, 40.0), (3.0, 5.0)
    arm = with_motors(ur5, saturation_effort=stall, no_load_velocity=no_load)
    limit = MotorCurve(arm.motors)
    assert [key.joint for key in limit.keys] == [1, 4]
    at = PathSamples(anywhere(arm), np.random.default_rng(0).uniform(-1, 1, (3, 7, 6)))
    effort, v = ur5.inverse_dynamics(*at.by_path)[:, [1, 4]], at.by_path[1][:, [1, 4]]
    shares = effort / [300.0, 40.0] + v / [3.0, 5.0]
    np.testing.assert_allclose(limit.used(at).at(1.0), np.hstack([shares, -shares]))
    assert limit.key_of(at).tolist() == [[0, 1, 0, 1]]
    assert MotorCurve(ur5.motors).keys == ()


@pytest.mark.parametrize(("v", "friction", "needed"), [(1.0, 1.2, "6.11"), (-1.0, 11.1, "6.20")])
def test_a_motor_that_stalls_is_named(bar, v, friction, needed):
    """4.905 N m of weight, the friction of either way, and a stall effort of 6 N m."""
    robot = bar(mass=1.0, forwards_friction=friction, backwards_friction=friction)
    assert speed(robot, v, 0.0) == 0.0
    refusal = MotorCurve(robot.motors).refusal(path(robot, 0.0, v, 0.0))
    assert (refusal.status, refusal.place.joint) == (PlanStatus.GRAVITY_EXCEEDS_EFFORT, "turn")
    assert f"needs {needed} N m against gravity and friction" in str(refusal)
    assert "its effort limit is 6.00;" in str(refusal)
