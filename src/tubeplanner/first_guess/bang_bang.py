"""Baselines: bang-bang control of a fixed path, and its moving average.

A path is stored as the trajectory that runs it at unit speed, a time parameterization as the
trajectory of a single joint: the arc length along the path.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy.interpolate import PPoly
from scipy.ndimage import minimum_filter1d
from scipy.optimize import elementwise
from scipy.special import factorial

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.fastest_parameterization import fastest_parameterization
from tubeplanner.first_guess.tool_paths import ToolPath
from tubeplanner.limits.time_scaling import (
    estimated_duration,
    minimum_duration,
    scaled_to_limits,
    scaling_factor,
)
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, averaged, concatenate

# ---- Paths composed with time parameterizations: polynomials of polynomials, exactly.

_SAME_TIME = 1e-9  # of the duration: pieces shorter than this are none


def run_along(path: JointTrajectory, timing: JointTrajectory) -> JointTrajectory:
    """Return the trajectory along a path with a time parameterization.

    Args:
        path: Over the arc length, from 0 to its length.
        timing: The arc length over time, from 0 to the same length, never falling.

    Returns:
        The composition, exactly; its degree is the product of both degrees.
    """
    reached = times_at(timing, path.breakpoints[1:-1])
    nearest = abs(reached[:, None] - timing.breakpoints).min(axis=1)
    times = np.append(timing.breakpoints, reached[nearest > _SAME_TIME * timing.duration])
    times = np.sort(times)
    times = times[np.append(True, np.diff(times) > _SAME_TIME * timing.duration)]
    times[-1] = timing.duration
    middle = timing.position((times[:-1] + times[1:]) / 2)[:, 0]
    piece = np.clip(np.searchsorted(path.breakpoints, middle) - 1, 0, len(path.widths) - 1)
    # Coefficients of the arc length, (r+1, P), in the pieces between the new times.
    polynomial = PPoly(timing.coefficients[:, :, 0], timing.breakpoints)
    powers = np.arange(len(timing.coefficients) - 1, -1, -1)
    # Looked up at the middles, expanded about the starts: rounding cannot pick a neighbouring
    # piece.
    half = np.diff(times) / 2
    arc_length = np.array(
        [polynomial.derivative(p)(times[:-1] + half) / factorial(p) for p in powers]
    )
    for last in range(len(arc_length), 1, -1):  # repeated synthetic division
        for k in range(1, last):
            arc_length[k] += -half * arc_length[k - 1]
    # Horner's scheme in polynomials: coefficients of the composition, (degree*r+1, P, n).
    arc_length[-1] -= path.breakpoints[piece]
    rows = path.coefficients[:, piece]
    result = rows[:1]
    for row in rows[1:]:
        product = np.zeros((len(result) + len(arc_length) - 1, *row.shape))
        for power, factor in enumerate(arc_length):
            product[power : power + len(result)] += factor[:, None] * result
        product[-1] += row
        result = product
    return JointTrajectory(path.joint_names, times, result)


def times_at(timing: JointTrajectory, arc_length: FloatArray) -> FloatArray:
    """Return the times (N,) [s] at which a time parameterization reaches arc lengths (N,)."""
    if len(arc_length) == 0:
        return np.zeros(0)
    arc_length = np.clip(arc_length, timing.position(0.0), timing.position(timing.duration))
    times: FloatArray = elementwise.find_root(
        lambda t, arc_length: timing.position(t)[:, 0] - arc_length,
        (np.zeros(len(arc_length)), np.full(len(arc_length), timing.duration)),
        args=(arc_length,),
    ).x
    return times


def averaged_parameterization(timing: JointTrajectory, intervals: int) -> JointTrajectory:
    """Return the average over neighbouring intervals: a C2 cubic spline that never falls.

    Args:
        timing: The arc length over time.
        intervals: Number of equal intervals, at least 3; two come on top of its duration.
    """
    return averaged(timing, intervals, timing.duration * intervals / (intervals - 2))


# ---- Bang-bang control on given paths: the least time from rest to rest.
#
# At every instant some motor or velocity is at its limit, and motors switch instantly: the
# acceleration jumps. (Bobrow, Dubowsky & Gibson, "Time-optimal control of robotic manipulators
# along specified paths", 1985; Shin & McKay, 1985.)

# Steps between the points where limits are judged: of a whole path, and of each line or arc in it.
_PATH_STEPS, _PIECE_STEPS = 800, 400


def bang_bang_parameterizations(
    problem: PlanningProblem, paths: Sequence[ToolPath]
) -> list[JointTrajectory]:
    """Return the fastest time parameterization of each path, from rest to rest.

    Raises:
        Infeasible: Gravity exceeds a motor's effort, or no time parameterization is found.
    """
    timings = []
    for path in paths:
        breakpoints, length = path.joints.breakpoints, path.joints.duration
        least = max(_PATH_STEPS, _PIECE_STEPS * len(path.curve.start))
        counts = np.ceil(least * path.joints.widths / length).astype(int)
        parts = [
            np.linspace(begin, end, count, endpoint=False)
            for (begin, end), count in zip(pairwise(breakpoints), counts, strict=True)
        ]
        grid = np.append(np.concatenate(parts), length)
        timing = fastest_parameterization(problem, path.joints, grid)
        if timing is None:
            raise Infeasible(
                PlanStatus.NO_TRAJECTORY,
                f"segment {path.segment}: TOPP-RA finds no speed at which the arm can run the "
                "tool's curve from rest to rest; move the reference points",
                Location(segment=path.segment),
            )
        timings.append(timing)
    return timings


def bang_bang_trajectory(
    problem: PlanningProblem, paths: Sequence[ToolPath], timings: Sequence[JointTrajectory]
) -> tuple[JointTrajectory, float]:
    """Return the trajectory along paths with time parameterizations: degree 6, within limits.

    The time parameterizations keep the limits at points of their paths. All are slowed uniformly
    until limits hold in between too. Limits of jerk are left out, since the acceleration jumps.

    Returns:
        The trajectory, and the fraction by which it is slowed.
    """
    runs = [run_along(path.joints, timing) for path, timing in zip(paths, timings, strict=True)]
    trajectory = concatenate(runs)
    ratio = minimum_duration(problem, trajectory, with_jerk=False) / trajectory.duration
    return trajectory.scaled(ratio), ratio - 1


# ---- Smoothed bang-bang control: the same path with an average of its time parameterization.
#
# The average is C2 and begins and ends at rest without acceleration. Where that violates a limit,
# the time parameterization is slowed locally before it is averaged again; the rest is slowed
# uniformly. Finer averages cost ever less: the allowed jerk sets the price of smoothness.

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
        intervals: Number of intervals of each path's average.
    """
    runs = zip(paths, timings, intervals, strict=True)
    return concatenate(
        [_smoothed(problem, path.joints, timing, count) for path, timing, count in runs]
    )


