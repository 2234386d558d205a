"""The list of all speed limits of a problem; the shortest duration of a shape under them."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.checks import checked_row
from tubeplanner.errors import OptionError, TrajectoryError, shown
from tubeplanner.limits.holding_limit import HoldingLimit
from tubeplanner.limits.joint_efforts import EffortLimit, EffortRate, JointEffort, MotorCurve
from tubeplanner.limits.path_samples import (
    CoulombFriction,
    PathSamples,
    SpeedLimit,
    directed_friction,
)
from tubeplanner.limits.peaks import refined_maximum, refined_maximum_of_pieces
from tubeplanner.limits.rates import (
    RATES,
    JointRate,
    PointSpeedLimit,
    ToolAcceleration,
    ToolSpeed,
    VelocityByPositionLimit,
)
from tubeplanner.limits.tube_membership import current_segments, nearest_segments
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.parts import CommonIntervals, common_intervals
from tubeplanner.trajectory.polynomials import bernstein_coefficients, peak_magnitudes


def speed_limits(problem: PlanningProblem) -> tuple[SpeedLimit, ...]:
    """Return the limits on a trajectory's speed that a problem has."""
    limits, motors = problem.robot.limits, problem.robot.motors
    is_unsure = motors.has_friction and motors.friction_uncertainty > 0
    needs_ranges = motors.has_coulomb_friction or limits.effort_ranges or is_unsure
    rates = [JointRate(kind, getattr(limits, kind)) for kind in RATES]
    candidates: tuple[SpeedLimit, ...] = (
        EffortLimit(limits) if needs_ranges else JointEffort(limits.effort),
        MotorCurve(motors),
        EffortRate(limits.effort_rate),
        *rates,
        VelocityByPositionLimit(limits),
        ToolSpeed(problem),
        ToolAcceleration(problem),
        PointSpeedLimit(limits.point_speed),
        HoldingLimit(problem),
    )
    return tuple(limit for limit in candidates if limit.keys)


def largest_use(at: PathSamples, limits: tuple[SpeedLimit, ...]) -> FloatArray:
    """Return the largest used fraction of some limits at a speed of 1, shape (N,)."""
    used = np.zeros(len(at))
    for limit in limits:
        fraction = limit.used(at).at(1.0)
        used = np.maximum(used, np.max([sign * fraction for sign in limit.signs], axis=(0, 2)))
    return used


def rates_and_others(
    limits: tuple[SpeedLimit, ...],
) -> tuple[list[JointRate], tuple[SpeedLimit, ...]]:
    """Return limits on the joints' rates, which are polynomials over time, and all others."""
    rates = [limit for limit in limits if isinstance(limit, JointRate)]
    return rates, tuple(limit for limit in limits if not isinstance(limit, JointRate))


def largest_speeds(at: PathSamples, limits: tuple[SpeedLimit, ...]) -> FloatArray:
    """Return the largest speed at which each sample keeps some limits, shape (N,); inf if any does.

    Limits on a derivative that the samples do not have are left out.
    """
    result = np.full(len(at), np.inf)
    for limit in limits:
        if limit.order >= len(at.by_path):
            continue
        result = np.minimum(result, limit.used(at).largest_speed(limit.signs).min(axis=1))
    return result


_MEAN_SAMPLES = 1000


def unused_speed(problem: PlanningProblem, trajectory: JointTrajectory) -> float:
    """Return the mean over time of 1 - 1/b(t), the unused fraction of the speed, from 0 to 1.

    The limits, jerk included, would let the trajectory run b(t) times faster at that instant (Suh &
    Bishop 1988, property 2). Where b is 1, some limit is fully used; the fastest trajectory of a
    tube uses one nearly everywhere.
    """
    time = (np.arange(_MEAN_SAMPLES) + 0.5) * trajectory.duration / _MEAN_SAMPLES
    at = trajectory.at(time)
    if not at.velocity.any():  # at rest there is no speed to use
        return 0.0
    state = np.stack([at.position, at.velocity, at.acceleration, trajectory.jerk(time)])
    samples = PathSamples(problem, state, lambda: current_segments(problem, trajectory, at))
    factor = largest_speeds(samples, speed_limits(problem))
    with np.errstate(divide="ignore"):
        return float(np.mean(1 - 1 / np.maximum(factor, 1.0)))


# ---- The shortest duration of a fixed shape under all limits.

