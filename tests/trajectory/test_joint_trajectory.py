"""JointTrajectory: values, samples, scaled, cut, joined, averaged; what is refused."""

import numpy as np
import pytest
from cases import refusal
from numpy.testing import assert_allclose as close
from numpy.testing import assert_array_equal as same

from tubeplanner import JointTrajectory, TrajectoryError
from tubeplanner.trajectory.joint_trajectory import averaged, concatenate, from_spline
from tubeplanner.trajectory.polynomials import BSpline

NAMES = ("a", "b")
LINE = [[[1.0]], [[0.0]]]  # moves by one radian a second


def random_trajectory(seed=0, pieces=4):
    rng = np.random.default_rng(seed)
    breakpoints = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.5, pieces))])
    return JointTrajectory(NAMES, breakpoints, rng.normal(size=(6, pieces, 2)))


def test_before_the_start_and_after_the_end_the_ends_are_given():
    trajectory = random_trajectory()
    same(trajectory.position(-1.0), trajectory.position(0.0))
    same(trajectory.position(1e9), trajectory.position(trajectory.duration))


def test_samples_are_regular_and_end_at_the_duration():
    time = JointTrajectory(["a"], [0, 0.0107], LINE).sample(500).time
    close(time, [0, 0.002, 0.004, 0.006, 0.008, 0.0107])
    close(JointTrajectory(["a"], [0, 0.0009], LINE).sample(500).time, [0, 0.0009])


@pytest.mark.parametrize(
    ("rate", "message"),
    [(rate, f"rate {rate:g} Hz must be > 0 and finite") for rate in (0, np.inf, np.nan)]
    + [("a", "rate is 'a'; it must be a number > 0 [Hz]")],
)
def test_a_rate_is_a_positive_number(rate, message):
    assert refusal(TrajectoryError, random_trajectory().sample, rate) == message


def test_samples_per_piece_see_both_sides_of_a_breakpoint():
    trajectory = JointTrajectory(["a"], [0, 1, 2], [[[1.0], [-1.0]], [[0.0], [5.0]]])
    samples = trajectory.per_piece(3)
    close(samples.time, [0, 0.5, 1, 1, 1.5, 2])
    close(samples.position[:, 0], [0, 0.5, 1, 5, 4.5, 4])
    close(samples.velocity[:, 0], [1, 1, 1, -1, -1, -1])


def test_a_given_piece_decides_where_a_derivative_jumps():
    rows = [[[1.0], [-2.0]], [[0.0], [3.0]], [[0.0], [3.0]], [[0.0], [1.0]]]
    trajectory = JointTrajectory(["a"], [0, 1, 1.5], rows)
    close(trajectory.jerk_per_piece(2)[:, 0], [6, 6, -12, -12])
    piece, local = np.array([0, 1, 1]), np.array([1.0, 0.0, 0.5])
    expected = [[1, 1, 3], [3, 3, 4.5], [6, 6, 0], [6, -12, -12]]
    for order, values in enumerate(expected):
        close(trajectory.within(piece, local, order)[:, 0], values)


def test_scaling_keeps_the_path():
    trajectory = random_trajectory()
    slower = trajectory.scaled(3.0)
    t = np.linspace(0, trajectory.duration, 50)
    assert slower.duration == pytest.approx(3 * trajectory.duration)
    close(slower.position(3 * t), trajectory.position(t), atol=1e-12)
    close(slower.acceleration(3 * t), trajectory.acceleration(t) / 9)


def test_joints_are_matched_by_name():
    trajectory = random_trajectory()
    swapped = trajectory.reordered(["b", "a"])
    same(swapped.position(0.2), trajectory.position(0.2)[::-1])
    with pytest.raises(TrajectoryError, match="moves the joints a, b; the problem's are a, c"):
        trajectory.reordered(["a", "c"])


def test_parts_are_concatenated():
    first, second = random_trajectory(1), random_trajectory(2, pieces=3)
    whole = concatenate([first, second])
    assert whole.duration == pytest.approx(first.duration + second.duration)
    t = np.linspace(0, second.duration, 20)[1:]
    close(whole.position(first.duration + t), second.position(t), atol=1e-12)


