"""The shortest duration of a fixed shape under all limits."""

from itertools import pairwise

import numpy as np
import pytest
from cases import (
    ANGLE,
    INERTIA,
    PEAK_ACCELERATION,
    PEAK_JERK,
    PEAK_VELOCITY,
    anywhere,
    one_joint,
    quintic,
    random_motion,
    random_motors,
    with_motors,
)
from scipy.interpolate import CubicSpline

from tubeplanner import JointTrajectory, LimitOverrides, Payload, load_robot, verify
from tubeplanner.limits.speed_limits import (
    estimated_duration,
    estimated_durations,
    minimum_duration,
    scaled_to_limits,
    scaling_factor,
)
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.robot.model import effort_rate

FREE = {"velocity": np.inf, "effort": np.inf}
BY_EFFORT = np.sqrt(INERTIA * ANGLE * PEAK_ACCELERATION / 5)
BY_VELOCITY = ANGLE * PEAK_VELOCITY / 1.5


@pytest.mark.parametrize(
    ("limits", "armature", "expected"),
    [
        ({"velocity": np.inf}, 0.0, BY_EFFORT),
        ({"velocity": np.inf}, 0.5, BY_EFFORT * np.sqrt(1 + 0.5 / INERTIA)),
        (FREE | {"velocity": 1.5}, 0.0, BY_VELOCITY),
        (FREE | {"acceleration": 2.0}, 0.0, np.sqrt(ANGLE * PEAK_ACCELERATION / 2)),
        (FREE | {"velocity": 1.5, "jerk": 1.0}, 0.0, np.cbrt(ANGLE * PEAK_JERK)),
        # Inertia times jerk, largest at both ends, where acceleration is not.
        (
            FREE | {"velocity": 1e3, "effort_rate": 30.0},
            0.0,
            np.cbrt(INERTIA * ANGLE * PEAK_JERK / 30),
        ),
        (FREE | {"velocity": 1.5, "acceleration": 1e3, "jerk": 1e6}, 0.0, BY_VELOCITY),
    ],
)
def test_one_joint_move_takes_its_known_minimum_time(tmp_path, limits, armature, expected):
    """Jerk counts only where it is asked for. An estimate by velocities is never too short."""
    problem = anywhere(with_motors(one_joint(tmp_path, **limits), armature=armature))
    for duration in (0.1, 1.0, 7.0):
        shape = quintic(duration=duration)
        assert minimum_duration(problem, shape) == pytest.approx(expected, rel=1e-7)
    if expected == BY_VELOCITY:
        for angle in (ANGLE, -ANGLE):
            estimate = estimated_duration(problem, quintic(angle))
            assert expected * (1 - 1e-9) <= estimate <= 3 * expected
    if "jerk" in limits:
        free = minimum_duration(problem, quintic(), with_jerk=False)
        assert free == pytest.approx(BY_VELOCITY, rel=1e-7)


def test_a_joint_at_rest_limits_nothing_and_takes_no_time(tmp_path):
    problem, still = anywhere(one_joint(tmp_path)), np.zeros((1, 1))
    assert np.isinf(scaling_factor(problem, still, still, still)).all()
    assert minimum_duration(problem, quintic(0.0)) == 0.0


def test_estimates_of_several_shapes_are_those_of_each(stored):
    """And scaling again changes nothing."""
    problem, trajectory = stored("ur5/over_the_wall")
    whole = trajectory.between(0.0, trajectory.duration)
    assert minimum_duration(problem, whole) == pytest.approx(trajectory.duration, rel=1e-5)
    cuts = np.linspace(0, trajectory.duration, 4)
    shapes = [trajectory.between(*pair).scaled(3.0) for pair in pairwise(cuts)]
    each = [estimated_duration(problem, shape) for shape in shapes]
    np.testing.assert_allclose(estimated_durations(problem, shapes), each, rtol=1e-12)


