"""Places on the reference path at which one asks what keeps the arm from them."""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import Place
from tubeplanner.planning.proved_reach import largest_distances
from tubeplanner.problem.problem import PlanningProblem

_MOST_SEGMENTS = 8
# The tool may miss a place by this share of the radius, as a branch may.
_RADIUS_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Spot:
    """A place of the tool.

    Attributes:
        name: What messages call it.
        segments: The one or two segments of the tube that it belongs to.
        tool: The tool's position, shape (3,) [m].
        allowed: How far the tool may be from there [m].
        place: The same for messages.
        is_goal: Whether it is the open goal.
        rotation_rows: The rows of the rotation tolerance that hold here.
    """

    name: str
    segments: tuple[int, ...]
    tool: FloatArray
    allowed: float
    place: Place
    rotation_rows: tuple[int, ...]
    is_goal: bool = False


def path_spots(problem: PlanningProblem, end: Place, is_wide: bool = False) -> list[Spot]:
    """Return places at which the arm must have a configuration.

    Reference points but the first, the goal if it is open, then places between; of a long path only
    those near where a branch ended, and the last.

    Args:
        problem: The planning problem.
        end: Where the branch ended, if that is known.
        is_wide: Whether the tool may be wherever the tube lets it pass the place, not only near it.
    """
    spots = _path_spots(problem, end)
    if not is_wide:
        return spots
    return [replace(spot, allowed=_widest(problem, spot)) for spot in spots]


def _widest(problem: PlanningProblem, spot: Spot) -> float:
    """Return how far from a place the tool may pass it [m]."""
    if spot.is_goal:
        return spot.allowed
    first, tube = spot.segments[0], problem.tube
    is_corner = len(spot.segments) > 1
    return float(largest_distances(tube)[first] if is_corner else tube.effective_radius[first])


def _path_spots(problem: PlanningProblem, end: Place) -> list[Spot]:
    """Return the places; near them a branch may miss them a little."""
    segments = _segments(problem, end)
    last = problem.tube.segment_count - 1
    points = [_corner(problem, k) for k in segments if k < last]
    if problem.open_goal is not None:
        points.append(_goal_spot(problem))
    return points + [spot for k in segments for spot in _inside(problem, k, end)]


def _segments(problem: PlanningProblem, end: Place) -> list[int]:
    tube = problem.tube
    count = tube.segment_count
    ended = [k for k in range(count) if tube.segment_number(k) == end.segment]
    around = ended[0] if ended else 0
    nearest = sorted(range(count), key=lambda k: abs(k - around))[: _MOST_SEGMENTS - 1]
    return sorted({*nearest, count - 1})


def _inside(problem: PlanningProblem, segment: int, end: Place) -> list[Spot]:
    """Return the middle of a segment, and where the branch ended if it did in this one."""
    tube = problem.tube
    begin = tube.points[segment]
    tools = [(begin + tube.points[segment + 1]) / 2]
    if end.position is not None and end.segment == tube.segment_number(segment):
        tools.append(np.array(end.position))
    tools.sort(key=lambda tool: float(np.linalg.norm(tool - begin)))
    return [_between(problem, segment, tool) for tool in tools]


def _between(problem: PlanningProblem, segment: int, tool: FloatArray) -> Spot:
    number = problem.tube.segment_number(segment, tool)
    allowed = _RADIUS_SHARE * float(problem.tube.effective_radius[segment])
    place = Place(segment=number).at(tool)
    return Spot("reference points", (segment,), tool, allowed, place, (segment,))


def _corner(problem: PlanningProblem, segment: int) -> Spot:
    tube, both = problem.tube, (segment, segment + 1)
    tool, number = tube.points[segment + 1], int(tube.numbers[segment + 1])
    allowed = _RADIUS_SHARE * float(tube.effective_radius[list(both)].min())
    place = Place(segment=tube.segment_number(segment, tool), point=number).at(tool)
    return Spot(f"reference point {number}", both, tool, allowed, place, both)


def _goal_spot(problem: PlanningProblem) -> Spot:
    """Return the open goal of a problem."""
    tube, goal = problem.tube, problem.open_goal
    assert goal is not None
    last = tube.segment_count - 1
    number = tube.segment_number(last, goal.position)
    place = Place(segment=number, point=int(tube.numbers[-1])).at(goal.position)
    rows = (last, tube.segment_count) if goal.bounds_rotation else (last,)
    return Spot("goal", (last,), goal.position, goal.tolerance, place, rows, is_goal=True)
