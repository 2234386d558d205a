"""Peaks of a trajectory: against closed forms, and against differences of the tool's path."""

import numpy as np
import pytest

from cases import ANGLE, PEAK_ACCELERATION, PEAK_VELOCITY, one_joint, quintic
from tubeplanner import JointTrajectory, load_robot
from tubeplanner.constraints.trajectory_peaks import peaks_as_dict, trajectory_peaks

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
    assert min(acceleration.time, duration - acceleration.time) == pytest.approx(
        duration * (0.5 - 0.5 / np.sqrt(3)), abs=1e-4
    )
    assert (acceleration.joint, acceleration.unit) == ("turn", "rad/s^2")
    assert speed.value == pytest.approx(PEAK_VELOCITY * ANGLE * LEVER / duration)
    assert speed.time == pytest.approx(duration / 2, abs=1e-3)
    assert speed.joint is None


def test_turning_evenly_accelerates_the_tool_towards_the_axis(bar):
    rate = 3.0  # [rad/s]
    even = JointTrajectory(["turn"], [0, 1.0], [[[rate]], [[0.0]]])
    peaks = trajectory_peaks(bar, even)
    assert peaks.peak_acceleration.value == 0
    assert peaks.tool_acceleration.value == pytest.approx(rate**2 * LEVER)


def test_a_jump_counts_on_both_its_sides(bar):
    """The larger acceleration ends at the breakpoint, or begins there."""
    for first, second in ((6.0, 2.0), (2.0, 6.0)):
        pieces = [[[first / 2], [second / 2]], [[0.0], [0.0]], [[0.0], [0.0]]]
        steps = JointTrajectory(["turn"], [0, 1e-3, 2e-3], pieces)
        peaks = trajectory_peaks(bar, steps)
        assert peaks.peak_acceleration.value == pytest.approx(6.0)
        assert peaks.tool_acceleration.value == pytest.approx(6.0 * LEVER, rel=1e-3)


@pytest.mark.parametrize("name", ["ur5/over_the_wall", "panda/between_shelves"])
def test_the_tool_s_peaks_are_those_of_its_path(name, stored):
    problem, trajectory = stored(name, "refinement")
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
    turned = trajectory.reordered(trajectory.joint_names[::-1])
    known = trajectory_peaks(problem.robot, trajectory)
    assert trajectory_peaks(problem.robot, turned) == known
    assert str(known).startswith("joint acceleration ")
    shown = peaks_as_dict(known)
    assert shown["peak_acceleration"]["joint"] in trajectory.joint_names
    assert dict.fromkeys(shown) == peaks_as_dict(None)
