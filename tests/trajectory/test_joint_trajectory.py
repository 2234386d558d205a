import numpy as np
import pytest
from scipy.interpolate import PPoly

from tubeplanner import JointTrajectory, TrajectoryError
from tubeplanner.trajectory.averaging import averaged
from tubeplanner.trajectory.b_spline import BSpline
from tubeplanner.trajectory.joint_trajectory import concatenate, from_spline

NAMES = ("a", "b")


def random_trajectory(seed=0, pieces=4):
    rng = np.random.default_rng(seed)
    breakpoints = np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 0.5, pieces))])
    return JointTrajectory(NAMES, breakpoints, rng.normal(size=(6, pieces, 2)))


def test_values_are_those_of_scipy():
    trajectory = random_trajectory()
    reference = PPoly(trajectory.coefficients, trajectory.breakpoints)
    t = np.linspace(0, trajectory.duration, 37).reshape(37, 1)
    np.testing.assert_allclose(trajectory.position(t), reference(t))
    np.testing.assert_allclose(trajectory.velocity(t), reference(t, 1))
    np.testing.assert_allclose(trajectory.acceleration(t), reference(t, 2))


def test_before_the_start_and_after_the_end_the_ends_are_given():
    trajectory = random_trajectory()
    np.testing.assert_array_equal(trajectory.position(-1.0), trajectory.position(0.0))
    end = trajectory.position(trajectory.duration)
    np.testing.assert_array_equal(trajectory.position(1e9), end)


def test_samples_are_regular_and_end_at_the_duration():
    trajectory = JointTrajectory(["a"], [0, 0.0107], [[[1.0]], [[0.0]]])
    time = trajectory.sample(500).time
    np.testing.assert_allclose(time, [0, 0.002, 0.004, 0.006, 0.008, 0.0107])
    shorter = JointTrajectory(["a"], [0, 0.0009], [[[1.0]], [[0.0]]])
    np.testing.assert_allclose(shorter.sample(500).time, [0, 0.0009])


@pytest.mark.parametrize("rate", [0, -5, np.inf, np.nan])
def test_a_rate_must_be_positive(rate):
    with pytest.raises(TrajectoryError, match=r"rate .* Hz must be > 0"):
        random_trajectory().sample(rate)


def test_samples_per_piece_see_both_sides_of_a_breakpoint():
    trajectory = JointTrajectory(["a"], [0, 1, 2], [[[1.0], [-1.0]], [[0.0], [5.0]]])
    samples = trajectory.per_piece(3)
    np.testing.assert_allclose(samples.time, [0, 0.5, 1, 1, 1.5, 2])
    np.testing.assert_allclose(samples.position[:, 0], [0, 0.5, 1, 5, 4.5, 4])
    np.testing.assert_allclose(samples.velocity[:, 0], [1, 1, 1, -1, -1, -1])


def test_a_given_piece_decides_where_a_derivative_jumps():
    rows = [[[1.0], [-2.0]], [[0.0], [3.0]], [[0.0], [3.0]], [[0.0], [1.0]]]
    trajectory = JointTrajectory(["a"], [0, 1, 1.5], rows)
    np.testing.assert_allclose(trajectory.jerk_per_piece(2)[:, 0], [6, 6, -12, -12])
    piece, local = np.array([0, 1, 1]), np.array([1.0, 0.0, 0.5])
    expected = [[1, 1, 3], [3, 3, 4.5], [6, 6, 0], [6, -12, -12]]
    for order, values in enumerate(expected):
        np.testing.assert_allclose(trajectory.within(piece, local, order)[:, 0], values)


def test_scaling_keeps_the_path():
    trajectory = random_trajectory()
    slower = trajectory.scaled(3.0)
    t = np.linspace(0, trajectory.duration, 50)
    assert slower.duration == pytest.approx(3 * trajectory.duration)
    np.testing.assert_allclose(slower.position(3 * t), trajectory.position(t), atol=1e-12)
    np.testing.assert_allclose(slower.acceleration(3 * t), trajectory.acceleration(t) / 9)


def test_a_part_has_the_values_of_the_whole():
    trajectory = random_trajectory()
    begin, end = 0.3 * trajectory.duration, 0.8 * trajectory.duration
    part = trajectory.between(begin, end)
    t = np.linspace(begin + 1e-9, end - 1e-9, 60)
    np.testing.assert_allclose(part.position(t - begin), trajectory.position(t), atol=1e-12)
    assert part.duration == pytest.approx(end - begin)


def test_joints_are_matched_by_name():
    trajectory = random_trajectory()
    swapped = trajectory.reordered(["b", "a"])
    np.testing.assert_array_equal(swapped.position(0.2), trajectory.position(0.2)[::-1])
    with pytest.raises(TrajectoryError, match="moves the joints a, b; the problem's are a, c"):
        trajectory.reordered(["a", "c"])


def test_parts_are_concatenated():
    first, second = random_trajectory(1), random_trajectory(2, pieces=3)
    whole = concatenate([first, second])
    assert whole.duration == pytest.approx(first.duration + second.duration)
    t = np.linspace(0, second.duration, 20)[1:]
    np.testing.assert_allclose(whole.position(first.duration + t), second.position(t), atol=1e-12)


