"""The path at other speeds: braking distances, slower runs."""

import copy
import pickle

import numpy as np
import pytest
from cases import PROBLEMS, anywhere, changed, falling_arm, rest_to_rest, with_motors
from scipy.integrate import solve_ivp

from tubeplanner import Certificate, JointTrajectory, Tolerance, load_robot, verify
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.robot.effort_rate import effort_rate
from tubeplanner.trajectory.joint_trajectory import concatenate
from tubeplanner.verification.braking import worst_braking
from tubeplanner.verification.path_steps import path_steps
from tubeplanner.verification.slower_runs import highest_up_to_one, tightest_slower_run

# Steps in which nothing jumps.


def test_steps_follow_each_other_from_start_to_end(stored):
    _, trajectory = stored("ur5/over_the_wall")
    steps = path_steps(trajectory, 500, 3)
    assert len(steps.piece) >= 500
    assert np.bincount(steps.piece).min() >= 3
    assert steps.width.min() > 0
    ends = steps.start + steps.width
    np.testing.assert_allclose(ends[:-1], steps.start[1:], atol=1e-12)
    assert (steps.start[0], ends[-1]) == (0.0, pytest.approx(trajectory.duration))


def test_every_piece_has_its_steps_though_there_are_many(stored):
    _, trajectory = stored("ur5/over_the_wall")
    pieces = len(trajectory.widths)
    steps = path_steps(trajectory, 1, 7)
    assert pieces * 7 <= len(steps.piece) < pieces * 7 + 100


def test_joints_turn_round_between_steps():
    """Once in the middle of a piece, at a third of it, where no regular step ends."""
    turn = JointTrajectory(["turn"], [0, 1.0], np.array([[[1.5]], [[-1.0]], [[0.0]]]))
    steps = path_steps(turn, 10, 1)
    np.testing.assert_allclose(steps.start[4], 1 / 3, atol=1e-12)
    np.testing.assert_array_equal(steps.direction[:, 0], [-1] * 4 + [1] * 7)


def test_ends_have_what_is_inside_of_the_step():
    """Where the acceleration jumps, each side has its own."""
    move = JointTrajectory(
        ["slide"], [0, 1.0, 2.0], np.array([[[1.0], [-1]], [[0], [2]], [[0], [1]]])
    )
    acceleration = path_steps(move, 4, 1).at_ends(2).reshape(2, -1)
    np.testing.assert_array_equal(acceleration, [[2, 2, -2, -2]] * 2)
    position = path_steps(move, 4, 1).at_ends(0).reshape(2, -1)
    np.testing.assert_allclose(position, [[0, 0.25, 1, 1.75], [0.25, 1, 1.75, 2]])


def test_a_part_is_those_steps():
    steps = path_steps(
        concatenate([rest_to_rest(["a"], 0, 1, 1), rest_to_rest(["a"], 1, 0, 1)]), 8, 1
    )
    part = steps.part(2, 5)
    np.testing.assert_array_equal(part.start, steps.start[2:5])
    np.testing.assert_array_equal(part.at_ends(1)[:3], steps.at_ends(1)[2:5])
    np.testing.assert_array_equal(part.direction, steps.direction[2:5])


# Braking along the path, against closed forms and an independent integration.


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


# Trajectories run slower: closed forms, brute force, and one that cannot be.


SLOWER_RUNS_MASS = 2.0  # [kg]
SLOWER_RUNS_MOVE = rest_to_rest(["slide"], 0.0, 0.6, 1.0)
HELD = 1.2  # what gravity takes of the motor of the falling arm


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
        cart((), {"effort": 0.5}, viscous_friction=damping, friction_uncertainty=uncertainty),
        SLOWER_RUNS_MOVE,
    )
    dense = SLOWER_RUNS_MOVE.at(np.linspace(0, 1, 20001))
    v, a = dense.velocity[:, 0], dense.acceleration[:, 0]
    used = brute_force(lambda p: damping * (1 + uncertainty) * v * p + SLOWER_RUNS_MASS * a * p**2)
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
    at_full, between = (
        (4 * v + SLOWER_RUNS_MASS * a).max(),
        (4**2 * v**2 / (4 * SLOWER_RUNS_MASS * -a)).max(),
    )
    assert between > 1.2 * max(at_full, 0)
    run = tightest_slower_run(robot, slowing)
    assert 0 < run.speed < 1
    assert run.margin == pytest.approx(1 - between / 10, abs=1e-4)


def test_the_torque_speed_line_counts(cart):
    stall, no_load = 8.0, 1.5
    robot = cart(saturation_effort=stall, no_load_velocity=no_load)
    run = tightest_slower_run(robot, SLOWER_RUNS_MOVE)
    dense = SLOWER_RUNS_MOVE.at(np.linspace(0, 1, 20001))
    v, a = dense.velocity[:, 0], dense.acceleration[:, 0]
    used = brute_force(lambda p: SLOWER_RUNS_MASS * a * p**2 / stall + v * p / no_load)
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
    assert tightest_slower_run(cart((), {"effort": np.inf}), SLOWER_RUNS_MOVE) is None


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