def test_a_spline_keeps_its_values():
    rng = np.random.default_rng(3)
    knots = np.concatenate([np.zeros(5), np.linspace(0, 2, 7), np.full(5, 2.0)])
    spline = BSpline(knots, rng.normal(size=(11, 2)), 5)
    trajectory = from_spline(NAMES, spline)
    t = np.linspace(0, 2, 101)
    close(trajectory.position(t), spline(t), atol=1e-12)
    close(trajectory.velocity(t), spline(t, 1), atol=1e-11)


def test_a_part_that_ends_on_a_breakpoint_is_not_cut_there_again():
    """3.07 - 0.74 + 0.74 is above 3.07 by a rounding error."""
    line = JointTrajectory(("a",), [0, 3.07, 10.0], np.array([[[1.0], [1.0]], [[0.0], [3.07]]]))
    part = line.between(0.74, 3.07)
    assert (part.duration, len(part.widths)) == (pytest.approx(2.33), 1)


def test_an_averaged_trajectory_has_means_of_it_at_its_knots():
    trajectory, intervals, duration = random_trajectory(), 10, 3.0
    smooth = averaged(trajectory, intervals, duration)
    close(smooth.breakpoints, duration * np.arange(11) / 10)
    step = trajectory.duration / (intervals - 2)  # two intervals come on top
    inner = np.arange(3, intervals - 2)
    before, at, after = (trajectory.position((inner - 1 + k) * step) for k in (-1, 0, 1))
    values = smooth.position(smooth.breakpoints[inner])
    close(values, (before + 4 * at + after) / 6, atol=1e-12)
    ends = smooth.at(np.array([0.0, duration]))
    close(ends.position, trajectory.position([0, trajectory.duration]))
    close([ends.velocity, ends.acceleration], 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["joint_names", "duration", "new"])
def test_nothing_of_a_trajectory_can_be_changed(name):
    trajectory = random_trajectory()
    with pytest.raises(AttributeError, match=f"{name} of a trajectory cannot be changed; make"):
        setattr(trajectory, name, [0, 2.0])
    with pytest.raises(ValueError, match="read-only"):
        trajectory.coefficients[0, 0, 0] = 1.0


ONE = np.ones((1, 1, 1))


@pytest.mark.parametrize(
    ("names", "breakpoints", "coefficients", "message"),
    [
        (NAMES, [0, 1], ONE, r"coefficients have shape \(1, 1, 1\); .* \(1, 1, 2\) is needed"),
        (["a"], [0.5, 1], ONE, "increase from 0"),
        (["a"], [0, 1, 1], np.ones((2, 2, 1)), "increase from 0"),
        (["a"], [0, 1], ONE * np.nan, "finite"),
        (["a"], [0, 1], "text", "arrays of numbers"),
        (["a", "a"], [0, 1], np.ones((1, 1, 2)), "joint_names has 'a' twice"),
        ([5], [0, 1], ONE, r"joint_names\[0\] is 5; a name must be text"),
        (["a"], [0, 1], ONE * 1j, "coefficients: real numbers are needed"),
        (["a"], [False, True], ONE, "breakpoints: real numbers are needed"),
        (["a"], [0, 1], np.ma.masked_all((1, 1, 1)), "coefficients: a masked array has no value"),
        (["a"], [0, 1], np.ones((22, 1, 1)), "the degree is 21, at most 20"),
        (["a"], [0, 1e-10], ONE, "the duration is 1e-10 s"),
        (["a"], [0, 1e7], ONE, "the duration is 1e\\+07 s"),
        (["a"], [0, 1e-7, 1], [[[2e13], [0]], [[0], [0]]], "the position of 'a' may reach 2e\\+06"),
        (["a"], [0, 1e-9, 1], [[[2e12], [0]], [[0], [0]]], "the velocity of 'a' may reach 2e\\+12"),
    ],
)
def test_what_is_no_trajectory_or_what_no_arm_could_do_is_refused(
    names, breakpoints, coefficients, message
):
    with pytest.raises(TrajectoryError, match=message):
        JointTrajectory(names, breakpoints, coefficients)


def test_what_an_arm_could_just_do_is_accepted():
    assert JointTrajectory(["a"], [0, 1e-8], [[[1e10]], [[0]]]).duration == 1e-8