def test_a_spline_keeps_its_values():
    rng = np.random.default_rng(3)
    knots = np.concatenate([np.zeros(5), np.linspace(0, 2, 7), np.full(5, 2.0)])
    spline = BSpline(knots, rng.normal(size=(11, 2)), 5)
    trajectory = from_spline(NAMES, spline)
    t = np.linspace(0, 2, 101)
    np.testing.assert_allclose(trajectory.position(t), spline(t), atol=1e-12)
    np.testing.assert_allclose(trajectory.velocity(t), spline(t, 1), atol=1e-11)


@pytest.mark.parametrize(
    ("breakpoints", "coefficients", "message"),
    [
        ([0, 1], [[[1.0]]], r"coefficients have shape \(1, 1, 1\); .* \(1, 1, 2\) is needed"),
        ([0.5, 1], np.ones((2, 1, 2)), "increase from 0"),
        ([0, 1, 1], np.ones((2, 2, 2)), "increase from 0"),
        ([0, np.inf], np.ones((2, 1, 2)), "finite"),
        ([0, 1], np.full((2, 1, 2), np.nan), "finite"),
        ([0, 1], "text", "arrays of numbers"),
        ([0, 1], [[1.0, 2.0], [1.0]], "arrays of numbers"),
    ],
)
def test_inconsistent_polynomials_are_refused(breakpoints, coefficients, message):
    with pytest.raises(TrajectoryError, match=message):
        JointTrajectory(NAMES, breakpoints, coefficients)


def test_arrays_handed_out_cannot_be_written():
    with pytest.raises(ValueError, match="read-only"):
        random_trajectory().coefficients[0, 0, 0] = 1.0


def test_a_part_that_ends_on_a_breakpoint_is_not_cut_there_again():
    """3.07 - 0.74 + 0.74 is above 3.07 by a rounding error."""
    line = JointTrajectory(("a",), [0, 3.07, 10.0], np.array([[[1.0], [1.0]], [[0.0], [3.07]]]))
    part = line.between(0.74, 3.07)
    assert part.duration == pytest.approx(2.33)
    assert len(part.widths) == 1
    assert part.position(part.duration)[0] == pytest.approx(3.07)


def test_an_averaged_trajectory_has_means_of_it_at_its_knots():
    trajectory, intervals, duration = random_trajectory(), 10, 3.0
    smooth = averaged(trajectory, intervals, duration)
    np.testing.assert_allclose(smooth.breakpoints, duration * np.arange(11) / 10)
    step = trajectory.duration / (intervals - 2)  # two intervals come on top
    inner = np.arange(3, intervals - 2)
    before, at, after = (trajectory.position((inner - 1 + k) * step) for k in (-1, 0, 1))
    found = smooth.position(smooth.breakpoints[inner])
    np.testing.assert_allclose(found, (before + 4 * at + after) / 6, atol=1e-12)
    ends = smooth.at(np.array([0.0, duration]))
    np.testing.assert_allclose(ends.position, trajectory.position([0, trajectory.duration]))
    np.testing.assert_allclose([ends.velocity, ends.acceleration], 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["joint_names", "breakpoints", "coefficients", "duration", "new"])
def test_nothing_of_a_trajectory_can_be_changed(name):
    trajectory = JointTrajectory(["a"], [0, 1.0], [[[1.0]], [[0.0]]])
    with pytest.raises(AttributeError, match=f"{name} of a trajectory cannot be changed; make"):
        setattr(trajectory, name, [0, 2.0])


@pytest.mark.parametrize(
    ("names", "breakpoints", "coefficients", "message"),
    [
        (["a", "a"], [0, 1], np.ones((1, 1, 2)), "joint_names has 'a' twice"),
        ([5], [0, 1], np.ones((1, 1, 1)), r"joint_names\[0\] is 5; a name must be text"),
        (["a"], [0, 1], np.ones((1, 1, 1)) * 1j, "coefficients: real numbers are needed"),
        (["a"], [False, True], np.ones((1, 1, 1)), "breakpoints: real numbers are needed"),
        (["a"], [0, 1], np.ma.masked_all((1, 1, 1)), "coefficients: a masked array has no value"),
        (["a"], [0, 1], np.ones((22, 1, 1)), "the degree is 21, at most 20"),
        (["a"], [0, 1e-10], np.ones((1, 1, 1)), "the duration is 1e-10 s"),
        (["a"], [0, 1e7], np.ones((1, 1, 1)), "the duration is 1e\\+07 s"),
        (["a"], [0, 1e-8], [[[1e10]], [[0]]], None),
        (["a"], [0, 1e-7, 1], [[[2e13], [0]], [[0], [0]]], "the position of 'a' may reach 2e\\+06"),
        (["a"], [0, 1e-9, 1], [[[2e12], [0]], [[0], [0]]], "the velocity of 'a' may reach 2e\\+12"),
    ],
)
def test_what_no_arm_could_do_is_refused(names, breakpoints, coefficients, message):
    if message is None:
        assert JointTrajectory(names, breakpoints, coefficients).duration > 0
        return
    with pytest.raises(TrajectoryError, match=message):
        JointTrajectory(names, breakpoints, coefficients)


@pytest.mark.parametrize("rate", ["a", None, True, 1j])
def test_a_rate_is_a_number(rate):
    trajectory = JointTrajectory(["a"], [0, 1.0], [[[1.0]], [[0.0]]])
    with pytest.raises(TrajectoryError, match=r"rate is .*; it must be a number > 0"):
        trajectory.sample(rate)
