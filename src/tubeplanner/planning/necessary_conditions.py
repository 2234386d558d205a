"""What every trajectory needs, seen before one is planned: free and held ends, points in reach."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.constraints.approachable_range import require_approachable
from tubeplanner.constraints.held_configuration import require_held
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.planning.proved_reach import point_name, point_place, required_points
from tubeplanner.problem.problem import PlanningProblem

# A point counts as out of reach if the tool stays this much farther away than it may [m].
_SURELY = 1e-4
# The nearest configuration is looked for from the start and from so many others.
_OTHER_SEEDS = 4
_SEED_RANGE = np.pi  # [rad or m]


def require_possible(problem: PlanningProblem, branches: KnownBranches) -> None:
    """Check what no trajectory can do without.

    Start and a given goal must be free, the motors must hold them, the joints may move to that
    goal, and the arm must reach the farthest place at which the tool passes from segment to segment
    or ends.

    Args:
        problem: The planning problem.
        branches: Its branches.

    Raises:
        Infeasible: There is no trajectory; status, message and place say why.
        TimeLimitReached: Before that was known.
    """
    ends = branches.require_ends()
    for q, given in zip(ends, (problem.start, problem.given_goal), strict=False):
        require_held(problem, q, is_given=isinstance(given, np.ndarray))
    if len(ends) > 1:
        require_approachable(problem, *ends)
    _require_reach(problem, ends[0])


def _require_reach(problem: PlanningProblem, start: FloatArray) -> None:
    """Raise unless the arm, its joints without limits, comes near enough to the farthest point."""
    robot, (points, allowed) = problem.robot, required_points(problem)
    base = robot.body_poses(start[None])[1][0, 1]
    k = 1 + int((np.linalg.norm(points[1:] - base, axis=1) - allowed[1:]).argmax())
    if np.isinf(allowed[k]):
        return
    point, free = points[k], np.full(robot.joint_count, np.inf)
    draw = np.random.default_rng(0).uniform
    seeds = [start, *draw(-_SEED_RANGE, _SEED_RANGE, (_OTHER_SEEDS, robot.joint_count))]
    nearest = np.inf
    for seed in seeds:
        nearest = min(nearest, solve_position(robot, point, seed, -free, free).error)
        if nearest <= allowed[k] + _SURELY:
            return
    place = point_place(problem.tube, k, point)
    may = f", and must come within {allowed[k]:.4g} m" if allowed[k] else ""
    message = (
        f"{place}: the tool was brought no nearer than {nearest:.4g} m, the joints without limits"
        f"{may}; move the {point_name(k, len(points))} nearer"
    )
    raise Infeasible(PlanStatus.UNREACHABLE, message, place, starts=len(seeds))
