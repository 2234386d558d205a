"""The path at other speeds: braking distances, slower runs."""

import copy
import pickle

import numpy as np
import pytest
from cases import anywhere, changed, falling_arm, rest_to_rest, with_motors
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from tubeplanner import Certificate, JointTrajectory, Payload, Tolerance, load_robot, verify
from tubeplanner.certificate.holding_conditions import HeldPart
from tubeplanner.certificate.other_speeds import (
    BrakingBound,
    _inside,
    highest_up_to_one,
    path_steps,
    tightest_slower_run,
    worst_braking,
)
from tubeplanner.cli.report import other_speeds_line
from tubeplanner.robot.joint_limits import EffortRange
from tubeplanner.robot.model import effort_rate
from tubeplanner.task.holding import Cup, Holding, Liquid, Tray
from tubeplanner.trajectory.joint_trajectory import concatenate

MASS, LENGTH, DURATION = 2.0, 0.6, 1.0  # of the cart and its move [kg], [m], [s]
FASTEST = 1.875 * LENGTH / DURATION  # [m/s]
MOVE = rest_to_rest(["slide"], 0.0, LENGTH, DURATION)
DENSE = MOVE.at(np.linspace(0, DURATION, 20_001))
STALL, NO_LOAD = 9.0, 3.0  # [N], [m/s]
EVERYWHERE = np.array([-3.0, 3.0])  # positions of a table [m or rad]
HELD = 1.2  # what gravity takes at most of the motor of the falling arm, relative


@pytest.fixture
def cart(slider):
    """Return a function from motors and limits to the cart on its rail."""

    def make(limits=None, **motors):
        return with_motors(slider.robot, limits=limits, **motors)

    return make


@pytest.fixture(scope="module")
def fall(tmp_path_factory):
    """An arm that its motor does not hold at the horizontal, a fall, and its certificate."""
    robot, motion = falling_arm(tmp_path_factory.mktemp("falling"))
    return robot, motion, verify(anywhere(robot), motion)


def two_link_move(duration=0.8):
    return rest_to_rest(["joint1", "joint2"], [-0.4, -1.0], [0.9, -2.0], duration)


# Steps in which nothing jumps.


@pytest.mark.parametrize(("steps", "per_piece"), [(500, 3), (1, 7)])
def test_steps_follow_each_other_and_every_piece_has_its_own(steps, per_piece, stored):
    _, trajectory = stored("ur5/over_the_wall")
    pieces = len(trajectory.widths)
    found = path_steps(trajectory, steps, per_piece)
    assert max(steps, per_piece * pieces) <= len(found.piece) < per_piece * pieces + steps + 100
    assert np.bincount(found.piece).min() >= per_piece
    assert found.width.min() > 0
    ends = found.start + found.width
    np.testing.assert_allclose(ends[:-1], found.start[1:], atol=1e-12)
    assert (found.start[0], ends[-1]) == (0.0, pytest.approx(trajectory.duration))


def test_joints_turn_round_between_steps():
    """Once in the middle of a piece, at a third of it, where no regular step ends."""
    turn = JointTrajectory(["turn"], [0, 1.0], np.array([[[1.5]], [[-1.0]], [[0.0]]]))
    steps = path_steps(turn, 10, 1)
    np.testing.assert_allclose(steps.start[4], 1 / 3, atol=1e-12)
    np.testing.assert_array_equal(steps.direction[:, 0], [-1] * 4 + [1] * 7)


def test_ends_have_what_is_inside_of_the_step():
    """Where the acceleration jumps, each side has its own; a part has the same."""
    move = JointTrajectory(
        ["slide"], [0, 1.0, 2.0], np.array([[[1.0], [-1]], [[0], [2]], [[0], [1]]])
    )
    steps = path_steps(move, 4, 1)
    np.testing.assert_array_equal(steps.at_ends(2).reshape(2, -1), [[2, 2, -2, -2]] * 2)
    position = steps.at_ends(0).reshape(2, -1)
    np.testing.assert_allclose(position, [[0, 0.25, 1, 1.75], [0.25, 1, 1.75, 2]])
    part = steps.part(1, 3)
    np.testing.assert_array_equal(part.start, steps.start[1:3])
    np.testing.assert_array_equal(part.direction, steps.direction[1:3])
    np.testing.assert_array_equal(part.at_ends(0).reshape(2, -1), position[:, 1:3])


