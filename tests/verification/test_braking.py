"""Braking along the path, against closed forms and an independent integration."""

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cases import anywhere, falling_arm, rest_to_rest, with_motors
from tubeplanner import JointTrajectory, load_robot, verify
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.trajectory.joint_trajectory import concatenate
from tubeplanner.verification.braking import worst_braking

MASS, STALL, NO_LOAD = 2.0, 9.0, 3.0  # [kg], [N], [m/s]
WAY, DURATION = 0.6, 1.0  # [m], [s]
FASTEST = 1.875 * WAY / DURATION  # [m/s]


MOVE = rest_to_rest(["slide"], 0.0, WAY, DURATION)


@pytest.fixture
def cart(slider):
    """Return a function from motors and limits to the cart on its rail."""

    def make(*arguments, **motors):
        return with_motors(slider.robot, *arguments, **motors)

    return make


def require_within(braking, time, distance):
    """Bounds from above, by few of 1,000 steps."""
    assert time <= braking.time <= 1.02 * time
    assert distance <= braking.distance <= 1.02 * distance


@pytest.mark.parametrize(
    ("motors", "force"),
    [
        ({}, 10.0),
        ({"forwards_friction": 3.0, "backwards_friction": 50.0}, 13.0),
        ({"forwards_friction": 3.0, "friction_uncertainty": 0.5}, 11.5),
        ({"armature": 0.5}, 10.0 * MASS / (MASS + 0.5)),
    ],
)
def test_a_constant_force_stops_a_mass_in_the_textbooks_time_and_way(cart, motors, force):
    braking = worst_braking(cart(**motors), MOVE, 0.0)
    slowing = force / MASS
    require_within(braking, FASTEST / slowing, FASTEST**2 / (2 * slowing))
    assert braking.where.time == pytest.approx(DURATION / 2, abs=2e-3)
    np.testing.assert_allclose(braking.where.position, [WAY / 2, 0, 0], atol=4e-3)


def test_only_the_side_that_brakes_counts(cart):
    ends = np.array([-1.0, 1.0])
    limit = EffortRange(0, ends, np.array([8.0, 8.0]), np.array([20.0, 20.0]))
    slowing = 8.0 / MASS
    braking = worst_braking(cart([limit], {"effort": 20.0}), MOVE, 0.0)
    require_within(braking, FASTEST / slowing, FASTEST**2 / (2 * slowing))


def test_viscous_friction_helps_as_it_does_in_the_textbook(cart):
    damping, force = 6.0, 10.0
    robot = cart(viscous_friction=damping)
    ratio = damping * FASTEST / force
    time = MASS / damping * np.log(1 + ratio)
    distance = MASS / damping * (FASTEST - force / damping * np.log(1 + ratio))
    require_within(worst_braking(robot, MOVE, 0.0), time, distance)


def test_uncertain_viscous_friction_helps_by_its_least(cart):
    damping, force = 3.0, 10.0
    robot = cart(viscous_friction=2 * damping, friction_uncertainty=0.5)
    ratio = damping * FASTEST / force
    time = MASS / damping * np.log(1 + ratio)
    distance = MASS / damping * (FASTEST - force / damping * np.log(1 + ratio))
    require_within(worst_braking(robot, MOVE, 0.0), time, distance)


def test_a_motor_that_brakes_has_more_than_its_stall_effort(cart):
    """Along its torque-speed line, as far as the effort limit allows: here it does not bind."""
    robot = cart((), {"effort": np.inf}, saturation_effort=STALL, no_load_velocity=NO_LOAD)
    damping = STALL / NO_LOAD
    ratio = damping * FASTEST / STALL
    time = MASS / damping * np.log(1 + ratio)
    distance = MASS / damping * (FASTEST - STALL / damping * np.log(1 + ratio))
    require_within(worst_braking(robot, MOVE, 0.0), time, distance)


def test_an_acceleration_limit_alone_counts(cart):
    braking = worst_braking(cart((), {"effort": np.inf, "acceleration": 6.0}), MOVE, 0.0)
    require_within(braking, FASTEST / 6.0, FASTEST**2 / 12.0)


def test_what_may_be_exceeded_is_used(cart):
    strict, loose = (worst_braking(cart(), MOVE, tolerance) for tolerance in (0.0, 0.1))
    assert loose.distance == pytest.approx(strict.distance / 1.1, rel=2e-3)


def test_without_limits_on_effort_or_acceleration_nothing_is_said(cart):
    assert worst_braking(cart((), {"effort": np.inf}), MOVE, 0.0) is None


def test_pieces_do_not_matter(cart):
    pieces = [MOVE.between(0.0, 0.13), MOVE.between(0.13, DURATION)]
    coefficients = np.concatenate([piece.coefficients for piece in pieces], axis=1)
    split = JointTrajectory(["slide"], [0.0, 0.13, DURATION], coefficients)
    whole, both = (worst_braking(cart(), trajectory, 0.0) for trajectory in (MOVE, split))
    assert both.time == pytest.approx(whole.time, rel=1e-2)
    assert both.distance == pytest.approx(whole.distance, rel=1e-2)


def test_many_pieces_are_braked_from_between_as_well(cart, monkeypatch):
    """Fewer instants to brake at than steps: those between run on to the next."""
    monkeypatch.setattr("tubeplanner.verification.braking._MOST", 10)
    pieces = [MOVE.between(k / 400, (k + 1) / 400) for k in range(400)]
    braking, slowing = worst_braking(cart(), concatenate(pieces), 0.0), 10.0 / MASS
    gap = DURATION / 20
    time = FASTEST / slowing
    assert time + 0.8 * gap <= braking.time <= time + 1.1 * gap
    distance = FASTEST**2 / (2 * slowing)
    assert distance + 0.8 * gap * FASTEST <= braking.distance <= distance + 1.1 * gap * FASTEST