def _smoothed(
    problem: PlanningProblem, path: JointTrajectory, timing: JointTrajectory, intervals: int
) -> JointTrajectory:
    """Return the fastest trajectory of all rounds, slowed until the limits hold."""
    factor, shortest, best = np.ones(len(timing.widths)), np.inf, path
    middle = timing.position((timing.breakpoints[:-1] + timing.breakpoints[1:]) / 2)[:, 0]
    powers = np.arange(len(timing.coefficients) - 1, -1, -1)
    for _ in range(_ROUNDS):
        stretched = np.concatenate([[0.0], np.cumsum(factor * timing.widths)])
        rows = timing.coefficients / (factor ** powers[:, None])[:, :, None]
        stretched_timing = JointTrajectory(timing.joint_names, stretched, rows)
        smooth = averaged_parameterization(stretched_timing, intervals)
        trajectory = run_along(path, smooth)
        duration = estimated_duration(problem, trajectory)
        if duration < shortest:
            shortest, best = duration, trajectory
        times = np.linspace(0, trajectory.duration, _SAMPLES_PER_INTERVAL * intervals + 1)
        samples = trajectory.at(times)
        allowed = scaling_factor(problem, samples.position, samples.velocity, samples.acceleration)
        least = minimum_filter1d(allowed, _WINDOW)
        speed_factor = np.interp(middle, smooth.position(samples.time)[:, 0], least)
        factor = factor / np.minimum(speed_factor, _MAX_GAIN) ** _POWER
    return scaled_to_limits(problem, best)