# Braking along the path, against closed forms and an independent integration.


def by_force(force, mass=MASS):
    """Return time and distance in which a constant force stops a mass [s], [m]."""
    return FASTEST * mass / force, FASTEST**2 * mass / (2 * force)


def by_viscous(damping, force):
    """Return time and distance in which viscous friction and a force stop the cart [s], [m]."""
    decay = MASS / damping * np.log1p(damping * FASTEST / force)
    return decay, MASS / damping * FASTEST - force / damping * decay


HELPING = {"forwards_friction": 3.0, "backwards_friction": 50.0}
SIDES = [EffortRange(0, EVERYWHERE, np.full(2, 8.0), np.full(2, 20.0))]
LINE = {"saturation_effort": STALL, "no_load_velocity": NO_LOAD, "limits": {"effort": np.inf}}
SLOWED = {"limits": {"effort": np.inf, "acceleration": 6.0}}
UNSURE = {"friction_uncertainty": 0.5}
STOPS = {
    "a constant force": ({}, by_force(10.0)),
    "friction of the direction": (HELPING, by_force(13.0)),
    "the least of uncertain friction": (HELPING | UNSURE, by_force(11.5)),
    "a rotor": ({"armature": 0.5}, by_force(10.0, MASS + 0.5)),
    "the effort's side that brakes": ({"effort_ranges": SIDES}, by_force(8.0)),
    "viscous friction": ({"viscous_friction": 6.0}, by_viscous(6.0, 10.0)),
    "the least of it": ({"viscous_friction": 6.0, **UNSURE}, by_viscous(3.0, 10.0)),
    # A motor that brakes has more than its stall effort, along its torque-speed line.
    "a torque-speed line": (LINE, by_viscous(STALL / NO_LOAD, STALL)),
    "an acceleration limit alone": (SLOWED, by_force(6.0 * MASS)),
}


@pytest.mark.parametrize(("motors", "expected"), STOPS.values(), ids=STOPS)
def test_a_mass_stops_in_the_textbooks_time_and_distance(cart, motors, expected):
    """Bounds from above, by few of 1,000 steps."""
    braking = worst_braking(cart(**motors), MOVE, 0.0)
    time, distance = expected
    assert time <= braking.time <= 1.02 * time
    assert distance <= braking.distance <= 1.02 * distance
    if motors == {}:
        assert braking.where.time == pytest.approx(DURATION / 2, abs=2e-3)
        np.testing.assert_allclose(braking.where.position, [LENGTH / 2, 0, 0], atol=4e-3)


def test_what_may_be_exceeded_is_used(cart):
    strict, loose = (worst_braking(cart(), MOVE, tolerance) for tolerance in (0.0, 0.1))
    assert loose.distance == pytest.approx(strict.distance / 1.1, rel=2e-3)


def test_without_limits_on_effort_or_acceleration_nothing_is_said(cart):
    free = cart({"effort": np.inf})
    assert worst_braking(free, MOVE, 0.0) is None
    assert tightest_slower_run(free, MOVE) is None


def test_many_pieces_are_braked_from_between_as_well(cart, monkeypatch):
    """Fewer instants to brake at than steps: those between run on to the next."""
    monkeypatch.setattr("tubeplanner.certificate.other_speeds._MAX_BRAKING_STEPS", 10)
    pieces = [MOVE.between(k / 400, (k + 1) / 400) for k in range(400)]
    braking, (time, distance) = worst_braking(cart(), concatenate(pieces), 0.0), by_force(10.0)
    gap = DURATION / 20
    assert time + 0.8 * gap <= braking.time <= time + 1.1 * gap
    assert distance + 0.8 * gap * FASTEST <= braking.distance <= distance + 1.1 * gap * FASTEST