def test_slow_motions_stop_within_a_millisecond_of_the_textbooks_time(cart):
    slow = MOVE.scaled(8.0)
    braking = worst_braking(cart(), slow, 0.0)
    time, fastest = FASTEST / 8 / 5, FASTEST / 8
    assert time <= braking.time <= time + 1.1e-3
    assert braking.distance <= fastest**2 / 10 + 1.1e-3 * fastest


def rest(robot, trajectory, begin):
    """Integrate one stop: effort by effort, from the equations of motion alone."""
    motors, limit = robot.motors, robot.limits.effort

    def efforts(q, v, a):
        friction = np.where(v > 0, motors.forwards_friction, -motors.backwards_friction)
        return robot.inverse_dynamics(q[None], v[None], a[None])[0] + friction

    def rates(_, state):
        s, p, _ = state
        q, v, a = (
            f(s) for f in (trajectory.position, trajectory.velocity, trajectory.acceleration)
        )
        before = efforts(q, v * p, a * p**2)
        change = efforts(q, v * p, a * p**2 + v) - before
        braked = [(np.sign(-c) * m - e) / c for e, c, m in zip(before, change, limit, strict=True)]
        speed = np.linalg.norm(robot.tool_jacobian(q[None])[1][0, :3] @ v)
        return [p, max(braked), speed * p]

    def still(_, state):
        return state[1]

    still.terminal = True
    found = solve_ivp(rates, [0, 1], [begin, 1, 0], events=still, rtol=1e-6, atol=1e-8)
    return found.t[-1], found.y[2, -1]


def test_an_arm_with_gravity_and_friction_stops_as_an_independent_integration_does():
    motors = {"forwards_friction": [8, 3], "backwards_friction": [5, 2]}
    viscous = {"viscous_friction": [3, 1], "armature": 0.02}
    robot = load_robot("example:two_link", "hand", gravity=(0, -2, 0))
    robot = with_motors(robot, (), {"effort": [95, 27]}, **motors, **viscous)
    move = rest_to_rest(["joint1", "joint2"], [-0.4, -1.0], [0.9, -2.0], 0.8)
    stops = [rest(robot, move, begin) for begin in np.linspace(0.3, 0.6, 61)]
    time, distance = np.max(stops, axis=0)
    braking = worst_braking(robot, move, 0.0)
    assert 0.999 * time <= braking.time <= 1.02 * time
    assert 0.999 * distance <= braking.distance <= 1.02 * distance


def test_four_times_as_many_steps_lower_the_bounds_a_little(stored, monkeypatch):
    problem, trajectory = stored("ur5/level_tray", "refinement")
    coarse = worst_braking(problem.robot, trajectory, 1e-6)
    monkeypatch.setattr("tubeplanner.verification.braking._FEWEST", 4000)
    fine = worst_braking(problem.robot, trajectory, 1e-6)
    assert 0.98 * coarse.time < fine.time < coarse.time
    assert 0.98 * coarse.distance < fine.distance < coarse.distance


def test_who_cannot_stop_in_a_fall_runs_on(tmp_path):
    robot, fall = falling_arm(tmp_path)
    certificate = verify(anywhere(robot), fall)
    assert "effort" not in certificate.failures()
    weak = fall.position(np.linspace(0, fall.duration, 10001))[:, 0]
    first = fall.duration * np.flatnonzero(np.cos(weak) > 1 / 1.2)[0] / 10000
    braking = worst_braking(robot, fall, 0.0)
    assert fall.duration - first - 0.01 < braking.time < fall.duration


def test_the_certificate_has_it(cart):
    problem = anywhere(cart())
    certificate = verify(problem, MOVE)
    braking = worst_braking(problem.robot, MOVE, certificate.tolerance.relative)
    assert certificate.braking == braking
    given = certificate.as_dict()["braking"]
    assert (given["time"], given["distance"]) == (braking.time, braking.distance)
    assert given["where"]["time"] == braking.where.time


@pytest.mark.parametrize(
    ("broken", "trajectory"),
    [
        ("effort", MOVE.scaled(0.5)),
        ("rest", MOVE.between(0.0, 0.5)),
    ],
)
def test_what_is_outside_of_its_limits_has_no_bound(cart, broken, trajectory):
    certificate = verify(anywhere(cart()), trajectory)
    assert broken in certificate.failures()
    assert certificate.braking is None
    assert certificate.as_dict()["braking"] is None


def test_joints_in_another_order_brake_the_same(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    other = trajectory.reordered(trajectory.joint_names[::-1])
    assert verify(problem, other).braking == verify(problem, trajectory).braking


def test_it_is_looked_at_only_when_asked_for(cart, monkeypatch):
    def refuse(*_):
        raise AssertionError

    problem = anywhere(cart())
    monkeypatch.setattr("tubeplanner.verification.other_speeds.worst_braking", refuse)
    monkeypatch.setattr("tubeplanner.verification.other_speeds.tightest_slower_run", refuse)
    certificate = pickle.loads(pickle.dumps(verify(problem, MOVE)))
    assert certificate.failures() is not None
    with pytest.raises(AssertionError):
        certificate.as_dict()
