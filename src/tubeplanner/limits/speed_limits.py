"""The list of all speed limits of a problem; use of each limit along a trajectory."""

from dataclasses import dataclass

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
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.trajectory.parts import directed_stretches

# ---- The limits on a trajectory's speed that a problem has: all that phases and studies know of.


def speed_limits(problem: PlanningProblem) -> tuple[SpeedLimit, ...]:
    """Return the limits of a problem that limit anything."""
    limits = problem.robot.limits
    rates = [JointRate(kind, getattr(limits, kind)) for kind in RATES]
    found: tuple[SpeedLimit, ...] = (
        _effort_limit(problem.robot),
        MotorCurve(problem.robot.motors),
        EffortRate(limits.effort_rate),
        *rates,
        VelocityByPositionLimit(limits),
        ToolSpeed(problem),
        PointSpeedLimit(limits.point_speed),
    )
    return tuple(limit for limit in found if limit.keys)


def _effort_limit(robot: RobotModel) -> SpeedLimit:
    """Return the simpler kind of effort limit where it serves."""
    limits, motors = robot.limits, robot.motors
    is_unsure = motors.has_friction and motors.friction_uncertainty > 0
    if motors.has_coulomb_friction or limits.effort_ranges or is_unsure:
        return EffortLimit(limits)
    return JointEffort(limits.effort)


def largest_use(at: PathSamples, limits: tuple[SpeedLimit, ...]) -> FloatArray:
    """Return the largest share of some limits that each sample uses at a speed of 1, shape (N,)."""
    used = np.zeros(len(at))
    for limit in limits:
        share = limit.used(at).at(1.0)
        used = np.maximum(used, np.max([sign * share for sign in limit.signs], axis=(0, 2)))
    return used


def rates_and_others(
    limits: tuple[SpeedLimit, ...],
) -> tuple[list[JointRate], tuple[SpeedLimit, ...]]:
    """Return limits of the joints' rates, polynomials over time, and all others."""
    rates = [limit for limit in limits if isinstance(limit, JointRate)]
    return rates, tuple(limit for limit in limits if not isinstance(limit, JointRate))


def largest_speeds(at: PathSamples, limits: tuple[SpeedLimit, ...]) -> FloatArray:
    """Return up to which speed each sample keeps some limits, shape (N,); inf where none limits.

    Limits that depend on a derivative that the samples do not know are left out.
    """
    found = np.full(len(at), np.inf)
    for limit in limits:
        if limit.order >= len(at.by_path):
            continue
        found = np.minimum(found, limit.used(at).largest_speed(limit.signs).min(axis=1))
    return found


# ---- How much of every limit a trajectory uses, at samples on both sides of its breakpoints.

POSITION, TUBE, ROTATION = "position", "tube", "rotation"
_SAMPLES, _LEAST_PER_PIECE = 800, 4


@dataclass(frozen=True, eq=False)
class LimitUse:
    """How much of one limit is used.

    Attributes:
        kind: Of the limit, as the certificate calls it: "effort", "tool_speed", "tube".
        name: What it limits: a joint, "tool", or a point by number and link.
        share: At N samples, shape (N,): 1 at the limit, 0 where nothing of it is used.
        joint: Index of the joint; None: the limit is not a joint's.
        point: Index of the point among those whose speed is limited; None: not a point's.
    """

    kind: str
    name: str
    share: FloatArray
    joint: int | None = None
    point: int | None = None


@dataclass(frozen=True, eq=False)
class LimitUses:
    """How much of its limits a trajectory uses.

    Attributes:
        samples: The N samples; at a breakpoint two, which differ where something jumps.
        segment: The tube segment of each, shape (N,).
        uses: Of each limit: of joints first, by joint, then of the tool, then of points.
    """

    samples: TrajectorySamples
    segment: IntArray
    uses: tuple[LimitUse, ...]

    def of(self, kind: str) -> list[LimitUse]:
        """Return those of one kind."""
        return [use for use in self.uses if use.kind == kind]