@pytest.mark.parametrize("strong", [{}, {"shoulder_lift_joint": 1e4}], ids=["as it is", "strong"])
def test_the_joint_that_is_overloaded_most_is_named(strong):
    """Not the one that carries most, where that is strong enough."""
    limits = LimitOverrides(effort=strong)
    robot = load_robot("example:ur5", "tool0", payload=Payload(mass=60.0), limits=limits)
    q = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
    move = JointTrajectory(robot.joint_names, [0, 1.0], [np.full((1, 6), 1e-6), [q]])
    gravity = abs(robot.gravity_effort(q[None])[0])
    overload = gravity - robot.limits.effort
    if strong:
        assert gravity.argmax() == robot.joint_names.index(*strong)
    with pytest.raises(Infeasible) as caught:
        minimum_duration(anywhere(robot), move)
    named = caught.value.location.joint
    assert named == robot.joint_names[overload.argmax()]
    assert named not in strong


RATE = dict.fromkeys(("joint1", "joint2"), 150.0)


@pytest.fixture(scope="module")
def kinked():
    """A problem with limited effort rates, and a shape whose jerk jumps at every breakpoint."""
    limits = LimitOverrides(effort=dict.fromkeys(RATE, np.inf), effort_rate=RATE)
    robot = load_robot("example:two_link", "hand", gravity=(0, -9.81, 0), limits=limits)
    times = np.array([0.0, 0.15, 0.4, 0.6, 1.0])
    points = np.array([[0.0, -1.0], [0.5, -0.2], [0.6, -0.9], [-0.3, -1.5], [0.2, -1.2]])
    spline = CubicSpline(times, points, bc_type="clamped")
    return anywhere(robot), JointTrajectory(tuple(RATE), times, spline.c)


def test_effort_rates_are_met_exactly_on_both_sides_of_breakpoints(kinked):
    """At samples of every piece, evaluated on it."""
    (problem, shape), count = kinked, 4001
    robot, scaled = problem.robot, scaled_to_limits(problem, shape)
    piece = np.repeat(np.arange(len(scaled.widths)), count)
    local = (np.linspace(0, 1, count) * scaled.widths[:, None]).ravel()
    states = (scaled.within(piece, local, order) for order in range(4))
    fractions = abs(effort_rate(robot, *states)) / robot.limits.effort_rate
    assert fractions.max() == pytest.approx(1.0, abs=1e-6)
    assert fractions.max() <= 1.0
    assert estimated_duration(problem, shape) == pytest.approx(scaled.duration, rel=1e-2)
    assert estimated_duration(problem, shape) < scaled.duration
    assert minimum_duration(problem, shape, with_jerk=False) < 0.9 * scaled.duration
    samples = scaled.at(np.linspace(0.01, 0.9, 50) * scaled.duration)
    states = (samples.position, samples.velocity, samples.acceleration)
    jerk = scaled.jerk(samples.time)
    assert scaling_factor(problem, *states, jerk).min() < scaling_factor(problem, *states).min()


def test_a_peak_of_an_effort_rate_between_samples_counts(tmp_path):
    """With gravity: against the largest of the closed form."""
    robot = one_joint(tmp_path, mass=0.5, velocity=1e3, effort=np.inf, effort_rate=4.0)
    scaled = scaled_to_limits(anywhere(robot), quintic(3.0))
    t = np.linspace(0, scaled.duration, 200_001)
    q, v, jerk = (f(t)[:, 0] for f in (scaled.position, scaled.velocity, scaled.jerk))
    rate = (INERTIA + 0.5 * 0.5**2) * jerk - 0.5 * 9.81 * 0.5 * np.sin(q) * v
    assert abs(rate).max() == pytest.approx(4.0, rel=1e-7)
    assert abs(rate).max() <= 4.0
    assert 0.1 < t[abs(rate).argmax()] / scaled.duration < 0.9


