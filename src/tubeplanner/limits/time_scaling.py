"""The shortest duration of a fixed shape under all limits."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import given_row
from tubeplanner.errors import OptionError, TrajectoryError, shown
from tubeplanner.limits.path_samples import (
    CoulombFriction,
    PathSamples,
    SpeedLimit,
    directed_friction,
)
from tubeplanner.limits.peaks import refined_maximum, refined_maximum_of_pieces
from tubeplanner.limits.rates import RATES, JointRate
from tubeplanner.limits.speed_limits import largest_speeds, rates_and_others, speed_limits
from tubeplanner.limits.tube_membership import nearest_segments
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.parts import CommonStretches, common_stretches
from tubeplanner.trajectory.polynomials import bernstein_coefficients, peak_magnitudes

# Where pieces are many, each has the fewer.
_FEWEST_PER_PIECE, _MOST_PER_PIECE, _ENOUGH_IN_ALL = 12, 24, 1000
# Valleys of the factor this near the smallest sample (relative) are refined.
_VALLEY_SHARE = 0.02
# Rounding must not put a trajectory outside a limit it is scaled to meet exactly.
_SAFETY = 1e-8
_JERK = RATES["jerk"]


def scaling_factor(
    problem: PlanningProblem,
    q: FloatArray,
    v: FloatArray,
    a: FloatArray,
    jerk: FloatArray | None = None,
    *,
    segment: IntArray | None = None,
) -> FloatArray:
    """Return how many times faster the limits allow a trajectory to run at each sample: b(t).

    Args:
        problem: The planning problem.
        q: Positions, shape (N, n) [rad or m].
        v: Velocities, shape (N, n) [rad/s or m/s].
        a: Accelerations, shape (N, n) [rad/s^2 or m/s^2].
        jerk: Shape (N, n) [rad/s^3 or m/s^3]; None: limits that depend on it do not count.
        segment: The tube segment of each sample, shape (N,); None: the one the tool is nearest to.

    Returns:
        Shape (N,); inf where nothing limits, 0 where gravity alone needs a motor's whole effort.
        (Suh & Bishop 1988, property 2: b_ij; they have limits of velocity and effort alone.)

    Raises:
        ProblemError: The problem is none.
        TrajectoryError: Samples have another shape or are not finite.
        OptionError: A segment does not exist.
    """
    PlanningProblem.require(problem)
    known = _given_samples(problem, (q, v, a) if jerk is None else (q, v, a, jerk))
    if segment is not None:
        segment = _given_segments(problem, segment, len(known[0]))
    return largest_speeds(_samples(problem, known, segment), speed_limits(problem))


def minimum_duration(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    *,
    with_jerk: bool = True,
    segments: IntArray | None = None,
) -> float:
    """Return the shortest duration [s] of a trajectory's shape under all limits on its speed.

    Velocity, acceleration and jerk are exact for all t; others are the highest of their peaks,
    found from 12 to 24 samples per polynomial piece and refined around the highest ones. What
    depends on jerk is looked at in every piece by itself: it may jump at breakpoints.

    Args:
        problem: The planning problem.
        trajectory: The shape.
        with_jerk: Whether limits that depend on jerk count; False where the acceleration jumps.
        segments: The tube segment of each polynomial piece, shape (pieces,); None: wherever the
            tool is, the nearest.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    limits = speed_limits(problem)
    limits = tuple(limit for limit in limits if with_jerk or limit.order < _JERK)
    rates, others = rates_and_others(limits)
    jumping = others if problem.robot.motors.has_coulomb_friction else _with_jerk(others)
    smooth = tuple(limit for limit in others if limit not in jumping)
    factor = min(
        _rate_factor(rates, trajectory, _exact_peaks),
        _least(problem, smooth, trajectory, segments),
        _least_of_stretches(problem, jumping, trajectory, segments),
    )
    return trajectory.duration / factor * (1 + _SAFETY)


def estimated_duration(problem: PlanningProblem, trajectory: JointTrajectory) -> float:
    """Return a quick estimate of `minimum_duration` [s], as `estimated_durations`."""
    return float(estimated_durations(problem, [trajectory])[0])


