"""Trajectories run slower: closed forms, brute force, and one that cannot be."""

import copy
import pickle

import numpy as np
import pytest

from cases import PROBLEMS, anywhere, changed, falling_arm, rest_to_rest, with_motors
from tubeplanner import Certificate, Tolerance, load_robot, verify
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.robot.effort_rate import effort_rate
from tubeplanner.trajectory.joint_trajectory import concatenate
from tubeplanner.verification.slower_runs import highest_up_to_one, tightest_slower_run

MASS = 2.0  # [kg]
MOVE = rest_to_rest(["slide"], 0.0, 0.6, 1.0)
HELD = 1.2  # what gravity takes of the motor of the falling arm


@pytest.fixture
def cart(slider):
    """Return a function from motors and limits to the cart on its rail."""

    def make(*arguments, **motors):
        return with_motors(slider.robot, *arguments, **motors)

    return make


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_the_largest_value_is_that_of_many_arguments(degree):
    coefficients = np.random.default_rng(degree).uniform(-1, 1, (4, 400))
    coefficients[degree + 1 :] = 0
    many = np.linspace(0, 1, 2001)
    values = np.polynomial.polynomial.polyval(many, coefficients)
    highest, argument = highest_up_to_one(coefficients)
    np.testing.assert_allclose(highest, values.max(axis=1), atol=1e-6)
    assert (highest >= values.max(axis=1) - 1e-15).all()
    assert ((argument >= 0) & (argument <= 1)).all()
    at = np.polynomial.polynomial.polyval(argument, coefficients, tensor=False)
    np.testing.assert_allclose(at, highest, atol=1e-14)


def test_constants_have_a_largest_value_too():
    highest, _ = highest_up_to_one(np.array([[2.0, -1.0], [0, 0], [0, 0], [0, 0]]))
    np.testing.assert_array_equal(highest, [2.0, -1.0])


@pytest.mark.parametrize("name", PROBLEMS)
def test_planned_trajectories_can_be_run_slower(name, stored):
    problem, trajectory = stored(name, "refinement")
    certificate = verify(problem, trajectory)
    assert certificate.slower is True
    assert certificate.slower_failure is None


def test_an_arm_that_falls_past_what_its_motor_holds_cannot_be_slower(tmp_path):
    robot, fall = falling_arm(tmp_path)
    certificate = verify(anywhere(robot), fall)
    assert "effort" not in certificate.failures()
    failure = certificate.slower_failure
    assert certificate.slower is False
    assert (failure.condition, failure.where.joint, failure.speed) == ("effort", "turn", 0.0)
    assert failure.margin == pytest.approx(1 - HELD, abs=1e-5)
    assert fall.position(failure.where.time)[0] == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize(
    ("motors", "share"),
    [
        ({"backwards_friction": 0.2}, -0.2),  # falling, friction holds it
        ({"forwards_friction": 0.3}, 0.0),
        ({"backwards_friction": 0.2, "friction_uncertainty": 0.5}, -0.1),
    ],
)
def test_friction_of_the_direction_of_motion_is_there_as_slowly_as_you_like(
    tmp_path, motors, share
):
    robot, fall = falling_arm(tmp_path)
    limit = robot.limits.effort[0]
    friction = {
        name: value if name == "friction_uncertainty" else value * limit
        for name, value in motors.items()
    }
    run = tightest_slower_run(with_motors(robot, **friction), fall)
    assert run.margin == pytest.approx(1 - HELD - share, abs=1e-5)
    assert run.speed == 0.0


def test_the_side_that_gravity_needs_counts(tmp_path):
    robot, fall = falling_arm(tmp_path)
    limit, ends = robot.limits.effort[0], np.array([-3.0, 3.0])
    range_ = EffortRange(0, ends, np.full(2, 5 * limit), np.full(2, 2 * limit))
    strong = with_motors(robot, [range_], {"effort": 5 * limit})
    assert tightest_slower_run(strong, fall).margin == pytest.approx(1 - HELD / 2, abs=1e-5)


def test_a_table_counts_where_the_joint_is(tmp_path):
    robot, fall = falling_arm(tmp_path)
    limit = robot.limits.effort[0]
    position, most = np.array([-0.2, 0.0, 0.2]), limit * np.array([5.0, 0.8, 5.0])
    weak = with_motors(robot, [EffortRange(0, position, most, most)], {"effort": 5 * limit})
    run = tightest_slower_run(weak, fall)
    assert run.margin == pytest.approx(1 - HELD / 0.8, abs=0.02)


def test_a_reversal_counts_from_both_sides(tmp_path):
    """Up to the horizontal and down again: friction adds to gravity only on the way up."""
    robot = with_motors(falling_arm(tmp_path)[0], forwards_friction=2.0)
    there, back = rest_to_rest(["turn"], -1.0, 0.0, 2.0), rest_to_rest(["turn"], 0.0, -1.0, 2.0)
    move = concatenate([there, back])
    limit = robot.limits.effort[0]
    run = tightest_slower_run(robot, move)
    assert run.margin == pytest.approx(1 - HELD - 2.0 / limit, abs=1e-4)
    assert run.where.time == pytest.approx(2.0, abs=1e-2)


@pytest.mark.parametrize("uncertainty", [0.0, 0.2])
def test_the_most_may_be_needed_between_rest_and_full_speed(cart, uncertainty):
    """As the cart is slowed down, viscous friction takes D v p - m a p^2."""
    damping = 2.0
    run = tightest_slower_run(
        cart((), {"effort": 0.5}, viscous_friction=damping, friction_uncertainty=uncertainty), MOVE
    )
    dense = MOVE.at(np.linspace(0, 1, 20001))
    v, a = dense.velocity[:, 0], dense.acceleration[:, 0]
    used = brute_force(lambda p: damping * (1 + uncertainty) * v * p + MASS * a * p**2)
    assert run.margin == pytest.approx(1 - used / 0.5, abs=1e-4)