def test_slow_motions_stop_within_a_millisecond_of_the_textbooks_time(cart):
    braking = worst_braking(cart(), MOVE.scaled(8.0), 0.0)
    time, distance = np.divide(by_force(10.0), [8, 64])
    assert time <= braking.time <= time + 1.1e-3
    assert braking.distance <= distance + 1.1e-3 * FASTEST / 8


def integrated_stop(robot, trajectory, begin, kept=None):
    """Return time and distance of one stop: effort by effort, by the equations of motion alone.

    `kept` is a margin of positions, velocities and accelerations that the stop must not use up.
    """
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
        rate = max(braked)
        if kept is not None and kept(q, v * p, a * p**2 + v * rate) < 0:
            rate = brentq(lambda r: kept(q, v * p, a * p**2 + v * r), rate, 0.0, xtol=1e-9)
        speed = np.linalg.norm(robot.tool_jacobian(q[None])[1][0, :3] @ v)
        return [p, rate, speed * p]

    def still(_, state):
        return state[1]

    still.terminal = True
    found = solve_ivp(rates, [0, 1], [begin, 1, 0], events=still, rtol=1e-5, atol=1e-7)
    return found.t[-1], found.y[2, -1]


def test_an_arm_with_gravity_and_friction_stops_as_an_independent_integration_does():
    motors = {"forwards_friction": [8, 3], "backwards_friction": [5, 2]}
    viscous = {"viscous_friction": [3, 1], "armature": 0.02}
    robot = load_robot("example:two_link", "hand", gravity=(0, -2, 0))
    robot = with_motors(robot, limits={"effort": [95, 27]}, **motors, **viscous)
    move = two_link_move()
    stops = [integrated_stop(robot, move, begin) for begin in np.linspace(0.32, 0.36, 9)]
    time, distance = np.max(stops, axis=0)
    braking = worst_braking(robot, move, 0.0)
    assert 0.999 * time <= braking.time <= 1.02 * time
    assert 0.999 * distance <= braking.distance <= 1.02 * distance


def tray(mu):
    return Holding(Tray(mu, (1.0, 1.0), safety=1.0), Payload(1.0))


@pytest.mark.parametrize(("mu", "drops"), [(0.45, True), (0.6, False)])
def test_a_stop_that_keeps_the_part_is_as_steep_as_friction_allows(cart, mu, drops):
    problem = changed(anywhere(cart()), holding=(tray(mu),))
    certificate = verify(problem, MOVE)
    braking, line = certificate.braking, other_speeds_line(certificate)
    assert braking.drops is drops
    if not drops:
        assert "; as steep a stop keeps the held part; " in line
        assert braking.holding == BrakingBound(braking.time, braking.distance, braking.where)
        return
    (time, distance), held = by_force(10.0), braking.holding
    assert (braking.time, braking.distance) == pytest.approx((time, distance), rel=0.02)
    time, distance = by_force(mu * 9.81 * MASS)
    assert time <= held.time <= time + 5e-3
    assert distance <= held.distance <= distance + 5e-3 * FASTEST
    assert certificate.as_dict()["braking"]["holding"]["time"] == held.time
    shown = f"{held.time:.3f} s and {1000 * held.distance:.0f} mm"
    assert f"may drop the held part: one that keeps it takes at most {shown}; " in line


def test_who_does_not_hold_the_part_has_no_stop_that_keeps_it(cart):
    problem = changed(anywhere(cart()), holding=(tray(0.3),))
    certificate = verify(problem, MOVE)
    assert "holding" in certificate.failures()
    assert (certificate.braking.drops, certificate.braking.holding) == (None, None)
    assert certificate.braking.time == pytest.approx(by_force(10.0)[0], rel=0.02)