def estimated_durations(problem: PlanningProblem, shapes: Sequence[JointTrajectory]) -> FloatArray:
    """Return quick estimates of the `minimum_duration` of S shapes, to choose from: (S,) [s].

    Velocity, acceleration and jerk are bounded from above; others are not refined between samples.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    rates, others = rates_and_others(speed_limits(problem))
    orders = max((limit.order for limit in others), default=0) + 1
    parts = [_known_per_piece(shape, _FEWEST_PER_PIECE, orders) for shape in shapes]
    first = np.cumsum([0, *(len(part[0]) for part in parts[:-1])])
    known = tuple(np.concatenate(rows) for rows in zip(*parts, strict=True))
    sampled = np.minimum.reduceat(_held_factor(problem, others, known, None), first)
    polynomial = [_rate_factor(rates, shape, _hull_peaks) for shape in shapes]
    duration = np.array([shape.duration for shape in shapes])
    return duration / np.minimum(polynomial, sampled)


def scaled_to_limits(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    *,
    with_jerk: bool = True,
    segments: IntArray | None = None,
) -> JointTrajectory:
    """Return the trajectory's shape, run in its `minimum_duration`.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    duration = minimum_duration(problem, trajectory, with_jerk=with_jerk, segments=segments)
    return trajectory.scaled(duration / trajectory.duration)


def _rate_factor(
    rates: list[JointRate],
    trajectory: JointTrajectory,
    peaks: Callable[[FloatArray, FloatArray], FloatArray],
) -> float:
    """Return the largest b that limits of velocity, acceleration and jerk allow."""
    factor = np.inf
    for limit in rates:
        coefficients = trajectory.derivative_coefficients(limit.order)[:, :, limit.joints]
        used = float((peaks(coefficients, trajectory.widths) / limit.limit).max())
        if used > 0:
            factor = min(factor, (1 / used) ** (1 / limit.order))
    return factor


def _exact_peaks(coefficients: FloatArray, widths: FloatArray) -> FloatArray:
    """Return the largest magnitudes of piecewise polynomials, shape (n,)."""
    return peak_magnitudes(coefficients, widths).value


def _hull_peaks(coefficients: FloatArray, widths: FloatArray) -> FloatArray:
    """Return upper bounds on the largest magnitudes, from Bernstein coefficients."""
    hull = bernstein_coefficients(coefficients, np.zeros_like(widths), widths)
    return abs(hull).max(axis=(0, 1))


def _least(
    problem: PlanningProblem,
    limits: tuple[SpeedLimit, ...],
    trajectory: JointTrajectory,
    segments: IntArray | None,
) -> float:
    """Return the smallest factor over time, its valleys refined between samples."""
    enough = _ENOUGH_IN_ALL // len(trajectory.widths)
    count = min(max(enough, _FEWEST_PER_PIECE), _MOST_PER_PIECE)
    samples = trajectory.per_piece(count)
    own = None if segments is None else np.repeat(segments, count)
    factor = _held_factor(problem, limits, _known(samples), own)
    least = float(factor.min())
    if not np.isfinite(least):
        return least

    def negative(time: FloatArray) -> FloatArray:
        piece = np.searchsorted(trajectory.breakpoints[1:-1], time, side="right")
        own = None if segments is None else segments[piece]
        return -_held_factor(problem, limits, _known(trajectory.at(time)), own)

    highest, _ = refined_maximum(negative, samples.time, -factor, band=_VALLEY_SHARE * least)
    return -highest


def _least_of_stretches(
    problem: PlanningProblem,
    limits: tuple[SpeedLimit, ...],
    trajectory: JointTrajectory,
    segments: IntArray | None,
) -> float:
    """Return the smallest factor inside stretches of pieces, its valleys refined between samples.

    Where pieces begin, or joints reverse, it may jump.
    """
    if not limits:
        return np.inf
    motors = problem.robot.motors
    stretches = common_stretches(trajectory) if motors.has_coulomb_friction else _whole(trajectory)

    def negative(stretch: IntArray, share: FloatArray) -> FloatArray:
        piece, begin = stretches.piece[stretch], stretches.start[stretch]
        place = begin + share * (stretches.end[stretch] - begin)
        local = place * trajectory.widths[piece]
        known = tuple(trajectory.within(piece, local, order) for order in range(_JERK + 1))
        own = None if segments is None else segments[piece]
        friction = partial(directed_friction, motors, stretches.direction[stretch])
        return -_held_factor(problem, limits, known, own, friction)

    count, share = len(stretches.piece), np.linspace(0, 1, _FEWEST_PER_PIECE)
    value = negative(np.repeat(np.arange(count), len(share)), np.tile(share, count))
    band = _VALLEY_SHARE * float(-value.max())
    return -refined_maximum_of_pieces(negative, value.reshape(count, -1), band=band)


