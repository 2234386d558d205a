"""The condition on the tool's acceleration, against closed forms and dense samples."""

from dataclasses import replace

import numpy as np
import pytest
from cases import anywhere, one_joint, quintic

from tubeplanner import LimitOverrides, ToolOffset, load_robot, verify

LEVER, DURATION, ANGLE = 0.5, 1.3, 1.7
TIMES = np.linspace(0.0, 1.0, 100_001)


def limited(problem, limit):
    robot = problem.robot
    limits = replace(robot.limits, tool_acceleration=limit)
    return replace(problem, robot=robot.with_limits(limits, robot.motors))


def dense_peak(problem, trajectory):
    """Return the largest acceleration of samples, by differences of the tool's positions."""
    step = 1e-4
    time = step + TIMES * (trajectory.duration - 2 * step)
    before, at, after = (
        problem.robot.tool_position(trajectory.position(time + shift))
        for shift in (-step, 0.0, step)
    )
    return np.linalg.norm((before - 2 * at + after) / step**2, axis=1).max()


@pytest.mark.parametrize("fraction", [1 - 1e-5, 1 + 1e-5])
def test_a_bar_that_turns_has_both_accelerations_of_its_lever(tmp_path, fraction):
    """Along the circle and towards its middle; a hundred thousandth decides."""
    one_joint(tmp_path)
    offset = ToolOffset(position=(0.3, 0.4, 0.7))
    s, end = TIMES, ANGLE / DURATION
    rate = end * (30 * s**2 - 60 * s**3 + 30 * s**4)
    change = end / DURATION * (60 * s - 180 * s**2 + 120 * s**3)
    peak = LEVER * np.hypot(change, rate**2).max()
    robot = load_robot(
        tmp_path / "bar.urdf",
        "bar",
        tool_offset=offset,
        limits=LimitOverrides(tool_acceleration=peak * fraction),
    )
    certificate = verify(anywhere(robot), quintic(ANGLE, DURATION))
    condition = certificate.conditions["tool_acceleration"]
    assert condition.margin == pytest.approx(1 - 1 / fraction, abs=3e-7)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")
    assert ("tool_acceleration" in certificate.failures()) == (fraction < 1)


@pytest.mark.parametrize("name", ["two_link/around_a_post", "ur5/over_the_wall"])
def test_no_dense_sample_is_above_what_is_proved(stored, name):
    problem, trajectory = stored(name)
    peak = dense_peak(problem, trajectory)
    for limit, holds in ((peak * 1.0001, True), (peak * 0.999, False)):
        certificate = verify(limited(problem, limit), trajectory)
        assert ("tool_acceleration" not in certificate.failures()) == holds
        assert certificate.conditions["tool_acceleration"].margin == pytest.approx(
            1 - peak / limit, abs=1e-4
        )


def test_without_a_limit_it_is_not_required(stored):
    condition = verify(*stored("two_link/around_a_post")).conditions["tool_acceleration"]
    assert (condition.margin, condition.coverage) == (None, "the tool's acceleration is free")
