"""Smoothed bang-bang control: the same path with an average of its time parameterization.

The average is C2 and begins and ends at rest without acceleration. Where that violates a limit, the
time parameterization is slowed locally before it is averaged again; the rest is slowed uniformly.
Finer averages cost ever less: the allowed jerk sets the price of smoothness.
"""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import minimum_filter1d

from tubeplanner.arrays import FloatArray
from tubeplanner.baselines.time_parameterization import averaged_parameterization, run_along
from tubeplanner.baselines.tool_path import ToolPath
from tubeplanner.constraints.time_scaling import (
    estimated_duration,
    scaled_to_limits,
    scaling_factor,
)
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, concatenate

_ROUNDS = 8
_SAMPLES_PER_INTERVAL = 8  # at the limits, per interval
# A round's slowing is spread over neighbouring intervals too, in steps.
_WINDOW, _POWER, _MAX_GAIN = 2 * _SAMPLES_PER_INTERVAL + 1, 0.6, 1.2


def smoothed_trajectory(
    problem: PlanningProblem,
    paths: Sequence[ToolPath],
    timings: Sequence[JointTrajectory],
    intervals: Sequence[int],
) -> JointTrajectory:
    """Return paths run by averaged time parameterizations, each at its limits: C2, degree 9.

    Args:
        problem: The planning problem.
        paths: From rest to rest.
        timings: Their `bang_bang_parameterizations`.
        intervals: For every path, into how many intervals its time parameterization is averaged.
    """
    runs = zip(paths, timings, intervals, strict=True)
    return concatenate(
        [_smoothed(problem, path.joints, timing, count) for path, timing, count in runs]
    )


def _smoothed(
    problem: PlanningProblem, path: JointTrajectory, timing: JointTrajectory, intervals: int
) -> JointTrajectory:
    """Return the fastest trajectory of all rounds, slowed until it keeps the limits."""
    factor, shortest, best = np.ones(len(timing.widths)), np.inf, path
    for _ in range(_ROUNDS):
        smooth = averaged_parameterization(_stretched(timing, factor), intervals)
        trajectory = run_along(path, smooth)
        duration = estimated_duration(problem, trajectory)
        if duration < shortest:
            shortest, best = duration, trajectory
        speed_factor = _speed_factor(
            problem, trajectory, smooth, timing, _SAMPLES_PER_INTERVAL * intervals
        )
        factor = factor / np.minimum(speed_factor, _MAX_GAIN) ** _POWER
    return scaled_to_limits(problem, best)


def _stretched(timing: JointTrajectory, factor: FloatArray) -> JointTrajectory:
    """Return a time parameterization whose pieces last longer by given factors, (pieces,)."""
    powers = np.arange(len(timing.coefficients) - 1, -1, -1)
    times = np.concatenate([[0.0], np.cumsum(factor * timing.widths)])
    rows = timing.coefficients / (factor ** powers[:, None])[:, :, None]
    return JointTrajectory(timing.joint_names, times, rows)


def _speed_factor(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    smooth: JointTrajectory,
    timing: JointTrajectory,
    count: int,
) -> FloatArray:
    """Return how many times faster the limits allow a run, at each piece."""
    samples = trajectory.at(np.linspace(0, trajectory.duration, count + 1))
    factor = scaling_factor(problem, samples.position, samples.velocity, samples.acceleration)
    least = minimum_filter1d(factor, _WINDOW)
    middle = timing.position((timing.breakpoints[:-1] + timing.breakpoints[1:]) / 2)[:, 0]
    return np.interp(middle, smooth.position(samples.time)[:, 0], least)