@pytest.mark.parametrize("turned", [0.0, -1e-17])
def test_what_rounding_makes_of_standing_still_has_no_friction(slide, turned):
    """A joint that gravity and friction together would stop, and that does not move."""
    weight = float(slide.gravity_effort(np.array([[0.0, 0.0, 0.3]]))[0, 2])
    friction = np.array([0.0, 0.0, slide.limits.effort[2] - weight / 2])
    robot = with_motors(slide, forwards_friction=friction, backwards_friction=friction)
    rows = np.outer([6.0, -15.0, 10.0, 0.0, 0.0, 0.0], [1.0, 0.0, turned])
    rows[-1, 2] = 0.3
    shape = JointTrajectory(slide.joint_names, [0, 1.0], rows[:, None])
    free, same = (estimated_duration(anywhere(one), shape) for one in (slide, robot))
    assert same == free


# Time scaling with motors: random states tried at all speeds, and reversals in closed form.

SPEEDS = np.linspace(0, 1, 101)
BACK, FORTH = 0.9, 0.3
FRICTION = {"backwards_friction": BACK, "forwards_friction": FORTH}


def worst(robot, plain, state, speed):
    """Return the largest fraction that a limit of efforts or velocities is beyond, (N,)."""
    (q, v, a), motors, limits = state, robot.motors, robot.limits
    v, a = v * speed[:, None], a * speed[:, None] ** 2
    smooth = plain.inverse_dynamics(q, v, a) + motors.armature * a
    rubbing = np.where(v >= 0, motors.forwards_friction, -motors.backwards_friction)
    rubbing = rubbing + motors.viscous_friction * v
    result = abs(v) / limits.velocity - 1
    for factor in (1 - motors.friction_uncertainty, 1 + motors.friction_uncertainty):
        effort = smooth + factor * rubbing
        forwards = np.broadcast_to(limits.effort, q.shape).copy()
        backwards = forwards.copy()
        for table in limits.effort_ranges:
            own = q[:, table.joint]
            forwards[:, table.joint] = np.interp(own, table.position, table.forwards)
            backwards[:, table.joint] = np.interp(own, table.position, table.backwards)
        line = v / motors.no_load_velocity
        fraction = effort / motors.saturation_effort
        beyond = [(effort - forwards) / limits.effort, (-effort - backwards) / limits.effort]
        result = np.maximum(
            result, np.max([*beyond, fraction + line - 1, -fraction - line - 1], axis=0)
        )
    return result.max(axis=1)


@pytest.mark.parametrize(("name", "seed"), [("two_link", 0), ("two_link", 1), ("ur5", 2)])
def test_it_is_the_first_speed_that_breaks_a_limit(request, name, seed):
    """Beyond it some are fast enough again that velocity helps: braking by friction."""
    plain, rng = request.getfixturevalue(name), np.random.default_rng(seed)
    robot, count = random_motors(plain, rng), 600
    q, v, a = rng.normal(size=(3, count, plain.joint_count))
    a *= rng.choice([0.0, 0.3, 3.0], (count, 1))
    factor = scaling_factor(anywhere(robot), q, v, a)
    can_move = worst(robot, plain, (q, v, a), np.full(count, 1e-9)) < 0
    np.testing.assert_array_equal(factor > 0, can_move)
    state, factor = (q[can_move], v[can_move], a[can_move]), factor[can_move]
    assert len(factor) > 120
    slower = [worst(robot, plain, state, fraction * factor) for fraction in SPEEDS[1:]]
    assert np.max(slower) < 1e-9
    assert (worst(robot, plain, state, factor * (1 + 1e-6)) > 0).all()
    np.testing.assert_allclose(slower[-1], 0.0, atol=1e-9)