def _whole(trajectory: JointTrajectory) -> CommonStretches:
    """Return pieces as stretches, for limits that do not depend on directions."""
    pieces = len(trajectory.widths)
    none = np.zeros((pieces, len(trajectory.joint_names)))
    return CommonStretches(np.arange(pieces), np.zeros(pieces), np.ones(pieces), none)


def _with_jerk(limits: tuple[SpeedLimit, ...]) -> tuple[SpeedLimit, ...]:
    """Return the limits that jump where the jerk does."""
    return tuple(limit for limit in limits if limit.order >= _JERK)


def _known_per_piece(
    trajectory: JointTrajectory, count: int, orders: int
) -> tuple[FloatArray, ...]:
    """Return positions and derivatives at samples of every piece, three orders or four."""
    known = _known(trajectory.per_piece(count))
    return known if orders <= _JERK else (*known, trajectory.jerk_per_piece(count))


def _known(samples: TrajectorySamples) -> tuple[FloatArray, FloatArray, FloatArray]:
    return samples.position, samples.velocity, samples.acceleration


def _held_factor(
    problem: PlanningProblem,
    limits: tuple[SpeedLimit, ...],
    known: tuple[FloatArray, ...],
    segment: IntArray | None,
    friction: Callable[[], CoulombFriction] | None = None,
) -> FloatArray:
    """Return the smallest factor of each sample, (N,), each of which the motors can hold."""
    at = _samples(problem, known, segment, friction)
    found = np.full(len(at), np.inf)
    for limit in limits:
        factor = largest_speeds(at, (limit,))
        if (factor == 0).any():
            raise limit.refusal(at)
        found = np.minimum(found, factor)
    return found


def _given_samples(problem: PlanningProblem, given: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
    """Return samples of positions and their derivatives, as many of each, (N, n).

    Raises:
        TrajectoryError: They are none.
    """
    known, joints = [], problem.robot.joint_count
    for name, values in zip(("q", "v", "a", "jerk"), given, strict=False):
        try:
            known.append(read_only(values))
        except (TypeError, ValueError):
            raise TrajectoryError(f"{name} is {shown(values)}; give an array (N, n)") from None
        shape = known[-1].shape
        if len(shape) != 2 or shape[1] != joints or shape != known[0].shape or not shape[0]:
            raise TrajectoryError(
                f"{name} has the shape {shape}; give (N, {joints}), as many samples of each"
            )
        if not np.isfinite(known[-1]).all():
            raise TrajectoryError(f"{name} has values that are not finite")
    return tuple(known)


def _given_segments(problem: PlanningProblem, given: IntArray, count: int) -> IntArray:
    """Return the segment of each of N samples, (N,).

    Raises:
        OptionError: They are none.
    """
    last = problem.tube.segment_count - 1
    row = given_row("segment", given, f"{count} whole numbers from 0 to {last}")
    if len(row) != count or not all(isinstance(k, int) and 0 <= k <= last for k in row):
        raise OptionError(f"segment is {shown(row)}; give {count} whole numbers from 0 to {last}")
    return np.array(row, dtype=np.int64)


def _samples(
    problem: PlanningProblem,
    known: tuple[FloatArray, ...],
    segment: IntArray | None,
    friction: Callable[[], CoulombFriction] | None = None,
) -> PathSamples:
    """Return samples of a trajectory, in the given segments or else those nearest to the tool."""

    def segments() -> IntArray:
        if segment is not None:
            return segment
        return nearest_segments(problem, at.tool_pose[1])

    at = PathSamples(problem, np.stack(known), segments, friction)
    return at
