"""Necessary conditions before planning: reach, held and free ends."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.branches import KnownBranches
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.joint_efforts import require_held
from tubeplanner.limits.rates import require_approachable
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Place, PlanStatus
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem

# ---- How far an arm can reach at most: the sum of the lengths between its joints.


@dataclass(frozen=True, eq=False)
class ReachBound:
    """A ball that the tool cannot leave, whatever the joints do within their limits.

    Attributes:
        center: The first joint's origin, shape (3,), base frame [m].
        radius: [m]; infinite where a sliding joint has no limits.
    """

    center: FloatArray
    radius: float

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return how far outside points (N, 3) are, negative inside, shape (N,) [m]."""
        outside: FloatArray = np.linalg.norm(points - self.center, axis=1) - self.radius
        return outside


def reach_bound(robot: RobotModel) -> ReachBound:
    """Return a bound on where the tool centre point can be.

    From one joint's origin to the next one's it is as far wherever turning joints are; a sliding
    joint's is farthest at one end of its range, as distances are convex along a line.

    Args:
        robot: The arm.
    """
    limits = robot.limits
    ends = np.stack([limits.lower_position, limits.upper_position])
    ends = np.where(robot.revolute, 0.0, ends)
    tool = robot.link_body[robot.tool_frame]
    chain = [body for body in range(1, robot.body_count) if robot.carries[tool, body - 1]]
    if not np.isfinite(ends).all() or not chain:
        return ReachBound(np.zeros(3), np.inf)
    origins = robot.body_poses(ends)[1][:, chain]
    points = np.concatenate([origins, robot.tool_position(ends)[:, None]], axis=1)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=0)
    center = origins[:, 0].mean(axis=0)
    travel = np.linalg.norm(origins[:, 0] - center, axis=1).max()
    return ReachBound(center, float(lengths.sum() + travel))


# ---- Points that the tool cannot come to whatever the joints do: the links are too short.

# Ends and margins are exact to this [m].
_SURELY = 2 * MARGIN_TOLERANCE


def require_within_bound(problem: PlanningProblem, *, start_is_known: bool = True) -> None:
    """Check that no point is farther away than all links are long together.

    Args:
        problem: The planning problem.
        start_is_known: False: where it starts is left aside.

    Raises:
        Infeasible: Status unreachable, proved; the place is the point that is farthest beyond.
    """
    points, allowed = required_points(problem)
    allowed[0] = allowed[0] if start_is_known else np.inf
    bound = reach_bound(problem.robot)
    missing = bound.beyond(points) - allowed
    k = int(missing.argmax())
    if missing[k] <= _SURELY:
        return
    place = point_place(problem.tube, k, points[k])
    x, y, z = (f"{value:.3f}" for value in bound.center)
    tolerance = f" and may stay {allowed[k]:.4g} m away" if allowed[k] else ""
    raise Infeasible(
        PlanStatus.UNREACHABLE,
        f"{place}: out of the arm's reach: the tool comes no farther than {bound.radius:.4g} m "
        f"from [{x}, {y}, {z}] m, the sum of the links' lengths{tolerance}; move the "
        f"{point_name(k, len(points))} at least {missing[k]:.3g} m nearer",
        place,
        proved=True,
    )


def required_points(problem: PlanningProblem) -> tuple[FloatArray, FloatArray]:
    """Return points (m + 1, 3) [m], and how far from each the tool may stay, inf: anywhere.

    A configuration that is given for an end has the tool near enough already.
    """
    tube = problem.tube
    points, allowed = tube.points.copy(), np.append(0.0, largest_distances(tube))
    if tube.visit != "ordered":  # only the goal must be visited
        allowed[1:-1] = np.inf
    for row, end in zip((0, -1), problem.endpoints, strict=True):
        if end.position is not None:
            points[row] = end.position
            allowed[row] = 0.0 if end.region is None else end.region.tolerance
        elif end.joints is not None:
            allowed[row] = np.inf
    return points, allowed


def point_place(tube: Tube, k: int, point: FloatArray) -> Place:
    """Return where the tool passes reference point k, or what is asked in its place (3,) [m]."""
    number = tube.segment_number(max(k - 1, 0), point)
    return Place(segment=number, point=int(tube.numbers[k])).at(point)


def point_name(k: int, count: int) -> str:
    """Return what the k-th of so many reference points is called."""
    return "goal" if k == count - 1 else "start" if k == 0 else "reference point"


def largest_distances(tube: Tube) -> FloatArray:
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


# ---- What every trajectory needs, seen before one is planned: free and held ends, points in reach.

# A point counts as out of reach if the tool stays this much farther away than it may [m].
_MAX_SEARCH_ERROR = 1e-4
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
    for q, end in zip(ends, problem.endpoints, strict=False):
        require_held(problem, q, is_given=end.joints is not None)
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
        if nearest <= allowed[k] + _MAX_SEARCH_ERROR:
            return
    place = point_place(problem.tube, k, point)
    may = f", and must come within {allowed[k]:.4g} m" if allowed[k] else ""
    message = (
        f"{place}: the tool was brought no nearer than {nearest:.4g} m, the joints without limits"
        f"{may}; move the {point_name(k, len(points))} nearer"
    )
    raise Infeasible(PlanStatus.UNREACHABLE, message, place, starts=len(seeds))
