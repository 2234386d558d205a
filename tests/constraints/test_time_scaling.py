"""Time scaling against moves whose minimum time is known in closed form."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from cases import (
    ANGLE,
    INERTIA,
    PEAK_ACCELERATION,
    PEAK_JERK,
    PEAK_VELOCITY,
    anywhere,
    one_joint,
    quintic,
    with_motors,
)
from tubeplanner import JointTrajectory, LimitOverrides, Payload, load_robot
from tubeplanner.constraints.time_scaling import (
    estimated_duration,
    estimated_durations,
    minimum_duration,
    scaled_to_limits,
    scaling_factor,
)
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.robot.effort_rate import effort_rate


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({"velocity": np.inf}, np.sqrt(INERTIA * ANGLE * PEAK_ACCELERATION / 5)),
        ({"velocity": 1.5, "effort": np.inf}, ANGLE * PEAK_VELOCITY / 1.5),
        (
            {"velocity": np.inf, "effort": np.inf, "acceleration": 2.0},
            np.sqrt(ANGLE * PEAK_ACCELERATION / 2),
        ),
        ({"velocity": 100.0, "effort": np.inf, "jerk": 30.0}, np.cbrt(ANGLE * PEAK_JERK / 30)),
        (
            {"velocity": 1.5, "effort": np.inf, "acceleration": 1e3, "jerk": 1e6},
            ANGLE * PEAK_VELOCITY / 1.5,
        ),
    ],
    ids=["effort", "velocity", "acceleration", "jerk", "velocity of all"],
)
def test_one_joint_move_takes_its_known_minimum_time(tmp_path, limits, expected):
    robot = one_joint(tmp_path, **limits)
    for given in (0.1, 1.0, 7.0):
        assert minimum_duration(anywhere(robot), quintic(duration=given)) == pytest.approx(
            expected, rel=1e-7
        )


def test_scaling_again_changes_nothing(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    segment = trajectory.between(0.0, trajectory.duration)
    again = minimum_duration(problem, segment)
    assert again == pytest.approx(trajectory.duration, rel=1e-5)


def test_gravity_takes_its_share_of_the_effort(tmp_path):
    """The scaled trajectory meets the effort limit at its worst instant, and never breaks it."""
    robot = one_joint(tmp_path, mass=0.5, velocity=np.inf)
    trajectory = scaled_to_limits(anywhere(robot), quintic())
    samples = trajectory.at(np.linspace(0, trajectory.duration, 20_001))
    lever, mass = 0.5, 0.5
    inertia = INERTIA + mass * lever**2
    gravity = mass * lever * 9.81 * np.cos(samples.position)
    effort = inertia * samples.acceleration + gravity
    assert abs(effort).max() == pytest.approx(5.0, rel=1e-6)
    assert abs(effort).max() <= 5.0 * (1 + 1e-9)


@pytest.mark.parametrize("acceleration", [np.inf, 1.0, 0.1])
def test_scaling_factor_says_how_much_faster_each_sample_could_be_run(tmp_path, acceleration):
    robot = one_joint(tmp_path, mass=0.5, acceleration=acceleration)
    samples = quintic(duration=2.0).at(np.array([0.4, 1.1]))
    known = (samples.position, samples.velocity, samples.acceleration)
    factor = scaling_factor(anywhere(robot), *known)
    for i, b in enumerate(factor):
        q, v, a = samples.position[[i]], b * samples.velocity[[i]], b**2 * samples.acceleration[[i]]
        effort = abs(robot.inverse_dynamics(q, v, a)[0, 0]) / 5
        use = max(effort, abs(v[0, 0]) / 4, abs(a[0, 0]) / acceleration)
        assert use == pytest.approx(1.0, rel=1e-12)


def test_a_joint_at_rest_limits_nothing(tmp_path):
    robot = one_joint(tmp_path)
    still = np.zeros((1, 1))
    assert np.isinf(scaling_factor(anywhere(robot), still, still, still)).all()


def test_a_shape_that_does_not_move_takes_no_time(tmp_path):
    assert minimum_duration(anywhere(one_joint(tmp_path)), quintic(0.0)) == 0.0


def test_gravity_beyond_the_motor_is_an_answer_with_joint_and_place(tmp_path):
    robot = one_joint(tmp_path, mass=2.0)
    with pytest.raises(Infeasible, match=r"'turn' needs 9\.81 .* effort limit is 5\.00") as caught:
        minimum_duration(anywhere(robot), quintic())
    assert caught.value.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    assert caught.value.place.joint == "turn"


def test_jerk_counts_only_where_it_is_asked_for(tmp_path):
    robot = one_joint(tmp_path, velocity=1.5, effort=np.inf, jerk=1.0)
    free = minimum_duration(anywhere(robot), quintic(), with_jerk=False)
    assert free == pytest.approx(ANGLE * PEAK_VELOCITY / 1.5, rel=1e-7)
    assert minimum_duration(anywhere(robot), quintic()) == pytest.approx(
        np.cbrt(ANGLE * PEAK_JERK), rel=1e-7
    )


@pytest.mark.parametrize("angle", [ANGLE, -ANGLE])
def test_an_estimate_is_never_too_short_in_either_direction(tmp_path, angle):
    robot = one_joint(tmp_path, velocity=1.5, effort=np.inf)
    exact = ANGLE * PEAK_VELOCITY / 1.5
    assert exact * (1 - 1e-9) <= estimated_duration(anywhere(robot), quintic(angle)) <= 3 * exact


def test_estimates_of_several_shapes_are_those_of_each(stored):
    problem, trajectory = stored("ur5/over_the_wall")
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
    named = caught.value.place.joint
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


def rates_on_both_sides(robot, trajectory, count=4001):
    """Return shares of the limits at samples of every piece, evaluated on it."""
    piece = np.repeat(np.arange(len(trajectory.widths)), count)
    local = np.linspace(0, 1, count) * trajectory.widths[:, None]
    states = (trajectory.within(piece, local.ravel(), order) for order in range(4))
    return abs(effort_rate(robot, *states)) / robot.limits.effort_rate


def test_effort_rates_are_met_exactly_on_both_sides_of_breakpoints(kinked):
    problem, shape = kinked
    scaled = scaled_to_limits(problem, shape)
    shares = rates_on_both_sides(problem.robot, scaled)
    assert shares.max() == pytest.approx(1.0, abs=1e-6)
    assert shares.max() <= 1.0
    assert estimated_duration(problem, shape) == pytest.approx(scaled.duration, rel=1e-2)
    assert estimated_duration(problem, shape) < scaled.duration
    free = minimum_duration(problem, shape, with_jerk=False)
    assert free < 0.9 * scaled.duration
    known = scaled.at(np.linspace(0.01, 0.9, 50) * scaled.duration)
    states = (known.position, known.velocity, known.acceleration)
    jerk = scaled.jerk(known.time)
    assert scaling_factor(problem, *states, jerk).min() < scaling_factor(problem, *states).min()


def test_a_pendulums_effort_rate_has_its_known_minimum_time(tmp_path):
    """Without gravity it is inertia times jerk, largest at both ends, where acceleration is not."""
    robot = one_joint(tmp_path, velocity=1e3, effort=np.inf, effort_rate=30.0)
    expected = np.cbrt(INERTIA * ANGLE * PEAK_JERK / 30)
    found = minimum_duration(anywhere(robot), quintic(duration=0.7))
    assert found == pytest.approx(expected, rel=1e-7)


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


@pytest.mark.parametrize("turned", [0.0, 1e-17, -1e-17])
def test_what_rounding_makes_of_standing_still_has_no_friction(slide, turned):
    """A joint that gravity and friction together would stop, and that does not move."""
    held = float(slide.gravity_effort(np.array([[0.0, 0.0, 0.3]]))[0, 2])
    friction = np.array([0.0, 0.0, slide.limits.effort[2] - held / 2])
    robot = with_motors(slide, forwards_friction=friction, backwards_friction=friction)
    rows = np.outer([6.0, -15.0, 10.0, 0.0, 0.0, 0.0], [1.0, 0.0, turned])
    rows[-1, 2] = 0.3
    shape = JointTrajectory(slide.joint_names, [0, 1.0], rows[:, None])
    free, same = (estimated_duration(anywhere(one), shape) for one in (slide, robot))
    assert same == free