@pytest.mark.parametrize("contact", [Cup(16.0, 0.02, 0.5), Liquid(0.6)])
def test_a_stop_in_round_cones_is_that_of_an_independent_integration(contact):
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, -9.81))
    robot = with_motors(robot, limits={"effort": [95, 27]})
    move = two_link_move(1.0)
    holding = Holding(contact, Payload(1.0, (0.01, 0.0, 0.02), (1e-3, 1e-3, 2e-3, 0, 0, 0)))
    part = HeldPart(robot, holding)

    def kept(q, v, a):
        wrench = part.wrench(q[None], v[None], a[None])
        return min(float(cone.margin(wrench)[0]) for cone in holding.cones)

    assert kept(*(f(0.5) for f in (move.position, move.velocity, move.acceleration))) > 0
    braking = worst_braking(robot, move, 0.0, (holding,))
    assert braking.drops
    stops = [integrated_stop(robot, move, begin, kept) for begin in np.linspace(0.4, 0.55, 6)]
    time, distance = np.max(stops, axis=0)
    assert 0.995 * time <= braking.holding.time <= 1.02 * time + 5e-3
    assert 0.995 * distance <= braking.holding.distance <= 1.03 * distance + 3e-3


def test_the_rates_inside_a_cone_are_those_of_a_dense_search():
    rng = np.random.default_rng(5)
    still, turn = rng.normal(size=(2, 1000, 1, 4))
    still[:, :, 3] += rng.uniform(0, 2, (1000, 1))
    still[:200, :, :3], turn[:200, :, :3] = 0.0, 0.0  # half spaces
    turn[200:300] = 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high, is_empty = (each[:, 0] for each in _inside(still, turn))
    rates = np.tan(np.linspace(-1.5, 1.5, 4001))
    x = still + rates[:, None] * turn
    inside = np.linalg.norm(x[..., :3], axis=-1) <= x[..., 3]
    for k, (each, least, most) in enumerate(zip(inside, low, high, strict=True)):
        expected = (rates >= least) & (rates <= most) & ~is_empty[k]
        apart = np.minimum(abs(rates - least), abs(rates - most)) > 1e-6 * (1 + abs(rates))
        np.testing.assert_array_equal(each[apart], expected[apart])


def test_who_cannot_stop_in_a_fall_runs_on(fall):
    _, motion, certificate = fall
    assert "effort" not in certificate.failures()
    weak = motion.position(np.linspace(0, motion.duration, 10001))[:, 0]
    first = motion.duration * np.flatnonzero(np.cos(weak) > 1 / HELD)[0] / 10000
    assert motion.duration - first - 0.01 < certificate.braking.time < motion.duration


def test_the_certificate_says_how_it_brakes(cart):
    problem = anywhere(cart())
    certificate = verify(problem, MOVE)
    braking = worst_braking(problem.robot, MOVE, certificate.tolerance.relative)
    assert certificate.braking == braking
    fields = certificate.as_dict()["braking"]
    assert (fields["time"], fields["distance"]) == (braking.time, braking.distance)
    assert fields["where"]["time"] == braking.where.time


@pytest.mark.parametrize(
    ("broken", "trajectory"), [("effort", MOVE.scaled(0.5)), ("rest", MOVE.between(0.0, 0.5))]
)
def test_what_is_outside_of_its_limits_has_no_bound(cart, broken, trajectory):
    certificate = verify(anywhere(cart()), trajectory)
    assert broken in certificate.failures()
    assert certificate.braking is None
    assert certificate.as_dict()["braking"] is None


def test_it_is_looked_at_only_when_asked_for(cart, monkeypatch):
    def refuse(*_):
        raise AssertionError

    problem = anywhere(cart())
    monkeypatch.setattr("tubeplanner.certificate.other_speeds.worst_braking", refuse)
    monkeypatch.setattr("tubeplanner.certificate.other_speeds.tightest_slower_run", refuse)
    certificate = pickle.loads(pickle.dumps(verify(problem, MOVE)))
    assert certificate.failures() is not None
    with pytest.raises(AssertionError):
        certificate.as_dict()


