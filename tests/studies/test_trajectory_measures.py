"""What a trajectory is measured by, against known cases."""

import numpy as np
import pytest

from cases import ANGLE, PEAK_JERK, quintic
from tubeplanner import JointTrajectory, Tube
from tubeplanner.studies.trajectory_measures import smoothness_class, trajectory_measures
from tubeplanner.trajectory.joint_trajectory import concatenate


def push(*rows, widths):
    """Return the trajectory of the slider with some accelerations, one after the other."""
    velocity = position = 0.0
    columns = []
    for acceleration, width in zip(rows, widths, strict=True):
        columns.append((acceleration / 2, velocity, position))
        position += velocity * width + acceleration / 2 * width**2
        velocity += acceleration * width
    times = np.concatenate([[0.0], np.cumsum(widths)])
    return JointTrajectory(["slide"], times, np.array(columns).T[:, :, None])


def test_smoothness_counts_what_does_not_jump():
    smooth = quintic()
    assert smoothness_class(smooth) == "C2"
    assert smoothness_class(smooth.between(0.0, 0.5)) == "C0"  # does not end at rest
    assert smoothness_class(push(5.0, -5.0, widths=(0.2, 0.2))) == "C1"
    away = JointTrajectory(["turn"], [0, 1], smooth.coefficients + np.eye(6)[5][:, None, None])
    assert smoothness_class(concatenate([smooth, away.scaled(2.0)])) == "none"


def test_shares_of_time_at_limits(slider):
    """At 5 m/s^2 the force is at its limit, at 4.94 below 99 % of it."""
    full = trajectory_measures(slider, push(5.0, -5.0, widths=(0.3, 0.3)))
    assert (full.at_limit, full.smoothness, full.peak_jerk) == (1.0, "C1", None)
    half = trajectory_measures(slider, push(5.0, -4.94, -5.06, widths=(0.3, 0.15, 0.15)))
    assert half.at_limit == pytest.approx(0.75, abs=1e-3)
    idle = trajectory_measures(slider, push(4.9, -4.9, widths=(0.3, 0.3)))
    assert idle.at_limit == 0.0


@pytest.mark.parametrize(
    ("offset", "tool_radius", "expected"), [(0.03, 0.0, 0.3), (0.03, 0.04, 0.5)]
)
def test_a_tool_beside_the_axis_uses_its_share_of_the_tube(slider, offset, tool_radius, expected):
    points = [[0, offset, 0], [0.6, offset, 0]]
    beside = slider.with_tube(Tube(points, 0.1, tool_radius=tool_radius))
    trajectory = push(5.0, -5.0, widths=(0.3, 0.3))
    assert trajectory_measures(beside, trajectory).tube_use == pytest.approx(expected, abs=1e-12)


def test_the_use_of_the_tube_is_averaged_over_time(slider):
    """At rest half of the time on the axis, then the axis ends and the tool goes on at 1 m/s."""
    short = slider.with_tube(Tube([[-0.5, 0, 0], [0.0, 0, 0]], 0.1))
    trajectory = JointTrajectory(["slide"], [0, 0.1, 0.2], [[[0], [1.0]], [[0], [0]]])
    assert trajectory_measures(short, trajectory).tube_use == pytest.approx(0.25, abs=1e-9)


def test_the_peak_of_the_jerk_is_exact(slider):
    trajectory = quintic(duration=2.0)
    named = JointTrajectory(["slide"], trajectory.breakpoints, trajectory.coefficients)
    measures = trajectory_measures(slider, named)
    assert measures.peak_jerk == pytest.approx(PEAK_JERK * ANGLE / 8, rel=1e-9)
    assert measures.peak_jerk_joint == "slide"