def test_braking_is_limited_by_what_viscous_friction_takes_first(tmp_path):
    """-(I a) s^2 + d v s <= L: friction is too much, then inertia needs it."""
    plain, v, a = one_joint(tmp_path, velocity=1e3), np.array([[1.0]]), np.array([[-1.0]])

    def factor(viscous):
        robot = with_motors(plain, viscous_friction=viscous)
        return robot, scaling_factor(anywhere(robot), 0 * v, v, a)[0]

    robot, result = factor(4.0)
    edges = np.roots([-INERTIA, 4.0, -5.0])
    assert result == pytest.approx(min(edges))
    assert worst(robot, plain, (0 * v, v, a), np.array([1.01 * max(edges)])) < 0
    assert factor(2.0)[1] == pytest.approx(max(np.roots([INERTIA, -2.0, -5.0])))


# Of the acceleration 3 - (t - 0.5)^2, largest at the reversal, before the other direction's
# friction helps.
MAX_THERE = np.poly1d([-1.0, 1.0, 2.75]).integ()


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("polynomial", "acceleration", "helps"),
    [
        # Constant acceleration that reverses between samples.
        ([1.5, -3.0 * 0.371, 0.0], 3.0, -1),
        ([1.5, -3.0 * 2e-4, 0.0], 3.0, -1),
        ((MAX_THERE - MAX_THERE(0.5)).integ().c, 3.0, -1),
        # From 6 rad/s^2 of braking down to 1; back it goes from 0.6 s on, where 3 are left.
        (np.poly1d([2.5, -6.0, 2.7]).integ().c, 6.0, 1),
        # Parabolas whose acceleration is that of both ends, where velocity is none.
        ([1.5, 0.0, 0.0], 3.0, -1),
        ([-1.5, 3.0, 0.0], 3.0, 1),
    ],
)
def test_friction_counts_on_both_sides_of_reversals_and_at_ends(
    tmp_path, polynomial, acceleration, helps, sign
):
    """What is left beside the friction of the way that needs more, or with what friction brakes."""
    robot = with_motors(one_joint(tmp_path, velocity=1e3), **FRICTION)
    rows = sign * np.array(polynomial)[:, None, None]
    dry = FORTH if sign > 0 else BACK
    expected = np.sqrt(INERTIA * acceleration / (5.0 + helps * dry))
    result = minimum_duration(anywhere(robot), JointTrajectory(["turn"], [0.0, 1.0], rows))
    assert result == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(
    ("mass", "friction", "message"),
    [
        (1.0, FRICTION, r"needs 5\.2\d N m against gravity and friction"),
        (2.0, {}, r"'turn' needs 9\.81 .* effort limit is 5\.00"),
    ],
)
def test_up_is_refused_where_weight_and_friction_are_too_much(tmp_path, mass, friction, message):
    """Down it is not, if friction holds."""
    problem = anywhere(with_motors(one_joint(tmp_path, mass=mass), **friction))
    for call in (minimum_duration, estimated_duration):
        with pytest.raises(Infeasible, match=message) as caught:
            call(problem, quintic(1.0))
        assert caught.value.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
        assert caught.value.location.joint == "turn"
    if friction:
        down = scaled_to_limits(problem, quintic(-1.0))
        assert verify(problem, down).conditions["effort"].margin == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize(("name", "seed"), [("two_link", 0), ("two_link", 1), ("ur5", 2)])
def test_random_motions_pass_the_judge_with_nothing_to_spare(request, name, seed):
    """With reversals, at breakpoints too, tables, lines and uncertain friction."""
    plain, rng = request.getfixturevalue(name), np.random.default_rng(20 + seed)
    robot = random_motors(plain, rng)
    problem = anywhere(robot)
    for _ in range(20):
        try:
            scaled = scaled_to_limits(problem, random_motion(robot, rng))
        except Infeasible:  # what it carries and rubs against is too much: another one
            continue
        break
    certificate = verify(problem, scaled)
    result = [certificate.conditions[kind].margin for kind in ("effort", "motor_curve", "velocity")]
    margins = [margin for margin in result if margin is not None]
    assert len(margins) >= 2
    assert min(margins) == pytest.approx(0.0, abs=1e-5)
    assert min(margins) > -1e-6