# Trajectories run slower: closed forms, brute force, and one that cannot be.


@pytest.mark.parametrize("degree", range(4))
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


@pytest.mark.parametrize("name", ["two_link/around_a_post", "panda/between_shelves"])
def test_planned_trajectories_can_be_run_slower(name, stored):
    certificate = verify(*stored(name, "refinement"))
    assert certificate.slower is True
    assert certificate.slower_failure is None


def test_an_arm_that_falls_past_what_its_motor_holds_cannot_be_slower(fall):
    _, motion, certificate = fall
    failure = certificate.slower_failure
    assert certificate.slower is False
    assert (failure.condition, failure.where.joint, failure.speed) == ("effort", "turn", 0.0)
    assert failure.margin == pytest.approx(1 - HELD, abs=1e-5)
    assert motion.position(failure.where.time)[0] == pytest.approx(0.0, abs=2e-3)
    fields = certificate.as_dict()
    assert fields["slower"] is False
    assert fields["slower_failure"]["condition"] == failure.condition
    assert fields["slower_failure"]["margin"] == failure.margin
    assert fields["slower_failure"]["where"] == failure.where.as_dict()


@pytest.mark.parametrize(
    ("friction", "uncertainty", "used"),
    [
        ({"backwards_friction": 0.2}, 0.0, HELD - 0.2),  # falling, friction holds it
        ({"forwards_friction": 0.3}, 0.0, HELD),
        ({"backwards_friction": 0.2}, 0.5, HELD - 0.1),
    ],
)
def test_friction_of_the_direction_is_there_as_slowly_as_you_like(
    fall, friction, uncertainty, used
):
    robot, motion, _ = fall
    friction = {name: fraction * robot.limits.effort[0] for name, fraction in friction.items()}
    run = tightest_slower_run(
        with_motors(robot, friction_uncertainty=uncertainty, **friction), motion
    )
    assert run.margin == pytest.approx(1 - used, abs=1e-5)
    assert run.speed == 0.0


@pytest.mark.parametrize(
    ("position", "backwards", "forwards", "margin", "accuracy"),
    [
        (EVERYWHERE, [5, 5], [2, 2], 1 - HELD / 2, 1e-5),  # the side that gravity needs
        ([-0.2, 0.0, 0.2], [5, 0.8, 5], [5, 0.8, 5], 1 - HELD / 0.8, 0.02),  # where the joint is
    ],
)
def test_a_table_of_efforts_counts(fall, position, backwards, forwards, margin, accuracy):
    robot, motion, _ = fall
    limit = robot.limits.effort[0]
    table = EffortRange(
        0, np.array(position), limit * np.array(backwards), limit * np.array(forwards)
    )
    run = tightest_slower_run(with_motors(robot, [table]), motion)
    assert run.margin == pytest.approx(margin, abs=accuracy)


def test_a_reversal_counts_from_both_sides(fall):
    """Up to the horizontal and down again: friction adds to gravity only on the way up."""
    robot = with_motors(fall[0], forwards_friction=2.0)
    there, back = rest_to_rest(["turn"], -1.0, 0.0, 2.0), rest_to_rest(["turn"], 0.0, -1.0, 2.0)
    run = tightest_slower_run(robot, concatenate([there, back]))
    assert run.margin == pytest.approx(1 - HELD - 2.0 / robot.limits.effort[0], abs=1e-4)
    assert run.where.time == pytest.approx(2.0, abs=1e-2)


def brute_force(use):
    """Return the largest use over speeds from 0 to 1."""
    return max(use(p).max() for p in np.linspace(0, 1, 501))


