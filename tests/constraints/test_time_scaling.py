"""Time scaling against moves whose minimum time is known in closed form."""

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
)
from tubeplanner import JointTrajectory, Payload, load_robot
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.constraints.time_scaling import (
    estimated_duration,
    estimated_durations,
    minimum_duration,
    scaled_to_limits,
    scaling_factor,
)
from tubeplanner.outcome import Infeasible, PlanStatus


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
    ],
    ids=["effort", "velocity", "acceleration", "jerk"],
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


def test_the_joint_that_is_overloaded_most_is_named():
    robot = load_robot("example:ur5", "tool0", payload=Payload(mass=60.0))
    q = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
    move = JointTrajectory(robot.joint_names, [0, 1.0], [np.full((1, 6), 1e-6), [q]])
    overload = abs(robot.gravity_effort(q[None])[0]) - robot.limits.effort
    with pytest.raises(Infeasible) as caught:
        minimum_duration(anywhere(robot), move)
    assert caught.value.place.joint == robot.joint_names[overload.argmax()]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_gravity_beyond_the_motor_stops_it_in_either_direction(sign):
    held = sign * np.array([[1.2], [0.8]])
    used = SpeedPolynomial({0: held, 2: -sign * np.array([[0.4], [0.4]])})
    speed = used.largest_speed((1.0, -1.0))
    np.testing.assert_allclose(speed[:, 0], [0.0, np.sqrt(1.8 / 0.4)])
