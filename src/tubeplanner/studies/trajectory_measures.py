"""Measures for comparing trajectories: smoothness, jerk, use of the motors and of the tube."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limits import largest_use, speed_limits
from tubeplanner.constraints.tube_membership import current_segments, tube_use
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.short_repr import short_repr
from tubeplanner.trajectory.bernstein import peak_magnitudes
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples

AT_LIMIT = 0.99  # of a limit: a motor that uses as much counts as at its limit
_SAMPLES = 2000  # in the middles of equal times
_SAME = 1e-6  # jumps below this share of a joint's largest value are rounding errors
_STILL_SHARE = 1e-6  # a joint that moves less than this share of the fastest stands still


@dataclass(frozen=True)
class TrajectoryMeasures:
    """Measures of a trajectory.

    Attributes:
        smoothness: "C2": position, velocity and acceleration are continuous, also at the ends,
            where the arm rests; "C1": the acceleration jumps; "C0": the velocity does; "none".
        peak_jerk: The largest magnitude of any joint's third derivative [rad/s^3 or m/s^3]; None
            where the acceleration jumps: there is no bound.
        peak_jerk_joint: Whose it is; likewise.
        at_limit: Share of the time in which some limit on the speed other than jerk, such as a
            joint's effort, velocity or acceleration, is used by 99 % or more.
        tube_use: Distance of the tool from the axis of the segment it is in, as a share of that
            segment's radius, averaged over time.
    """

    smoothness: str
    peak_jerk: float | None
    peak_jerk_joint: str | None
    at_limit: float
    tube_use: float

    __repr__ = short_repr

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)


def trajectory_measures(
    problem: PlanningProblem, trajectory: JointTrajectory
) -> TrajectoryMeasures:
    """Measure a trajectory.

    Smoothness and jerk are read from the polynomials; shares of time are counted at 2,000 instants.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    smoothness = smoothness_class(trajectory)
    peak, joint = _peak_jerk(trajectory) if smoothness == "C2" else (None, None)
    middles = (np.arange(_SAMPLES) + 0.5) / _SAMPLES * trajectory.duration
    samples = trajectory.at(middles)
    tool = problem.robot.tool_position(samples.position)
    segment = current_segments(problem, trajectory, samples)
    return TrajectoryMeasures(
        smoothness,
        peak,
        joint,
        float((_limit_use(problem, samples, segment) >= AT_LIMIT).mean()),
        float(tube_use(problem, tool, segment).mean()),
    )


def smoothness_class(trajectory: JointTrajectory) -> str:
    """Return "C2", "C1", "C0" or "none": how many derivatives have no jumps.

    Jumps are measured between neighbouring pieces and, of velocity and acceleration, against the
    rest before the start and after the end; those below 1e-6 of a joint's largest value are
    rounding errors.
    """
    ends = trajectory.per_piece(2)
    rows = (ends.position, ends.velocity, ends.acceleration)
    largest = [abs(row).max(axis=0) for row in rows]
    for order, (values, most) in enumerate(zip(rows, largest, strict=True)):
        jumps = abs(values[2::2] - values[1:-1:2])
        if order > 0:
            jumps = np.vstack([jumps, abs(values[[0, -1]])])
        allowed = _SAME * np.maximum(most, _STILL_SHARE * max(float(most.max()), 1e-300))
        if (jumps > allowed).any():
            return ("none", "C0", "C1")[order]
    return "C2"


def _peak_jerk(trajectory: JointTrajectory) -> tuple[float, str]:
    """Return the largest jerk for all t, and whose it is."""
    peaks = peak_magnitudes(trajectory.derivative_coefficients(3), trajectory.widths).value
    joint = int(peaks.argmax())
    return float(peaks[joint]), trajectory.joint_names[joint]


def _limit_use(
    problem: PlanningProblem, samples: TrajectorySamples, segment: IntArray
) -> FloatArray:
    """Return the largest share of a limit on the speed in use, jerk left out, shape (N,)."""
    known = np.stack([samples.position, samples.velocity, samples.acceleration])
    at = PathSamples(problem, known, lambda: segment)
    return largest_use(at, tuple(lim for lim in speed_limits(problem) if lim.order < 3))
