"""Free configurations; joint routes by OMPL; few reference points along a route, and their tube."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OptionError, not_installed
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.geometry.tube.points import densified, farthest_from_line
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.outcome import Location
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.required_distances import RequiredDistances

# ---- Free configurations: links clear of obstacles and of each other, by a margin.

# Where an end of the trajectory has less clearance than the margin, this fraction of that clearance
# is kept everywhere.
_FRACTION_AT_ENDS = 0.9


class FreeSpace:
    """The configurations in which links are farther apart than a problem requires.

    Attributes:
        robot: The arm.
    """

    def __init__(self, problem: PlanningProblem, margin: float, ends: FloatArray) -> None:
        """Take the pairs of a problem, without its tube, and a margin beyond the clearance [m].

        Pairs of shapes that are nearer at the ends (E, n), at least one, from start to goal, need
        not be farther apart elsewhere.
        """
        checker = problem.collision
        self.robot, self._checker, self._pairs = problem.robot, checker, checker.pairs
        self._requirement = RequiredDistances(problem, ends[0], ends[-1])
        self._margin = np.zeros(len(self._pairs))
        if margin > 0:
            least = np.min([self.clearances(q) for q in ends], axis=0, initial=margin)
            self._margin = np.clip(_FRACTION_AT_ENDS * least, 0.0, margin)

    def is_free(self, q: FloatArray) -> bool:
        """Return True if a configuration (n,) has the margin."""
        return self.shortfall(q) is None

    def shortfall(self, q: FloatArray) -> Location | None:
        """Return the closest links and the tool's position where the margin is missing, or None."""
        rotation, position = self.robot.body_poses(q[None])
        required = self._required(q) + self._margin
        quick = self._checker.sphere_distances(rotation, position, self._pairs)[0] - required
        near = np.flatnonzero(quick < 0)
        alone = np.zeros(len(near), dtype=np.int64)
        boxes = self._checker.box_distances(rotation, position, alone, self._pairs[near])
        near = near[boxes < required[near]]
        distance = self._checker.distances(rotation[0], position[0], self._pairs[near])
        short = distance - required[near]
        if short.min(initial=0.0) >= 0:
            return None
        links, obstacle = self._checker.owners(self._pairs[near[short.argmin()]])
        return Location(links=links, obstacle=obstacle).at(self.robot.tool_position(q[None])[0])

    def clearances(self, q: FloatArray) -> FloatArray:
        """Return the distances of all pairs beyond the clearance at a configuration (n,), [m]."""
        rotation, position = self.robot.body_poses(q[None])
        return self._checker.distances(rotation[0], position[0], self._pairs) - self._required(q)

    def _required(self, q: FloatArray) -> FloatArray:
        return self._requirement.anywhere(self.robot.tool_position(q[None]))[0]


# ---- Collision-free routes in joint space, found by OMPL.
#
# Sucan, Moll & Kavraki, "The Open Motion Planning Library" (IEEE Robotics & Automation Magazine
# 19(4), 2012); Kuffner & LaValle, "RRT-Connect" (ICRA 2000). Only this module knows OMPL.

_STEP = 0.05  # [rad or m] between configurations tested along an edge
# Joint ranges of the search beyond start and goals, unless limits are nearer [rad or m].
_BEYOND = np.pi
_MIN_SPAN = 1e-6  # [rad or m]: OMPL wants bounds that differ
_SHORTENINGS = 5


def require_ompl() -> None:
    """Check that OMPL is installed, before any work.

    Raises:
        OptionError: It is not installed.
    """
    try:
        import ompl.base
    except ImportError:
        raise OptionError(not_installed("route", "finding a route", "OMPL 2")) from None
    _ = ompl.base


class RouteSearch:
    """A search from a configuration to any of several goals; the same for the same seed.

    Attributes:
        checks: Number of configurations tested by the last search.
        reached: Configuration (n,) nearest to a goal that the last search without a route reached
            from the start.
    """

    def __init__(self, space: FreeSpace, start: FloatArray, goals: FloatArray) -> None:
        """Prepare a search from a start (n,) to any of some goals (G, n).

        Raises:
            OptionError: OMPL is not installed.
        """
        require_ompl()
        from ompl import base

        self._space, self._start, self._goals = space, start, goals
        ends, limits = np.vstack([start, *goals]), space.robot.limits
        least, most = ends.min(axis=0), ends.max(axis=0)
        low = np.minimum(np.maximum(limits.lower_position, least - _BEYOND), least)
        high = np.maximum(np.minimum(limits.upper_position, most + _BEYOND), most)
        self._states = base.RealVectorStateSpace(0)
        for bounds in zip(low, np.maximum(high, low + _MIN_SPAN), strict=True):
            self._states.addDimension(*(float(bound) for bound in bounds))
        self.checks = 0
        self.reached = start

    def route(
        self, seed: int, budget: int, is_over: Callable[[], bool] = lambda: False
    ) -> FloatArray | None:
        """Return the corners (P, n) of a free route, shortened; None if none was found.

        OMPL's random numbers have a seed > 0; they are one stream for the whole process. Before
        there is a route at most `budget` configurations are tested.
        """
        from ompl import base, geometric, util

        def is_valid(state: Any) -> bool:
            self.checks += 1
            return self._space.is_free(self._values(state))

        util.noOutputHandler()  # OMPL logs to standard output
        try:
            util.RNG.setSeed(seed)
            self.checks = 0
            setup = geometric.SimpleSetup(self._states)
            setup.setStateValidityChecker(is_valid)
            information = setup.getSpaceInformation()
            information.setStateValidityCheckingResolution(_STEP / information.getMaximumExtent())
            setup.setStartState(self._state(self._start))
            goals = base.GoalStates(information)
            for goal in self._goals:
                goals.addState(self._state(goal))
            setup.setGoal(goals)
            setup.setPlanner(geometric.RRTConnect(information))
            is_done = base.PlannerTerminationCondition(lambda: self.checks >= budget or is_over())
            setup.solve(is_done)
            if not setup.haveSolutionPath():
                return None
            path = setup.getSolutionPath()
            if not setup.haveExactSolutionPath():
                self.reached = self._corners(path)[-1]
                return None
            simplifier = setup.getPathSimplifier()
            for _ in range(_SHORTENINGS):
                simplifier.reduceVertices(path)
                simplifier.partialShortcutPath(path)
                simplifier.collapseCloseVertices(path)
            return self._corners(path)
        finally:
            util.restorePreviousOutputHandler()

    def _state(self, q: FloatArray) -> Any:
        state = self._states.allocState()
        for j, value in enumerate(q):
            state[j] = float(value)
        return state

    def _values(self, state: Any) -> FloatArray:
        return np.array([state[j] for j in range(len(self._start))])

    def _corners(self, path: Any) -> FloatArray:
        return np.array([self._values(state) for state in path.getStates()])


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
