"""Configurations in which the tool has a pose, the one to prefer first."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import WantedRotation, solve_positions
from tubeplanner.branches.joint_middle import half_ranges, middle_of
from tubeplanner.branches.outside_bounds import outside_bounds
from tubeplanner.constraints.held_configuration import require_held
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.tool_pose import ToolPose
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.verification.refusal import require_free

_DRAWS = 40
_REACHED = 1e-8  # [m] and [rad]
_SAME = 0.1  # [rad or m] of every joint


def pose_configurations(problem: PlanningProblem, pose: ToolPose, point: int) -> FloatArray:
    """Return configurations (c, n) that have the tool at a pose, by preference.

    Those free of collision come first, then those that the motors hold, then those nearest the
    middle of their ranges. From a seed there is one.

    Args:
        problem: The planning problem.
        pose: Its start or goal.
        point: 0 for the start, -1 for the goal: its segment's joint ranges count.

    Raises:
        Infeasible: Status unreachable: there is none; the message says what is in the way.
    """
    end, segment = ends_segment(problem, point)
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    seeds = spread_seeds(lower, upper) if pose.seed is None else pose.seed[None]
    found = reaching(problem.robot, pose, seeds, lower, upper)
    if len(found) == 0:
        message = f"{end}: {_reason(problem, pose, segment)}"
        number = problem.tube.segment_number(segment, pose.position)
        place = Place(segment=number).at(pose.position)
        raise Infeasible(PlanStatus.UNREACHABLE, message, place, starts=len(seeds))
    middle, half = middle_of(lower, upper), half_ranges(lower, upper)

    def rank(q: FloatArray) -> tuple[bool, bool, float]:
        off = float(np.linalg.norm((q - middle) / np.maximum(half, 1e-9)))
        return not is_free(problem, end, q), not _is_held(problem, q), off

    return np.array(sorted(found, key=rank))


def ends_segment(problem: PlanningProblem, point: int) -> tuple[str, int]:
    """Return what an end is called, and its segment: of the start at point 0, the goal at -1."""
    return ("start", 0) if point == 0 else ("goal", problem.tube.segment_count - 1)


def is_free(problem: PlanningProblem, end: str, q: FloatArray) -> bool:
    """Return whether a configuration (n,) is clear of everything."""
    try:
        require_free(problem, end, q)
    except Infeasible:
        return False
    return True


def _is_held(problem: PlanningProblem, q: FloatArray) -> bool:
    try:
        require_held(problem, q)
    except Infeasible:
        return False
    return True


def reaching(
    robot: RobotModel, pose: ToolPose, seeds: FloatArray, lower: FloatArray, upper: FloatArray
) -> FloatArray:
    """Return the different configurations (c, n) within bounds that seeds (s, n) lead to."""
    wanted = WantedRotation(pose.rotation, np.zeros(3), np.ones(3, dtype=bool))
    preferred = middle_of(lower, upper) if len(seeds) > 1 else None
    q, errors = solve_positions(robot, pose.position, seeds, lower, upper, preferred, wanted)
    found: list[FloatArray] = []
    for there in q[errors.max(axis=1) <= _REACHED]:
        if all(abs(there - other).max() > _SAME for other in found):
            found.append(there)
    return np.array(found).reshape(-1, robot.joint_count)


def spread_seeds(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return configurations (s, n) spread over joint bounds, their middle first; always the same.

    Within a turn about the middle.
    """
    middle, half = middle_of(lower, upper), half_ranges(lower, upper)
    half = np.minimum(half, np.pi)
    drawn = np.random.default_rng(0).uniform(-1, 1, (_DRAWS, len(lower)))
    return np.vstack([middle, middle + drawn * half])


def _reason(problem: PlanningProblem, pose: ToolPose, segment: int) -> str:
    """Return what keeps the tool from a pose, by dropping one condition after the other."""
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
    return _out_of_reach(robot, pose, seeds)


def _out_of_reach(robot: RobotModel, pose: ToolPose, seeds: FloatArray) -> str:
    """Return how near the tool comes to a pose, limits and signs left aside."""
    free = np.full(robot.joint_count, np.inf)
    wanted = WantedRotation(pose.rotation, np.zeros(3), np.ones(3, dtype=bool))
    errors = solve_positions(robot, pose.position, seeds, -free, free, rotation=wanted)[1]
    off = float(errors[:, 0].min())
    if off > _REACHED:
        return f"the tool was brought no nearer to the pose than {off:.4g} m; move it nearer"
    turned = float(errors[errors[:, 0] <= _REACHED, 1].min())
    return (
        f"the tool gets to the pose's position, but was turned no nearer than {turned:.3g} rad to "
        "its orientation; turn the pose"
    )
