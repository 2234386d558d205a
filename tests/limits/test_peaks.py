"""Peaks between samples: accelerations, tool speed."""

import numpy as np
import pytest
from cases import ANGLE, PEAK_ACCELERATION, PEAK_VELOCITY, one_joint, quintic

from tubeplanner import JointTrajectory, load_robot
from tubeplanner.limits.peaks import (
    peaks_as_dict,
    refined_maximum,
    refined_maximum_of_pieces,
    trajectory_peaks,
)


def wave(t):
    return np.cos(40 * (t - 0.3137))


def test_a_peak_between_samples_is_found_and_never_below_a_sample():
    time = np.linspace(0, 1, 21)
    value, when = refined_maximum(wave, time, wave(time), band=0.3)
    assert value == pytest.approx(1, abs=1e-7)
    assert wave(when) == value
    time, samples = np.linspace(0, 1, 5), np.array([0.0, 3.0, 0.0, 1.0, 0.0])
    assert refined_maximum(np.zeros_like, time, samples, band=0.1) == (3.0, 0.25)


@pytest.mark.parametrize("shift", [-1e-3, 1e-3])
def test_a_peak_just_beside_a_doubled_sample_is_found_on_either_side(shift):
    """At a breakpoint two samples share a time; rounding must not decide which side is searched."""
    time = np.concatenate([np.linspace(0, 1, 6), np.linspace(1, 2, 6)])

    def function(t):
        return -((t - 1 - shift) ** 2)

    value = function(time)
    value[6] -= 1e-16
    result, when = refined_maximum(function, time, value, band=0.5)
    assert result == pytest.approx(0, abs=1e-9)
    assert when == pytest.approx(1 + shift, abs=1e-4)


@pytest.mark.parametrize("gain", [-1e-4, 1e-4])
def test_of_two_peaks_the_higher_one_is_found_with_few_evaluations(gain):
    """Their samples do not tell which it is; a third one, far lower, is soon given up."""
    centres, heights = np.array([0.21, 0.52, 0.83]), np.array([1.0, 1.0 + gain, 0.8])
    evaluated = []

    def function(t):
        evaluated.append(len(t))
        return (heights - 100 * (t[:, None] - centres) ** 2).max(axis=1)

    time = np.linspace(0, 1, 21)
    value, when = refined_maximum(function, time, function(time), band=1.0)
    assert value == pytest.approx(heights.max(), abs=1e-8)
    assert when == pytest.approx(centres[heights.argmax()], abs=1e-4)
    assert evaluated[2] < evaluated[1]


def pieces_of(function, pieces, count=6):
    """Return a function of pieces at the samples that its refinement begins with."""
    fraction = np.tile(np.linspace(0, 1, count), pieces)
    return function(np.repeat(np.arange(pieces), count), fraction).reshape(pieces, count)


@pytest.mark.parametrize(
    ("centre", "other"), [(0.004, 0.99999), (0.4321, -5.0), (0.68, 0.99999), (0.987, -5.0)]
)
def test_a_peak_beside_a_jump_is_found_whatever_the_next_piece_does(centre, other):
    def function(piece, fraction):
        return np.where(piece == 1, 1 - 40 * (fraction - centre) ** 2, other)

    result = refined_maximum_of_pieces(function, pieces_of(function, 3), band=10.0)
    assert result == pytest.approx(1.0, abs=1e-7)


def test_a_peak_at_an_end_is_the_sample_there_and_soon_done_with():
    """Of a hundred pieces, each straight: nothing rises above its ends."""
    evaluated = []

    def function(piece, fraction):
        evaluated.append(len(piece))
        return fraction * np.where(piece % 2, 1.0, 0.5) - 1e-3 * piece

    value = pieces_of(function, 100)
    assert refined_maximum_of_pieces(function, value, band=1.0) == value.max()
    assert evaluated[2:] == [9] * 5
    unlimited = np.full((2, 4), -np.inf)
    assert refined_maximum_of_pieces(lambda *_: np.zeros(1), unlimited, band=1.0) == -np.inf


