"""Configurations of a tool pose, best first; the joint that keeps them out of bounds."""

from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import require_free
from tubeplanner.first_guess.inverse_kinematics import WantedRotation, solve_positions
from tubeplanner.limits.joint_efforts import require_held
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.endpoints import ToolPose
from tubeplanner.task.problem import PlanningProblem


def middle_of(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the middle (n,) of joint bounds; of infinite bounds the value nearest zero."""
    with np.errstate(invalid="ignore"):
        middle = (lower + upper) / 2
    return np.where(np.isfinite(middle), middle, np.clip(0.0, lower, upper))


def half_ranges(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return half the widths (n,) of joint bounds; pi where a bound is infinite."""
    half = (upper - lower) / 2
    return np.where(np.isfinite(half), half, np.pi)


class OutsideBounds(NamedTuple):
    """A joint outside its bounds."""

    joint: int  # the joint's index
    is_above: bool  # True above the upper bound, False below the lower bound
    words: str  # the joint's name, value and bounds


def outside_bounds(
    robot: RobotModel, q: FloatArray, lower: FloatArray, upper: FloatArray
) -> OutsideBounds:
    """Return the joint farthest outside its bounds, of the configuration least outside.

    Each of the configurations (c, n) is outside the bounds (n,) [rad or m].
    """
    beyond = np.maximum(np.maximum(lower - q, q - upper), 0.0)
    best = int(beyond.max(axis=1).argmin())
    joint = int(beyond[best].argmax())
    value = float(q[best, joint])
    return OutsideBounds(
        joint,
        value > upper[joint],
        f"'{robot.joint_names[joint]}' would be at {value:.4g}, outside "
        f"[{lower[joint]:g}, {upper[joint]:g}]",
    )


def bounded_by(problem: PlanningProblem, segments: tuple[int, ...], outside: OutsideBounds) -> str:
    """Return the name of the bound that a joint exceeds: position limits or joint signs."""
    limits, joint, rows = problem.robot.limits, outside.joint, list(segments)
    if outside.is_above:
        is_limit = problem.joint_upper[rows, joint].min() == limits.upper_position[joint]
    else:
        is_limit = problem.joint_lower[rows, joint].max() == limits.lower_position[joint]
    return "position limits" if is_limit else "joint signs"


_DRAWS = 40
_REACHED = 1e-8  # [m] and [rad]
_SAME = 0.1  # [rad or m] of every joint


def pose_configurations(problem: PlanningProblem, pose: ToolPose, point: int) -> FloatArray:
    """Return the configurations (c, n) of a tool pose, best first.

    Configurations free of collision come first, then those that the motors hold, then those nearest
    the middle of their ranges. From a seed there is one. The joint ranges are those of the segment
    of the start (point 0) or the goal (point -1).

    Raises:
        Infeasible: Status unreachable: there is no configuration; the message says why.
    """
    end, segment = ends_segment(problem, point)
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    seeds = spread_seeds(lower, upper) if pose.seed is None else pose.seed[None]
    candidates = reaching(problem.robot, pose, seeds, lower, upper)
    if len(candidates) == 0:
        message = f"{end}: {_reason(problem, pose, segment)}"
        number = problem.tube.segment_number(segment, pose.position)
        location = Location(segment=number).at(pose.position)
        raise Infeasible(PlanStatus.UNREACHABLE, message, location, starts=len(seeds))
    middle, half = middle_of(lower, upper), half_ranges(lower, upper)

    def rank(q: FloatArray) -> tuple[bool, bool, float]:
        off = float(np.linalg.norm((q - middle) / np.maximum(half, 1e-9)))
        return not is_free(problem, end, q), not is_held(problem, q), off

    return np.array(sorted(candidates, key=rank))


def ends_segment(problem: PlanningProblem, point: int) -> tuple[str, int]:
    """Return the name and the segment of the start (point 0) or the goal (point -1)."""
    return ("start", 0) if point == 0 else ("goal", problem.tube.segment_count - 1)


def is_free(problem: PlanningProblem, end: str, q: FloatArray) -> bool:
    """Return True if a configuration (n,) keeps its distances to obstacles and links."""
    try:
        require_free(problem, end, q)
    except Infeasible:
        return False
    return True


def is_held(problem: PlanningProblem, q: FloatArray) -> bool:
    """Return True if the motors hold a configuration (n,)."""
    try:
        require_held(problem, q)
    except Infeasible:
        return False
    return True


def reaching(
    robot: RobotModel,
    pose: ToolPose,
    seeds: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    preferred: FloatArray | None = None,
) -> FloatArray:
    """Return the distinct configurations (c, n) of a pose within bounds, from seeds (s, n).

    Redundant joints come near preferred configurations (n,) or (s, n), of several seeds the
    middle of the bounds by default.
    """
    rotation = WantedRotation(pose.rotation)
    if preferred is None and len(seeds) > 1:
        preferred = middle_of(lower, upper)
    q, errors = solve_positions(robot, pose.position, seeds, lower, upper, preferred, rotation)
    distinct: list[FloatArray] = []
    for candidate in q[errors.max(axis=1) <= _REACHED]:
        if all(abs(candidate - other).max() > _SAME for other in distinct):
            distinct.append(candidate)
    return np.array(distinct).reshape(-1, robot.joint_count)


def spread_seeds(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return configurations (s, n) spread over joint bounds, their middle first.

    At most pi away from the middle, by a fixed seed: always the same.
    """
    middle, half = middle_of(lower, upper), np.minimum(half_ranges(lower, upper), np.pi)
    drawn = np.random.default_rng(0).uniform(-1, 1, (_DRAWS, len(lower)))
    return np.vstack([middle, middle + drawn * half])


def _reason(problem: PlanningProblem, pose: ToolPose, segment: int) -> str:
    """Return the condition that keeps the tool from a pose, by dropping conditions in turn."""
    robot, limits = problem.robot, problem.robot.limits
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    seeds = spread_seeds(lower, upper)
    if pose.seed is not None:
        if len(reaching(robot, pose, seeds, lower, upper)):
            return "its seed does not lead to the pose, others do; change it, or leave it out"
        seeds = np.vstack([pose.seed, seeds])
    wide = (limits.lower_position, limits.upper_position)
    seeds = np.vstack([seeds, spread_seeds(*wide)])
    others = reaching(robot, pose, seeds, *wide)
    if len(others):
        number = problem.tube.segment_number(segment, pose.position)
        where = outside_bounds(robot, others, lower, upper).words
        return (
            f"no configuration with the joint signs of segment {number} has the tool at the pose; "
            f"on another branch {where}; change tube.joint_signs or the pose"
        )
    free = np.full(robot.joint_count, np.inf)
    others = reaching(robot, pose, seeds, -free, free)
    if len(others):
        where = outside_bounds(robot, others, *wide).words
        return f"position limits are in the way of the pose: {where}"
    rotation = WantedRotation(pose.rotation)
    errors = solve_positions(robot, pose.position, seeds, -free, free, rotation=rotation)[1]
    distance = float(errors[:, 0].min())
    if distance > _REACHED:
        return f"the tool stops {distance:.4g} m short of the pose; move the pose nearer"
    angle = float(errors[errors[:, 0] <= _REACHED, 1].min())
    return (
        f"the tool gets to the pose's position, but stays {angle:.3g} rad from its orientation; "
        "turn the pose"
    )