# Samples: with many pieces, fewer of each.
_MIN_PER_PIECE, _MAX_PER_PIECE, _ENOUGH_IN_ALL = 12, 24, 1000
# Valleys of the factor this near the smallest sample (relative) are refined.
_VALLEY_FRACTION = 0.02
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
    """Return the factor b(t) by which the limits allow a trajectory to run faster at each sample.

    Args:
        problem: The planning problem.
        q: Positions, shape (N, n) [rad or m].
        v: Velocities, shape (N, n) [rad/s or m/s].
        a: Accelerations, shape (N, n) [rad/s^2 or m/s^2].
        jerk: Shape (N, n) [rad/s^3 or m/s^3]; None: limits that depend on it do not count.
        segment: The tube segment of each sample, shape (N,); None: the nearest to the tool.

    Returns:
        Shape (N,); inf where nothing limits, 0 where gravity alone needs a motor's whole effort.
        (Suh & Bishop 1988, property 2: b_ij; they have limits of velocity and effort alone.)

    Raises:
        ProblemError: The problem is none.
        TrajectoryError: Samples have another shape or are not finite.
        OptionError: A segment does not exist.
    """
    PlanningProblem.require(problem)
    state = _checked_state(problem, (q, v, a) if jerk is None else (q, v, a, jerk))
    if segment is not None:
        count, last = len(state[0]), problem.tube.segment_count - 1
        expected = f"{count} whole numbers from 0 to {last}"
        row = checked_row("segment", segment, expected)
        if len(row) != count or not all(isinstance(k, int) and 0 <= k <= last for k in row):
            raise OptionError(f"segment is {shown(row)}; give {expected}")
        segment = np.array(row, dtype=np.int64)
    return largest_speeds(_samples(problem, state, segment), speed_limits(problem))


