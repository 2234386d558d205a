"""What every trajectory needs, seen before one is planned: free and held ends, points in reach."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.constraints.approachable_range import require_approachable
from tubeplanner.constraints.held_configuration import require_held
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.tube.tube import Tube

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
    for q in ends:
        require_held(problem, q)
    if len(ends) > 1:
        require_approachable(problem, *ends)
    _require_reach(problem, ends[0])


def _require_reach(problem: PlanningProblem, start: FloatArray) -> None:
    """Raise unless the arm, its joints without limits, comes near enough to the farthest point."""
    tube, robot = problem.tube, problem.robot
    allowed, points = _largest_distances(tube), tube.points[1:].copy()
    if tube.visit != "ordered":  # only the goal must be visited
        allowed[:-1] = np.inf
    goal = problem.open_goal
    if goal is None:
        allowed[-1] = np.inf
    else:
        allowed[-1], points[-1] = goal.tolerance, goal.position
    base = robot.body_poses(start[None])[1][0, 1]
    k = int((np.linalg.norm(points - base, axis=1) - allowed).argmax())
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
    number = tube.segment_number(k, point)
    place = Place(segment=number, point=int(tube.numbers[k + 1])).at(point)
    may = f", and must come within {allowed[k]:.4g} m" if allowed[k] else ""
    message = (
        f"{place}: the tool gets no nearer than {nearest:.4g} m{may}: out of the arm's reach; "
        f"move the {'goal' if k == len(points) - 1 else 'reference point'}"
    )
    raise Infeasible(PlanStatus.UNREACHABLE, message, place)


def _largest_distances(tube: Tube) -> FloatArray:
    """Return how far from each point but the first the tool may be when it passes it, (m,) [m].

    From segment to segment it passes where their regions overlap. Within r of two legs at an angle
    phi, it is at most r / sin(phi / 2) from their corner. Of the goal it is 0.
    """
    radius = np.where(tube.is_box, np.sqrt(3), 1.0) * tube.reach  # the corners of a box are farther
    axis = np.diff(tube.points, axis=0)
    along = axis / np.linalg.norm(axis, axis=1)[:, None]
    cosine = -np.einsum("mi,mi->m", along[:-1], along[1:])
    sine = np.sqrt(np.clip((1 - cosine) / 2, 0, None))
    with np.errstate(divide="ignore"):
        corner: FloatArray = np.maximum(radius[:-1], radius[1:]) / sine
    return np.append(corner, 0.0)