def limit_uses(
    problem: PlanningProblem, trajectory: JointTrajectory, count: int | None = None
) -> LimitUses:
    """Return how much of every limit a trajectory uses.

    Of a position, how far it is from the middle of the range that the segment allows; of the tube,
    as `tube_use` has it; of the rotation tolerance, the largest of its bounds'; of limits on the
    speed, as `speed_limits` has them: what is not there yet needs no line here.

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
    at = _path_samples(problem, trajectory, segment, count)
    found = [*_position_uses(problem, samples.position, segment), *_tool_uses(at)]
    for limit in speed_limits(problem):
        found += _uses_of(limit, at)
    order = [(use.joint is None, use.joint or 0, use.point is not None) for use in found]
    sorted_uses = sorted(zip(order, range(len(found)), strict=True))
    return LimitUses(samples, segment, tuple(found[k] for _, k in sorted_uses))


def samples_per_piece(trajectory: JointTrajectory) -> int:
    """Return how many samples of each piece show a trajectory well: 800 in all, or 4 each."""
    return max(_LEAST_PER_PIECE, _SAMPLES // len(trajectory.widths))


def _path_samples(
    problem: PlanningProblem, trajectory: JointTrajectory, segment: IntArray, count: int
) -> PathSamples:
    """Return the samples as limits know them: jerk and friction are those of their piece."""
    samples, motors = trajectory.per_piece(count), problem.robot.motors
    jerk = trajectory.jerk_per_piece(count)
    known = np.stack([samples.position, samples.velocity, samples.acceleration, jerk])
    if not motors.has_coulomb_friction:
        return PathSamples(problem, known, lambda: segment)
    piece, share = np.divmod(np.arange(len(segment)), count)
    direction = directed_stretches(trajectory).at(piece, share / (count - 1))
    return PathSamples(
        problem, known, lambda: segment, lambda: directed_friction(motors, direction)
    )


def _position_uses(problem: PlanningProblem, q: FloatArray, segment: IntArray) -> list[LimitUse]:
    """Return how far joints are from the middle of their ranges, of those that have an end.

    Of a range that is open on one side, how far from where the motion is farthest from its end.
    """
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    bounded = np.flatnonzero((np.isfinite(lower) | np.isfinite(upper)).any(axis=0))
    low = np.where(np.isfinite(lower), lower, 2 * q.min(axis=0) - upper)
    high = np.where(np.isfinite(upper), upper, 2 * q.max(axis=0) - lower)
    share = np.where(high > low, 0.0, 1.0)  # in a range without width a joint is at its end
    wide = (high > low) & np.isfinite(low) & np.isfinite(high)
    share[wide] = abs(2 * q[wide] - low[wide] - high[wide]) / (high[wide] - low[wide])
    names = problem.robot.joint_names
    return [LimitUse(POSITION, names[j], share[:, j], j) for j in bounded.tolist()]


def _tool_uses(at: PathSamples) -> list[LimitUse]:
    """Return how much of the tube and of its rotation tolerance the tool uses."""
    problem, segment, (turned, tool) = at.problem, at.segment, at.tool_pose
    found = [LimitUse(TUBE, "tool", tube_use(problem, tool, segment))]
    if problem.tube.rotation is not None:
        error = problem.tube.rotation.error(turned, tool, segment)
        angle = np.linalg.norm(error, axis=1, keepdims=True)
        bounds = problem.tube.rotation.bounds[segment]
        share = (np.hstack([abs(error), angle]) / bounds).max(axis=1)
        found.append(LimitUse(ROTATION, "tool", share))
    return found


def _uses_of(limit: SpeedLimit, at: PathSamples) -> list[LimitUse]:
    """Return how much of one kind of limit is used, by what it limits, both ways together."""
    shares = _shares(limit.used(at), limit.signs)
    owners = list(dict.fromkeys((key.joint, key.point) for key in limit.keys))
    owner_of = np.array([owners.index((key.joint, key.point)) for key in limit.keys])
    owner = np.broadcast_to(owner_of[limit.key_of(at)], shares.shape)
    return [
        LimitUse(
            limit.kind,
            _name(at.problem, next(key for key in limit.keys if (key.joint, key.point) == each)),
            np.where(owner == k, shares, 0.0).max(axis=1),
            *each,
        )
        for k, each in enumerate(owners)
    ]


def _shares(used: SpeedPolynomial, signs: tuple[float, ...]) -> FloatArray:
    """Return the shares of the limits as they are there, not of nominal ones, shape (N, I)."""
    value = used.at(1.0)
    most: FloatArray = np.max([sign * value for sign in signs], axis=0)
    if used.allowed is None:
        return np.maximum(most, 0.0)
    # What a limit lacks is in the terms, unless it asks nothing of that direction.
    lack = np.where(used.terms[0] == 0, 0.0, 1 - used.allowed)
    asked = np.maximum(most - lack, 0.0)
    share = np.where(asked > 0, np.inf, 0.0)
    np.divide(asked, used.allowed, out=share, where=used.allowed > 0)
    return share


def _name(problem: PlanningProblem, key: LimitKey) -> str:
    if key.joint is not None:
        return problem.robot.joint_names[key.joint]
    return "tool" if key.link is None else f"point {key.point} on {key.link}"


# ---- How much of the speed that the limits allow a trajectory does not use.

_MEAN_SAMPLES = 1000


def unused_speed(problem: PlanningProblem, trajectory: JointTrajectory) -> float:
    """Return the mean over time of 1 - 1/b(t), from 0 to 1.

    b(t) is how many times faster the limits, jerk included, would let the trajectory run at that
    instant (Suh & Bishop 1988, property 2). Where it is 1, some limit is fully used; the fastest
    trajectory of a tube uses one nearly everywhere.

    Args:
        problem: The planning problem.
        trajectory: Within its limits.
    """
    time = (np.arange(_MEAN_SAMPLES) + 0.5) * trajectory.duration / _MEAN_SAMPLES
    at = trajectory.at(time)
    known = np.stack([at.position, at.velocity, at.acceleration, trajectory.jerk(time)])
    samples = PathSamples(problem, known, lambda: current_segments(problem, trajectory, at))
    factor = largest_speeds(samples, speed_limits(problem))
    with np.errstate(divide="ignore"):
        return float(np.mean(1 - 1 / np.maximum(factor, 1.0)))
