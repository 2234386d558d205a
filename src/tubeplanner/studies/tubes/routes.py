"""Few reference points along a joint route, and their tube."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.first_guess.joint_routes import FreeSpace
from tubeplanner.geometry.tube.points import densified, farthest_from_line
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.robot.model import RobotModel

# ---- Few reference points along a route; a tube about them.
#
# Between two points of the route the tool goes straight, and redundant joints follow the route.
# Where links collide in between, another point of the route is added.

_ROUTE_STEP = 0.05  # [rad or m] of the joint that moves most, between samples of the route
_MAX_STEP = 0.02  # [m] of the tool on a line
_MAX_JOINT_STEP = 0.3  # [rad or m] between neighbours on a line: more is another branch
_ON_LINE = 1e-6  # [m]
_MIN_DISTANCE = 1e-3  # [m] between neighbouring reference points


@dataclass(frozen=True, eq=False)
class ToolCorners:
    """Reference points, and configurations along the straight lines between."""

    points: FloatArray  # shape (m+1, 3) [m]
    lines: tuple[FloatArray, ...]  # configurations along each segment, shape (P_k, n)
    parts: tuple[FloatArray, ...]  # samples of the route that each line replaces, shape (R_k, n)


def tool_corners(
    space: FreeSpace, route: FloatArray, deviation: float = np.inf
) -> ToolCorners | None:
    """Return few corners of the tool's path along a route (P, n), with free straight lines between.

    Lines are at most `deviation` [m] from the tool's path along the route. None if not even the
    route itself is free where the tool follows straight lines.
    """
    route = densified(route, _ROUTE_STEP)
    tool = space.robot.tool_position(route)

    @cache
    def line(i: int, j: int) -> FloatArray | None:
        return _line(space, route[i : j + 1], tool[i : j + 1], deviation)

    def between(i: int, j: int) -> list[int] | None:
        """Return the corners after sample i, up to sample j."""
        if line(i, j) is not None:
            return [j]
        middle, distance = farthest_from_line(tool, i, j)
        if distance <= _MIN_DISTANCE:
            middle = (i + j) // 2
            gaps = np.linalg.norm(tool[[i, j]] - tool[middle], axis=1)
            if gaps.min() <= _MIN_DISTANCE:
                return None
        before = between(i, middle)
        after = None if before is None else between(middle, j)
        return None if before is None or after is None else before + after

    corners = between(0, len(route) - 1)
    if corners is None:
        return None
    corners.insert(0, 0)
    k = 1
    while k < len(corners) - 1:
        if line(corners[k - 1], corners[k + 1]) is None:
            k += 1
        else:  # a longer free line makes the corner unnecessary
            del corners[k]
            k = max(k - 1, 1)
    lines = tuple(q for i, j in pairwise(corners) if (q := line(i, j)) is not None)
    parts = tuple(route[i : j + 1] for i, j in pairwise(corners))
    return ToolCorners(tool[corners], lines, parts)


def _line(
    space: FreeSpace, route: FloatArray, tool: FloatArray, deviation: float
) -> FloatArray | None:
    """Return configurations (P, n) along the line between the ends of a route's part (N, n).

    None if they are not free, or the tool's path (N, 3) deviates from the line.
    """
    length = float(np.linalg.norm(tool[-1] - tool[0]))
    if length < _MIN_DISTANCE or farthest_from_line(tool, 0, len(tool) - 1)[1] > deviation:
        return None
    count = max(len(route), int(np.ceil(length / _MAX_STEP)) + 1)
    fractions = np.linspace(0, 1, count)
    positions, samples = fractions * (len(route) - 1), np.arange(len(route))
    guides = np.stack([np.interp(positions, samples, q) for q in route.T], axis=1)
    line, limits = [route[0]], space.robot.limits
    bounds = limits.lower_position, limits.upper_position
    for fraction, guide in zip(fractions[1:], guides[1:], strict=True):
        target = (1 - fraction) * tool[0] + fraction * tool[-1]
        solution = solve_position(space.robot, target, line[-1], *bounds, guide)
        jump = abs(solution.q - line[-1]).max()
        if solution.error > _ON_LINE or jump > _MAX_JOINT_STEP or not space.is_free(solution.q):
            return None
        line.append(solution.q)
    arrives = abs(line[-1] - route[-1]).max() < _MAX_JOINT_STEP
    return np.vstack([*line, route[-1:]]) if arrives else None


def with_another_corner(space: FreeSpace, corners: ToolCorners, segment: int) -> ToolCorners | None:
    """Return corners with another one midway in a segment's part of the route; None if blocked."""
    part = corners.parts[segment]
    middle = len(part) // 2
    before, after = (tool_corners(space, half) for half in (part[: middle + 1], part[middle:]))
    if before is None or after is None:
        return None
    cut = slice(segment, segment + 1)
    forward, behind = corners.points[: segment + 1], corners.points[segment + 1 :]
    points = np.vstack([forward, before.points[1:], after.points[1:-1], behind])
    lines, parts = list(corners.lines), list(corners.parts)
    lines[cut] = [*before.lines, *after.lines]
    parts[cut] = [*before.parts, *after.parts]
    return ToolCorners(points, tuple(lines), tuple(parts))


_POINT_DECIMALS, _RANGE_DECIMALS = 6, 4


def reference_tube(
    robot: RobotModel,
    points: FloatArray,
    segments: Sequence[FloatArray],
    band: float,
    radius: float,
) -> Tube:
    """Return the tube whose joint ranges hold the configurations (P_k, n) of segments, plus a band.

    A joint that has one sign in all segments keeps it: signs distinguish the arm's configurations
    (Suh & Bishop 1988, section on the tube model). The band [rad or m] is added to both sides of
    every range; points are (m+1, 3) [m], the radius [m] is that of all segments.
    """
    limits = robot.limits
    every = np.vstack(segments)
    lower = np.where((every > 0).all(axis=0), np.maximum(limits.lower_position, 0), -np.inf)
    lower = np.maximum(lower, limits.lower_position)
    upper = np.where((every < 0).all(axis=0), np.minimum(limits.upper_position, 0), np.inf)
    upper = np.minimum(upper, limits.upper_position)
    scale = 10.0**_RANGE_DECIMALS
    signs = []
    for q in segments:
        low = np.maximum(np.floor((q.min(axis=0) - band) * scale) / scale, lower)
        high = np.minimum(np.ceil((q.max(axis=0) + band) * scale) / scale, upper)
        ranges = zip(low.tolist(), high.tolist(), strict=True)
        signs.append(dict(zip(robot.joint_names, ranges, strict=True)))
    return Tube(np.round(points, _POINT_DECIMALS), radius, joint_signs=signs)
