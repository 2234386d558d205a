"""The list of all speed limits of a problem; use of each limit along a trajectory."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.limits.joint_efforts import EffortLimit, EffortRate, JointEffort, MotorCurve
from tubeplanner.limits.path_samples import LimitKey, PathSamples, SpeedLimit, directed_friction
from tubeplanner.limits.rates import (
    RATES,
    JointRate,
    PointSpeedLimit,
    ToolSpeed,
    VelocityByPositionLimit,
)
from tubeplanner.limits.speed_polynomial import SpeedPolynomial
from tubeplanner.limits.tube_membership import current_segments, tube_use
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.parts import monotone_intervals


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
        PointSpeedLimit(limits.point_speed),
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


# ---- The use of each limit along a trajectory, at samples on both sides of its breakpoints.

POSITION, TUBE, ROTATION = "position", "tube", "rotation"
_SAMPLES, _MIN_PER_PIECE = 800, 4


@dataclass(frozen=True, eq=False)
class LimitUse:
    """The used fraction of one limit.

    Attributes:
        kind: Of the limit, as the certificate calls it: "effort", "tool_speed", "tube".
        name: Of the limited part: a joint, "tool", or a point by number and link.
        fraction: At N samples, shape (N,): 1 at the limit, 0 where nothing of it is used.
        joint: Index of the joint; None: not a joint's limit.
        point: Index among the points whose speed is limited; None: not a point's limit.
    """

    kind: str
    name: str
    fraction: FloatArray
    joint: int | None = None
    point: int | None = None


@dataclass(frozen=True, eq=False)
class LimitUses:
    """The used fractions of all limits along a trajectory.

    Attributes:
        samples: The N samples; at a breakpoint two, which differ where a quantity jumps.
        segment: The tube segment of each, shape (N,).
        uses: Of each limit: of joints first, by joint, then of the tool, then of points.
    """

    samples: TrajectorySamples
    segment: IntArray
    uses: tuple[LimitUse, ...]

    def of(self, kind: str) -> list[LimitUse]:
        """Return the uses of one kind of limit."""
        return [use for use in self.uses if use.kind == kind]


def limit_uses(
    problem: PlanningProblem, trajectory: JointTrajectory, count: int | None = None
) -> LimitUses:
    """Return the used fractions of all limits along a trajectory.

    Of a position, the distance from the middle of the range that the segment allows; of the tube,
    `tube_use`; of the rotation tolerance, the largest of its bounds'; of limits on the speed, as
    `speed_limits` has them: a new kind of limit needs no line here.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        count: Samples of each polynomial piece, both its ends included; None:
            `samples_per_piece`.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    count = count or samples_per_piece(trajectory)
    samples = trajectory.per_piece(count)
    segment = current_segments(problem, trajectory, samples)
    jerk, motors = trajectory.jerk_per_piece(count), problem.robot.motors
    state = np.stack([samples.position, samples.velocity, samples.acceleration, jerk])
    friction = None
    if motors.has_coulomb_friction:  # at a breakpoint, each sample has that of its piece
        piece, sample = np.divmod(np.arange(len(segment)), count)
        direction = monotone_intervals(trajectory).at(piece, sample / (count - 1))
        friction = partial(directed_friction, motors, direction)
    at = PathSamples(problem, state, lambda: segment, friction)
    uses = _position_uses(problem, samples.position, segment)
    rotation, tool = at.tool_pose
    uses.append(LimitUse(TUBE, "tool", tube_use(problem, tool, segment)))
    if problem.tube.rotation is not None:
        error = problem.tube.rotation.error(rotation, tool, segment)
        angle = np.linalg.norm(error, axis=1, keepdims=True)
        bounds = problem.tube.rotation.bounds[segment]
        fraction = (np.hstack([abs(error), angle]) / bounds).max(axis=1)
        uses.append(LimitUse(ROTATION, "tool", fraction))
    for limit in speed_limits(problem):
        uses += _uses_of(limit, at)
    uses.sort(key=lambda use: (use.joint is None, use.joint or 0, use.point is not None))
    return LimitUses(samples, segment, tuple(uses))


def samples_per_piece(trajectory: JointTrajectory) -> int:
    """Return the number of samples of each piece for a figure: 800 in all, at least 4 each."""
    return max(_MIN_PER_PIECE, _SAMPLES // len(trajectory.widths))


def _position_uses(problem: PlanningProblem, q: FloatArray, segment: IntArray) -> list[LimitUse]:
    """Return the joints' distances from the middle of their ranges; unbounded joints are left out.

    Of a range that is open on one side, the middle is where the motion is farthest from its end.
    """
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    bounded = np.flatnonzero((np.isfinite(lower) | np.isfinite(upper)).any(axis=0))
    low = np.where(np.isfinite(lower), lower, 2 * q.min(axis=0) - upper)
    high = np.where(np.isfinite(upper), upper, 2 * q.max(axis=0) - lower)
    fraction = np.where(high > low, 0.0, 1.0)  # in a range without width a joint is at its end
    wide = (high > low) & np.isfinite(low) & np.isfinite(high)
    fraction[wide] = abs(2 * q[wide] - low[wide] - high[wide]) / (high[wide] - low[wide])
    names = problem.robot.joint_names
    return [LimitUse(POSITION, names[j], fraction[:, j], j) for j in bounded.tolist()]


def _uses_of(limit: SpeedLimit, at: PathSamples) -> list[LimitUse]:
    """Return the used fractions of one kind of limit, by joint or point, both signs together."""
    fractions = _fractions(limit.used(at), limit.signs)
    first_keys: dict[tuple[int | None, int | None], LimitKey] = {}
    for key in limit.keys:
        first_keys.setdefault((key.joint, key.point), key)
    owners = list(first_keys)
    owner_of = np.array([owners.index((key.joint, key.point)) for key in limit.keys])
    owner = np.broadcast_to(owner_of[limit.key_of(at)], fractions.shape)
    uses = []
    for k, key in enumerate(first_keys.values()):
        if key.joint is not None:
            name = at.problem.robot.joint_names[key.joint]
        else:
            name = "tool" if key.link is None else f"point {key.point} on {key.link}"
        fraction = np.where(owner == k, fractions, 0.0).max(axis=1)
        uses.append(LimitUse(limit.kind, name, fraction, key.joint, key.point))
    return uses


def _fractions(used: SpeedPolynomial, signs: tuple[float, ...]) -> FloatArray:
    """Return the used fractions of the actual, not the nominal, limits, shape (N, I)."""
    value = used.at(1.0)
    most: FloatArray = np.max([sign * value for sign in signs], axis=0)
    if used.allowed is None:
        return np.maximum(most, 0.0)
    # The terms contain the shortfall of a limit, unless it has no bound in that direction.
    shortfall = np.where(used.terms[0] == 0, 0.0, 1 - used.allowed)
    quantity = np.maximum(most - shortfall, 0.0)
    fraction = np.where(quantity > 0, np.inf, 0.0)
    np.divide(quantity, used.allowed, out=fraction, where=used.allowed > 0)
    return fraction


_MEAN_SAMPLES = 1000


def unused_speed(problem: PlanningProblem, trajectory: JointTrajectory) -> float:
    """Return the mean over time of 1 - 1/b(t), the unused fraction of the speed, from 0 to 1.

    The limits, jerk included, would let the trajectory run b(t) times faster at that instant (Suh &
    Bishop 1988, property 2). Where b is 1, some limit is fully used; the fastest trajectory of a
    tube uses one nearly everywhere.

    Args:
        problem: The planning problem.
        trajectory: Within its limits.
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