def minimum_duration(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    *,
    with_jerk: bool = True,
    segments: IntArray | None = None,
) -> float:
    """Return the shortest duration [s] of a trajectory's shape under all limits on its speed.

    Velocity, acceleration and jerk are exact for all t; others are the highest of their peaks at 12
    to 24 samples per polynomial piece, refined around the highest samples. Quantities that depend
    on jerk are examined piece by piece: jerk may jump at breakpoints.

    Args:
        problem: The planning problem.
        trajectory: The shape.
        with_jerk: Whether limits that depend on jerk count; False where the acceleration jumps.
        segments: The tube segment of each polynomial piece, shape (pieces,); None: the nearest to
            the tool.

    Raises:
        Infeasible: Status gravity_exceeds_effort.
    """
    limits = speed_limits(problem)
    limits = tuple(limit for limit in limits if with_jerk or limit.order < _JERK)
    rates, others = rates_and_others(limits)
    # Limits that depend on jerk jump at breakpoints; with Coulomb friction, all others jump too.
    has_friction = problem.robot.motors.has_coulomb_friction
    jumping = tuple(limit for limit in others if has_friction or limit.order >= _JERK)
    smooth = tuple(limit for limit in others if limit not in jumping)
    factor = min(
        _rate_factor(rates, trajectory, exact=True),
        _least(problem, smooth, trajectory, segments),
        _least_of_intervals(problem, jumping, trajectory, segments),
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
    needs_jerk = any(limit.order >= _JERK for limit in others)
    parts: list[tuple[FloatArray, ...]] = []
    for shape in shapes:
        state = _state(shape.per_piece(_MIN_PER_PIECE))
        parts.append((*state, shape.jerk_per_piece(_MIN_PER_PIECE)) if needs_jerk else state)
    first = np.cumsum([0, *(len(part[0]) for part in parts[:-1])])
    states = tuple(np.concatenate(rows) for rows in zip(*parts, strict=True))
    sampled = np.minimum.reduceat(_held_factor(problem, others, states, None), first)
    polynomial = [_rate_factor(rates, shape, exact=False) for shape in shapes]
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


def _checked_state(problem: PlanningProblem, rows: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
    """Return samples of positions and their derivatives, as many of each, (N, n).

    Raises:
        TrajectoryError: An array has no numbers, another shape, or is not finite.
    """
    state, joints = [], problem.robot.joint_count
    for name, values in zip(("q", "v", "a", "jerk"), rows, strict=False):
        try:
            state.append(read_only(values))
        except (TypeError, ValueError):
            raise TrajectoryError(f"{name} is {shown(values)}; give an array (N, n)") from None
        shape = state[-1].shape
        if len(shape) != 2 or shape[1] != joints or shape != state[0].shape or not shape[0]:
            raise TrajectoryError(
                f"{name} has the shape {shape}; give (N, {joints}), as many samples of each"
            )
        if not np.isfinite(state[-1]).all():
            raise TrajectoryError(f"{name} has values that are not finite")
    return tuple(state)


def _rate_factor(rates: list[JointRate], trajectory: JointTrajectory, *, exact: bool) -> float:
    """Return the largest b that limits of velocity, acceleration and jerk allow.

    From the exact peaks of the polynomials, or from upper bounds by Bernstein coefficients.
    """
    factor, widths = np.inf, trajectory.widths
    for limit in rates:
        coefficients = trajectory.derivative_coefficients(limit.order)[:, :, limit.joints]
        if exact:
            peaks = peak_magnitudes(coefficients, widths).value
        else:
            hull = bernstein_coefficients(coefficients, np.zeros_like(widths), widths)
            peaks = abs(hull).max(axis=(0, 1))
        used = float((peaks / limit.limit).max())
        if used > 0:
            factor = min(factor, (1 / used) ** (1 / limit.order))
    return factor


def _least(
    problem: PlanningProblem,
    limits: tuple[SpeedLimit, ...],
    trajectory: JointTrajectory,
    segments: IntArray | None,
) -> float:
    """Return the smallest factor over time, its valleys refined between samples."""
    enough = _ENOUGH_IN_ALL // len(trajectory.widths)
    count = min(max(enough, _MIN_PER_PIECE), _MAX_PER_PIECE)
    samples = trajectory.per_piece(count)
    own = None if segments is None else np.repeat(segments, count)
    factor = _held_factor(problem, limits, _state(samples), own)
    least = float(factor.min())
    if not np.isfinite(least):
        return least

    def negative(time: FloatArray) -> FloatArray:
        piece = np.searchsorted(trajectory.breakpoints[1:-1], time, side="right")
        own = None if segments is None else segments[piece]
        return -_held_factor(problem, limits, _state(trajectory.at(time)), own)

    highest, _ = refined_maximum(negative, samples.time, -factor, band=_VALLEY_FRACTION * least)
    return -highest


def _least_of_intervals(
    problem: PlanningProblem,
    limits: tuple[SpeedLimit, ...],
    trajectory: JointTrajectory,
    segments: IntArray | None,
) -> float:
    """Return the smallest factor inside intervals of pieces, its valleys refined between samples.

    The factor may jump where pieces begin, or joints reverse.
    """
    if not limits:
        return np.inf
    motors = problem.robot.motors
    if motors.has_coulomb_friction:
        intervals = common_intervals(trajectory)
    else:  # whole pieces: directions do not matter
        pieces = len(trajectory.widths)
        none = np.zeros((pieces, len(trajectory.joint_names)))
        intervals = CommonIntervals(np.arange(pieces), np.zeros(pieces), np.ones(pieces), none)

    def negative(interval: IntArray, fraction: FloatArray) -> FloatArray:
        piece, begin = intervals.piece[interval], intervals.start[interval]
        position = begin + fraction * (intervals.end[interval] - begin)
        local = position * trajectory.widths[piece]
        state = tuple(trajectory.within(piece, local, order) for order in range(_JERK + 1))
        own = None if segments is None else segments[piece]
        friction = partial(directed_friction, motors, intervals.direction[interval])
        return -_held_factor(problem, limits, state, own, friction)

    count, fraction = len(intervals.piece), np.linspace(0, 1, _MIN_PER_PIECE)
    value = negative(np.repeat(np.arange(count), len(fraction)), np.tile(fraction, count))
    band = _VALLEY_FRACTION * float(-value.max())
    return -refined_maximum_of_pieces(negative, value.reshape(count, -1), band=band)


def _state(samples: TrajectorySamples) -> tuple[FloatArray, FloatArray, FloatArray]:
    return samples.position, samples.velocity, samples.acceleration


def _held_factor(
    problem: PlanningProblem,
    limits: tuple[SpeedLimit, ...],
    state: tuple[FloatArray, ...],
    segment: IntArray | None,
    friction: Callable[[], CoulombFriction] | None = None,
) -> FloatArray:
    """Return the smallest factor of each sample, (N,).

    Raises:
        Infeasible: No speed is slow enough for a limit at some sample.
    """
    at = _samples(problem, state, segment, friction)
    result = np.full(len(at), np.inf)
    for limit in limits:
        factor = largest_speeds(at, (limit,))
        if (factor == 0).any():
            raise limit.refusal(at)
        result = np.minimum(result, factor)
    return result


def _samples(
    problem: PlanningProblem,
    state: tuple[FloatArray, ...],
    segment: IntArray | None,
    friction: Callable[[], CoulombFriction] | None = None,
) -> PathSamples:
    """Return samples of a trajectory, in known segments or else the nearest to the tool."""

    def segments() -> IntArray:
        return nearest_segments(problem, at.tool_pose[1]) if segment is None else segment

    at = PathSamples(problem, np.stack(state), segments, friction)
    return at
