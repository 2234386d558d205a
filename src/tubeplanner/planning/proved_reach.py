"""Points that the tool cannot come to whatever the joints do: the links are too short."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.tool_pose import ToolPose
from tubeplanner.robot.reach_bound import reach_bound
from tubeplanner.tube.tube import Tube

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
    goal = problem.open_goal
    if goal is not None:
        points[-1], allowed[-1] = goal.position, goal.tolerance
    for row, end in ((0, problem.start), (-1, problem.given_goal)):
        if isinstance(end, ToolPose):
            points[row], allowed[row] = end.position, 0.0
        elif isinstance(end, np.ndarray):
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