@pytest.mark.parametrize("uncertainty", [0.0, 0.2])
def test_the_most_may_be_needed_between_rest_and_full_speed(cart, uncertainty):
    """As the cart is slowed down, viscous friction takes D v p - m a p^2."""
    damping = 2.0
    robot = cart({"effort": 0.5}, viscous_friction=damping, friction_uncertainty=uncertainty)
    v, a = DENSE.velocity[:, 0], DENSE.acceleration[:, 0]
    used = brute_force(lambda p: damping * (1 + uncertainty) * v * p + MASS * a * p**2)
    run = tightest_slower_run(robot, MOVE)
    assert run.margin == pytest.approx(1 - used / 0.5, abs=1e-4)


def test_the_torque_speed_line_counts(cart):
    stall, no_load = 8.0, 1.5
    run = tightest_slower_run(cart(saturation_effort=stall, no_load_velocity=no_load), MOVE)
    v, a = DENSE.velocity[:, 0], DENSE.acceleration[:, 0]
    used = brute_force(lambda p: MASS * a * p**2 / stall + v * p / no_load)
    assert run.condition == "motor_curve"
    assert run.margin == pytest.approx(1 - used, abs=1e-4)


@pytest.mark.parametrize("uncertainty", [0.0, 0.3])
def test_effort_rates_are_those_of_all_slower_runs(uncertainty):
    robot = load_robot("example:two_link", "hand", gravity=(0, -9.81, 0))
    motors = {"viscous_friction": [300, 100], "friction_uncertainty": uncertainty}
    limits = {"effort": np.inf, "effort_rate": [4000, 600]}
    robot = with_motors(robot, limits=limits, **motors)
    run = tightest_slower_run(robot, two_link_move())
    used = []
    for p in np.linspace(0.02, 1, 50):
        slow = two_link_move(0.8 / p)
        at = np.linspace(0, slow.duration, 400)
        state = [f(at) for f in (slow.position, slow.velocity, slow.acceleration, slow.jerk)]
        used.append((abs(effort_rate(robot, *state)) / robot.limits.effort_rate).max(axis=0))
    tightest = robot.joint_names[np.max(used, axis=0).argmax()]
    assert (run.condition, run.where.joint) == ("effort_rate", tightest)
    assert run.margin == pytest.approx(1 - np.max(used), abs=2e-3)


def test_many_steps_are_looked_at_in_parts(fall, monkeypatch):
    robot, motion, _ = fall
    whole = tightest_slower_run(robot, motion)
    monkeypatch.setattr("tubeplanner.certificate.other_speeds._AT_ONCE", 37)
    assert tightest_slower_run(robot, motion) == whole


def test_what_is_too_fast_is_so_a_little_slower_too(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    quick = with_motors(problem.robot, limits={"velocity": 0.5})
    certificate = verify(changed(problem, robot=quick), trajectory)
    assert "velocity" in certificate.failures()
    failure = certificate.slower_failure
    assert (failure.condition, failure.speed) == ("velocity", 1.0)
    assert failure.margin == certificate.conditions["velocity"].margin
    assert failure.where == certificate.conditions["velocity"].where


def test_slower_runs_have_the_certificates_tolerance(fall):
    robot, motion, _ = fall
    slower = [
        verify(anywhere(robot), motion, Tolerance(0.0, relative)).slower
        for relative in (HELD - 1.001, HELD - 0.999)
    ]
    assert slower == [False, True]


def test_copies_of_a_certificate_say_the_same(cart):
    certificate = verify(anywhere(cart({"effort": 50.0}, viscous_friction=2.0)), MOVE)
    for other in (pickle.loads(pickle.dumps(certificate)), copy.deepcopy(certificate)):
        assert other.braking == certificate.braking is not None
        assert other.as_dict() == certificate.as_dict()


def test_a_certificate_of_conditions_alone_knows_nothing_of_it(fall):
    alone = Certificate(fall[2].conditions, fall[2].tolerance)
    assert (alone.slower, alone.slower_failure, alone.braking) == (None, None, None)
    assert alone.as_dict()["slower"] is None