def brute_force(effort):
    """Return the largest over speeds from 0 to 1."""
    return max(effort(p).max() for p in np.linspace(0, 1, 501))


def test_a_hump_between_is_found_where_both_ends_hold(cart):
    ends = np.array([-1.0, 1.0])
    forwards = EffortRange(0, ends, np.full(2, 1000.0), np.full(2, 10.0))
    robot = cart([forwards], {"effort": 1000.0}, viscous_friction=4.0)
    slowing = rest_to_rest(["slide"], 0.0, 0.6, 1.0).between(0.72, 0.85)
    v, a = (
        f(np.linspace(0, slowing.duration, 5001))[:, 0]
        for f in (slowing.velocity, slowing.acceleration)
    )
    at_full, between = (4 * v + MASS * a).max(), (4**2 * v**2 / (4 * MASS * -a)).max()
    assert between > 1.2 * max(at_full, 0)
    run = tightest_slower_run(robot, slowing)
    assert 0 < run.speed < 1
    assert run.margin == pytest.approx(1 - between / 10, abs=1e-4)


def test_the_torque_speed_line_counts(cart):
    stall, no_load = 8.0, 1.5
    robot = cart(saturation_effort=stall, no_load_velocity=no_load)
    run = tightest_slower_run(robot, MOVE)
    dense = MOVE.at(np.linspace(0, 1, 20001))
    v, a = dense.velocity[:, 0], dense.acceleration[:, 0]
    used = brute_force(lambda p: MASS * a * p**2 / stall + v * p / no_load)
    assert run.condition == "motor_curve"
    assert run.margin == pytest.approx(1 - used, abs=1e-4)


@pytest.mark.parametrize("uncertainty", [0.0, 0.3])
def test_effort_rates_are_those_of_all_slower_runs(uncertainty):
    robot = load_robot("example:two_link", "hand", gravity=(0, -9.81, 0))
    motors = {"viscous_friction": [300, 100], "friction_uncertainty": uncertainty}
    limits = {"effort": np.inf, "effort_rate": [4000, 600]}
    robot = with_motors(robot, (), limits, **motors)
    move = rest_to_rest(["joint1", "joint2"], [-0.4, -1.0], [0.9, -2.0], 0.8)
    run = tightest_slower_run(robot, move)
    used = []
    for p in np.linspace(0.02, 1, 50):
        slow = move.scaled(1 / p)
        at = np.linspace(0, slow.duration, 400)
        state = [f(at) for f in (slow.position, slow.velocity, slow.acceleration, slow.jerk)]
        used.append((abs(effort_rate(robot, *state)) / robot.limits.effort_rate).max(axis=0))
    tightest = robot.joint_names[np.max(used, axis=0).argmax()]
    assert (run.condition, run.where.joint) == ("effort_rate", tightest)
    assert run.margin == pytest.approx(1 - np.max(used), abs=2e-3)


def test_without_limits_on_effort_nothing_is_looked_at(cart):
    assert tightest_slower_run(cart((), {"effort": np.inf}), MOVE) is None


def test_many_steps_are_looked_at_in_parts(tmp_path, monkeypatch):
    robot, fall = falling_arm(tmp_path)
    whole = tightest_slower_run(robot, fall)
    monkeypatch.setattr("tubeplanner.verification.slower_runs._AT_ONCE", 37)
    assert tightest_slower_run(robot, fall) == whole


def test_what_is_too_fast_is_so_a_little_slower_too(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    quick = with_motors(problem.robot, (), {"velocity": 0.5})
    certificate = verify(changed(problem, robot=quick), trajectory)
    assert "velocity" in certificate.failures()
    failure = certificate.slower_failure
    assert (failure.condition, failure.speed) == ("velocity", 1.0)
    assert failure.margin == certificate.conditions["velocity"].margin
    assert failure.where == certificate.conditions["velocity"].where


def test_slower_runs_have_the_certificates_tolerance(tmp_path):
    robot, fall = falling_arm(tmp_path)
    slower = [
        verify(anywhere(robot), fall, Tolerance(0.0, relative)).slower
        for relative in (HELD - 1.001, HELD - 0.999)
    ]
    assert slower == [False, True]


def test_the_certificate_says_which_run_fails(tmp_path):
    robot, fall = falling_arm(tmp_path)
    certificate = verify(anywhere(robot), fall)
    given = certificate.as_dict()
    assert given["slower"] is False
    failure = certificate.slower_failure
    assert given["slower_failure"]["condition"] == failure.condition
    assert given["slower_failure"]["margin"] == failure.margin
    assert given["slower_failure"]["where"] == failure.where.as_dict()


def test_what_a_copy_says_was_found_before(tmp_path):
    robot, fall = falling_arm(tmp_path)
    certificate = verify(anywhere(robot), fall)
    for other in (pickle.loads(pickle.dumps(certificate)), copy.deepcopy(certificate)):
        assert other.slower_failure == certificate.slower_failure
        assert other.braking == certificate.braking
        assert other.as_dict() == certificate.as_dict()


def test_a_certificate_of_conditions_alone_knows_nothing_of_it(stored):
    certificate = verify(*stored("ur5/over_the_wall"))
    alone = Certificate(certificate.conditions, certificate.tolerance)
    assert (alone.slower, alone.slower_failure, alone.braking) == (None, None, None)
    assert alone.as_dict()["slower"] is None
