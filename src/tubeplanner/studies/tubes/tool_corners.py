"""Few reference points along a route; a tube about them.

Between two points of the route the tool goes straight, and redundant joints follow the route. Where
links collide in between, another point of the route is added.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.geometry.tube.points import densified, farthest_from_line
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.robot.model import RobotModel
from tubeplanner.studies.tubes.joint_routes import FreeSpace

_ROUTE_STEP = 0.05  # [rad or m] of the joint that moves most, between samples of the route
_MAX_STEP = 0.02  # [m] of the tool on a line
_MAX_JOINT_STEP = 0.3  # [rad or m] between neighbours on a line: more is another branch
_ON_LINE = 1e-6  # [m]
_MIN_DISTANCE = 1e-3  # [m] between neighbouring reference points


@dataclass(frozen=True, eq=False)
class ToolCorners:
    """Reference points, and configurations along the straight lines between.

    Attributes:
        points: Shape (m+1, 3) [m].
        lines: Per segment, configurations from its start to its end, shape (P_k, n).
        parts: Per segment, the samples of the route that the line replaces, shape (R_k, n).
    """

    points: FloatArray
    lines: tuple[FloatArray, ...]
    parts: tuple[FloatArray, ...]


def tool_corners(
    robot: RobotModel, space: FreeSpace, route: FloatArray, deviation: float = np.inf
) -> ToolCorners | None:
    """Return few corners of the tool's path along a route, with free straight lines between.

    Args:
        robot: The arm.
        space: The free configurations.
        route: Corners of a route in joint space, shape (P, n).
        deviation: Largest distance of the lines from the tool's path along the route [m].

    Returns:
        None if even the route itself is not free where the tool follows straight lines.
    """
    return _Corners(robot, space, densified(route, _ROUTE_STEP), deviation).result()


def with_another_corner(
    robot: RobotModel, space: FreeSpace, corners: ToolCorners, segment: int
) -> ToolCorners | None:
    """Return corners with another corner midway in a segment's part of the route.

    Args:
        robot: The arm.
        space: The free configurations.
        corners: Result of `tool_corners`.
        segment: Index of the segment to part.

    Returns:
        None if the segment cannot be parted.
    """
    part = corners.parts[segment]
    middle = len(part) // 2
    halves = [tool_corners(robot, space, half) for half in (part[: middle + 1], part[middle:])]
    before, after = halves
    if before is None or after is None:
        return None
    cut = slice(segment, segment + 1)
    forward, behind = corners.points[: segment + 1], corners.points[segment + 1 :]
    points = np.vstack([forward, before.points[1:], after.points[1:-1], behind])
    lines, parts = list(corners.lines), list(corners.parts)
    lines[cut] = [*before.lines, *after.lines]
    parts[cut] = [*before.parts, *after.parts]
    return ToolCorners(points, tuple(lines), tuple(parts))


class _Corners:
    """The choice of samples (N, n) of a route whose tool positions become corners."""

    def __init__(
        self, robot: RobotModel, space: FreeSpace, route: FloatArray, deviation: float
    ) -> None:
        self._robot, self._space, self._route = robot, space, route
        self._deviation = deviation
        self._tool = robot.tool_position(route)
        self._line = cache(self._walked)

    def result(self) -> ToolCorners | None:
        corners = self._between(0, len(self._route) - 1)
        if corners is None:
            return None
        corners.insert(0, 0)
        k = 1
        while k < len(corners) - 1:
            if self._line(corners[k - 1], corners[k + 1]) is None:
                k += 1
            else:  # a longer free line makes the corner unnecessary
                del corners[k]
                k = max(k - 1, 1)
        lines = tuple(q for i, j in pairwise(corners) if (q := self._line(i, j)) is not None)
        parts = tuple(self._route[i : j + 1] for i, j in pairwise(corners))
        return ToolCorners(self._tool[corners], lines, parts)

    def _between(self, i: int, j: int) -> list[int] | None:
        """Return the corners after sample i, up to sample j."""
        if self._line(i, j) is not None:
            return [j]
        middle, distance = farthest_from_line(self._tool, i, j)
        if distance <= _MIN_DISTANCE:
            middle = (i + j) // 2
            gaps = np.linalg.norm(self._tool[[i, j]] - self._tool[middle], axis=1)
            if gaps.min() <= _MIN_DISTANCE:
                return None
        before = self._between(i, middle)
        after = None if before is None else self._between(middle, j)
        return None if before is None or after is None else before + after

    def _walked(self, i: int, j: int) -> FloatArray | None:
        """Return configurations (P, n) along the tool's line between samples; None if not free."""
        route, ends = self._route[i : j + 1], self._tool[[i, j]]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if length < _MIN_DISTANCE or farthest_from_line(self._tool, i, j)[1] > self._deviation:
            return None
        count = max(len(route), int(np.ceil(length / _MAX_STEP)) + 1)
        fractions = np.linspace(0, 1, count)
        positions, samples = fractions * (len(route) - 1), np.arange(len(route))
        guides = np.stack([np.interp(positions, samples, q) for q in route.T], axis=1)
        line, limits = [route[0]], self._robot.limits
        bounds = limits.lower_position, limits.upper_position
        for fraction, guide in zip(fractions[1:], guides[1:], strict=True):
            target = (1 - fraction) * ends[0] + fraction * ends[1]
            solution = solve_position(self._robot, target, line[-1], *bounds, guide)
            jump = abs(solution.q - line[-1]).max()
            if solution.error > _ON_LINE or jump > _MAX_JOINT_STEP:
                return None
            if not self._space.is_free(solution.q):
                return None
            line.append(solution.q)
        arrives = abs(line[-1] - route[-1]).max() < _MAX_JOINT_STEP
        return np.vstack([*line, route[-1:]]) if arrives else None


_POINT_DECIMALS, _RANGE_DECIMALS = 6, 4


def reference_tube(
    robot: RobotModel,
    points: FloatArray,
    segments: Sequence[FloatArray],
    band: float,
    radius: float,
) -> Tube:
    """Return the tube whose joint ranges hold the arm's path in each segment, plus a band.

    A joint that has one sign in all segments keeps it: signs distinguish the arm's configurations
    (Suh & Bishop 1988, section on the tube model).

    Args:
        robot: The arm.
        points: Reference points, shape (m+1, 3) [m].
        segments: Configurations of each segment, shape (P_k, n) [rad or m].
        band: Added to both sides of every range [rad or m].
        radius: Path tolerance of all segments [m].
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
