"""Necessary conditions before planning: reach, ends that motors hold, free ends."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.branches import KnownBranches
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.joint_efforts import require_held
from tubeplanner.limits.rates import require_approachable
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Location, PlanStatus
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem


@dataclass(frozen=True, eq=False)
class ReachBound:
    """A ball that the tool cannot leave, wherever joints are within their limits.

    Attributes:
        center: The first joint's origin, shape (3,), base frame [m].
        radius: [m]; infinite where a sliding joint has no limits.
    """

    center: FloatArray
    radius: float

    def beyond(self, points: FloatArray) -> FloatArray:
        """Return the distances of points (N, 3) outside the ball, negative inside, (N,) [m]."""
        outside: FloatArray = np.linalg.norm(points - self.center, axis=1) - self.radius
        return outside


def reach_bound(robot: RobotModel) -> ReachBound:
    """Return a bound on the tool centre point: the sum of the lengths between joints.

    The distance between the origins of successive joints does not depend on turning joints; with a
    sliding joint, which may follow a turning one, it is largest at an end of the range, as
    distances are convex along a line.
    """
    limits = robot.limits
    tolerance = [[-MARGIN_TOLERANCE], [MARGIN_TOLERANCE]]
    ends = np.stack([limits.lower_position, limits.upper_position]) + tolerance
    tool = robot.link_body[robot.tool_frame]
    chain = [body for body in range(1, robot.body_count) if robot.carries[tool, body - 1]]
    sliding = robot.body_joints[chain][~robot.body_is_revolute[chain]]  # or what these follow
    if not chain or not np.isfinite(ends[:, sliding]).all():
        return ReachBound(np.zeros(3), np.inf)
    ends = np.where(np.isfinite(ends), ends, 0.0)
    origins = robot.body_poses(ends)[1][:, chain]
    points = np.concatenate([origins, robot.tool_position(ends)[:, None]], axis=1)
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=0)
    center = origins[:, 0].mean(axis=0)
    travel = np.linalg.norm(origins[:, 0] - center, axis=1).max()
    return ReachBound(center, float(lengths.sum() + travel))


# Ends and margins are exact to this [m].
_ROUNDING = 2 * MARGIN_TOLERANCE
_MANY_REACHES = 20  # a point so many reaches too far is rather in another unit


def require_within_bound(problem: PlanningProblem, *, start_is_known: bool = True) -> None:
    """Check that all points are within the bound of the arm's reach.

    Args:
        problem: The planning problem.
        start_is_known: False: the first point is left out.

    Raises:
        Infeasible: Status unreachable, proved; the place is the point farthest outside.
    """
    points, allowed = required_points(problem)
    allowed[0] = allowed[0] if start_is_known else np.inf
    bound = reach_bound(problem.robot)
    missing = bound.beyond(points) - allowed
    k = int(missing.argmax())
    if missing[k] <= _ROUNDING:
        return
    location = point_location(problem.tube, k, points[k])
    x, y, z = (f"{value:.3f}" for value in bound.center)
    tolerance = f" and {allowed[k]:.4g} m of tolerance" if allowed[k] else ""
    unit = " (millimetres?)" if missing[k] > _MANY_REACHES * bound.radius else ""
    raise Infeasible(
        PlanStatus.UNREACHABLE,
        f"{location}: out of reach: the arm reaches {bound.radius:.4g} m from "
        f"[{x}, {y}, {z}] m, the sum of its links{tolerance}; the {point_name(k, len(points))} is "
        f"{missing[k]:.3g} m too far{unit}: move it nearer",
        location,
        proved=True,
    )


def required_points(problem: PlanningProblem) -> tuple[FloatArray, FloatArray]:
    """Return points (m+1, 3) to pass, and the tool's allowed distances (m+1,) [m].

    The distance is infinite for an end with a given configuration, whose tool is near enough
    already.
    """
    tube = problem.tube
    points, allowed = tube.points.copy(), np.append(0.0, largest_distances(tube))
    if tube.visit != "ordered":  # only the goal must be visited
        allowed[1:-1] = np.inf
    for row, end in zip((0, -1), problem.endpoints, strict=True):
        if end.kind in ("seed", "open"):
            allowed[row] = problem.end_radii[row]
        elif end.position is not None:
            points[row] = end.position
            allowed[row] = 0.0 if end.region is None else end.region.tolerance
        elif end.joints is not None:
            allowed[row] = np.inf
    return points, allowed


def point_location(tube: Tube, k: int, point: FloatArray) -> Location:
    """Return the place of reference point k, or of a point (3,) [m] in its stead."""
    number = tube.segment_number(max(k - 1, 0), point)
    return Location(segment=number, point=int(tube.numbers[k])).at(point)


def point_name(k: int, count: int) -> str:
    """Return the name of the k-th of a number of reference points."""
    return "goal" if k == count - 1 else "start" if k == 0 else "reference point"


def largest_distances(tube: Tube) -> FloatArray:
    """Return the tool's largest distances when it passes points, without the first, (m,) [m].

    The tool passes from segment to segment where their regions overlap. Within r of two lines at
    an angle phi, it is at most r / sin(phi / 2) from their corner. At the goal the distance is 0.
    """
    radius = np.where(tube.is_box, np.sqrt(3), 1.0) * tube.reach  # the corners of a box are farther
    axis = np.diff(tube.points, axis=0)
    along = axis / np.linalg.norm(axis, axis=1)[:, None]
    cosine = -np.einsum("mi,mi->m", along[:-1], along[1:])
    sine = np.sqrt(np.clip((1 - cosine) / 2, 0, None))
    with np.errstate(divide="ignore"):
        corner: FloatArray = np.maximum(radius[:-1], radius[1:]) / sine
    return np.append(corner, 0.0)


# A point counts as out of reach if the tool's distance exceeds the allowed one by more [m].
_MAX_SEARCH_ERROR = 1e-4
_OTHER_SEEDS = 4  # of inverse kinematics, besides the start
_SEED_RANGE = np.pi  # [rad or m]


def require_possible(problem: PlanningProblem, branches: KnownBranches) -> None:
    """Check the necessary conditions of every trajectory.

    Start and a given goal must be free, the motors must hold them, the joints may move to that
    goal, and the arm must reach the farthest point at which the tool passes from segment to segment
    or ends.

    Args:
        problem: The planning problem.
        branches: The problem's branches.

    Raises:
        Infeasible: There is no trajectory; status, message and place give the reason.
        TimeLimitReached: Before that was known.
    """
    ends = branches.require_ends()
    are_given = [end.joints is not None for end in problem.endpoints]
    differ = all(are_given) and bool(abs(ends[1] - ends[0]).max() > _ROUNDING)
    for q, is_given in zip(ends, are_given, strict=False):
        require_held(problem, q, is_given=is_given, must_leave=differ)
    if len(ends) > 1:
        require_approachable(problem, *ends)
    # The farthest point, the joints without limits.
    robot, (points, allowed) = problem.robot, required_points(problem)
    base = robot.body_poses(ends[0][None])[1][0, 1]
    k = 1 + int((np.linalg.norm(points[1:] - base, axis=1) - allowed[1:]).argmax())
    if np.isinf(allowed[k]):
        return
    point, free = points[k], np.full(robot.joint_count, np.inf)
    draw = np.random.default_rng(0).uniform
    seeds = [ends[0], *draw(-_SEED_RANGE, _SEED_RANGE, (_OTHER_SEEDS, robot.joint_count))]
    nearest = np.inf
    for seed in seeds:
        nearest = min(nearest, solve_position(robot, point, seed, -free, free).error)
        if nearest <= allowed[k] + _MAX_SEARCH_ERROR:
            return
    location = point_location(problem.tube, k, point)
    may = f" ({allowed[k]:.4g} m is allowed)" if allowed[k] else ""
    name = point_name(k, len(points))
    message = (
        f"{location}: the tool stops {nearest:.4g} m short even without joint limits{may}; move "
        f"the {name} at least {nearest - allowed[k]:.3g} m nearer"
    )
    goal = problem.open_goal
    if name == "goal" and goal is not None and nearest < problem.tube.effective_radius[-1]:
        message += f", or give goal: {{position: {point.tolist()}, tolerance: {1.1 * nearest:.2g}}}"
    raise Infeasible(PlanStatus.UNREACHABLE, message, location, starts=len(seeds))