def test_of_many_peaks_the_highest_is_found():
    """Their samples hardly differ; which is the highest shows only between them."""
    centres = np.random.default_rng(0).uniform(0.3, 0.7, 200)

    def function(piece, fraction):
        return -((fraction - centres[piece]) ** 2) + 1e-3 * (piece == 137)

    result = refined_maximum_of_pieces(function, pieces_of(function, 200), band=1.0)
    assert result == pytest.approx(1e-3, abs=1e-8)


LEVER = 0.5  # [m]


@pytest.fixture
def bar(tmp_path):
    """A bar that turns, its tool half a metre from the axis."""
    robot = one_joint(tmp_path)
    text = robot.urdf.path.read_text()
    joint = (
        '<link name="hand"/><joint name="wrist" type="fixed"><parent link="bar"/>'
        f'<child link="hand"/><origin xyz="{LEVER} 0 0"/></joint></robot>'
    )
    robot.urdf.path.write_text(text.replace("</robot>", joint))
    return load_robot(robot.urdf.path, "hand")


def test_a_turning_bar_has_the_peaks_of_its_quintic(bar):
    duration = 0.8
    peaks = trajectory_peaks(bar, quintic(duration=duration))
    acceleration, speed = peaks.peak_acceleration, peaks.tool_speed
    assert acceleration.value == pytest.approx(PEAK_ACCELERATION * ANGLE / duration**2)
    when = min(acceleration.time, duration - acceleration.time)
    assert when == pytest.approx(duration * (0.5 - 0.5 / np.sqrt(3)), abs=1e-4)
    assert (acceleration.joint, acceleration.unit) == ("turn", "rad/s^2")
    assert speed.value == pytest.approx(PEAK_VELOCITY * ANGLE * LEVER / duration)
    assert speed.time == pytest.approx(duration / 2, abs=1e-3)
    assert speed.joint is None
    # Turning evenly accelerates the tool towards the axis.
    rate = 3.0  # [rad/s]
    peaks = trajectory_peaks(bar, JointTrajectory(["turn"], [0, 1.0], [[[rate]], [[0.0]]]))
    assert peaks.peak_acceleration.value == 0
    assert peaks.tool_acceleration.value == pytest.approx(rate**2 * LEVER)


@pytest.mark.parametrize(("first", "second"), [(6.0, 2.0), (2.0, 6.0)])
def test_a_jump_counts_on_both_its_sides(bar, first, second):
    """The larger acceleration ends at the breakpoint, or begins there."""
    pieces = [[[first / 2], [second / 2]], [[0.0], [0.0]], [[0.0], [0.0]]]
    peaks = trajectory_peaks(bar, JointTrajectory(["turn"], [0, 1e-3, 2e-3], pieces))
    assert peaks.peak_acceleration.value == pytest.approx(6.0)
    assert peaks.tool_acceleration.value == pytest.approx(6.0 * LEVER, rel=1e-3)


def test_the_tool_s_peaks_are_those_of_its_path(stored):
    problem, trajectory = stored("ur5/over_the_wall", "refinement")
    peaks = trajectory_peaks(problem.robot, trajectory)
    time, step = np.linspace(0, trajectory.duration, 40_001, retstep=True)
    path = problem.robot.tool_position(trajectory.position(time))
    for order, peak in ((1, peaks.tool_speed), (2, peaks.tool_acceleration)):
        rates = np.linalg.norm(np.diff(path, order, axis=0), axis=1) / step**order
        assert rates.max() * (1 - 1e-4) < peak.value < 1.01 * rates.max()
    largest = abs(trajectory.acceleration(time)).max()
    assert largest <= peaks.peak_acceleration.value <= 1.01 * largest


def test_joints_may_come_in_any_order(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    backwards = trajectory.reordered(trajectory.joint_names[::-1])
    peaks = trajectory_peaks(problem.robot, trajectory)
    assert trajectory_peaks(problem.robot, backwards) == peaks
    assert str(peaks).startswith("joint acceleration ")
    values = peaks_as_dict(peaks)
    assert values["peak_acceleration"]["joint"] in trajectory.joint_names
    assert dict.fromkeys(values) == peaks_as_dict(None)
