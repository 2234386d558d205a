"""The arm where it is blocked: as planning met it, or as near as it comes."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.branches.pose_configurations import spread_seeds
from tubeplanner.branches.reference_branch import end_configuration
from tubeplanner.explanation.explanation import Explanation
from tubeplanner.outcome import Infeasible, Place
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.views.scene import ShownTrajectory
from tubeplanner.views.shown_poses import poses_standing

_THERE = 1e-3  # [m]
_MOST_SEEDS = 20


def blocked_arm(problem: PlanningProblem, found: Explanation) -> ShownTrajectory | None:
    """Return the arm where a problem without an answer is blocked; None: that is not known.

    Args:
        problem: What is drawn of it.
        found: What was found out about it.
    """
    robot, q = problem.robot, found.configuration
    if q is not None:
        return poses_standing(robot, "where it is blocked", q)
    if found.place.position is None:
        return None
    target = np.array(found.place.position)
    q = _nearest(problem, target)
    away = float(np.linalg.norm(robot.tool_position(q[None])[0] - target))
    near = (
        "where it is blocked" if away <= _THERE else f"{1000 * away:.3g} mm from where it must be"
    )
    return poses_standing(robot, near, q)


def _nearest(problem: PlanningProblem, target: FloatArray) -> FloatArray:
    """Return the configuration (n,) within limits that brings the tool nearest to a point (3,)."""
    limits = problem.robot.limits
    try:
        seed = end_configuration(problem, problem.start, 0)
    except Infeasible:
        seed = limits.clip(np.zeros(problem.robot.joint_count))
    bounds = limits.lower_position, limits.upper_position
    seeds = [seed, *spread_seeds(*bounds)[:_MOST_SEEDS]]
    found = (solve_position(problem.robot, target, each, *bounds) for each in seeds)
    return min(found, key=lambda one: max(one.error, _THERE)).q


def contact_point(
    problem: PlanningProblem, place: Place, q: FloatArray | None
) -> FloatArray | None:
    """Return where two solids that a place names are nearest, (3,) [m]; None if it names none.

    Args:
        problem: The planning problem.
        place: Where it is blocked.
        q: The configuration there, shape (n,); None: not known.
    """
    named = [*(place.links or ()), *([place.obstacle] if place.obstacle else [])]
    if q is None or len(named) != 2:
        return None
    checker = problem.collision
    pairs = checker.pairs[checker.between(*named)]
    if len(pairs) == 0:
        return None
    poses = problem.robot.body_poses(np.repeat(q[None], len(pairs), axis=0))
    closest = checker.closest_points(*poses, pairs)
    worst = int(closest.distance.argmin())
    middle: FloatArray = (closest.first[worst] + closest.second[worst]) / 2
    return middle
