"""Routes from start to goal, several of them: each search finds another one."""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.options import require_between, require_count
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import PlanningClock
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube_sources.free_space import FreeSpace
from tubeplanner.tube_sources.joint_route import RouteSearch
from tubeplanner.tube_sources.measured_plan import plan_under
from tubeplanner.tube_sources.tool_corners import ToolCorners, tool_corners

# Distance kept from obstacles beyond the clearance [m]: wide tubes are fast, narrow passages are
# short.
_MARGINS = (0.03, 0.01)
_MIN_MARGIN = 0.002  # where there is no route with more
_SAMPLES_PER_PIECE = 10
_SHARE_OF_TIME = 0.3  # of a time limit: after that, no more routes are searched than there are


@dataclass(frozen=True)
class RouteOptions:
    """How to find a route.

    Attributes:
        seed: Of all random numbers, >= 1; the same seed gives the same answer.
        tries: How many routes to search for with each distance from obstacles.
        checks: How many configurations a try tests before it gives up.
        band: How far joints may leave the route's ranges in a segment, before measuring [rad, m].
        max_radius: No segment gets a larger radius [m].
        samples: How many configurations of a segment the last counterexample search draws.
        time_limit: Wall time after which the search ends with the best it has [s]; None: never.
    """

    seed: int = 1
    tries: int = 3
    checks: int = 20_000
    band: float = 0.4
    max_radius: float = 0.2
    samples: int = 2_000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_count(self, 1, "seed", "tries", "checks", "samples")
        require_between(self, 0, np.inf, "band")
        require_between(self, 0, np.inf, "max_radius", unit="m")
        if self.time_limit is not None:
            require_between(self, 0, None, "time_limit", unit="s")


@dataclass(frozen=True, eq=False)
class RouteCandidate:
    """A route whose tool goes straight between few reference points.

    Attributes:
        space: The configurations that are free.
        corners: Its reference points, and the arm between them.
        joint_time: The least time its joints take at their largest velocities [s]; joints without
            one count as if it were 1 rad/s or 1 m/s.
    """

    space: FreeSpace
    corners: ToolCorners
    joint_time: float


def route_candidates(
    problem: PlanningProblem,
    start: FloatArray,
    goals: FloatArray,
    options: RouteOptions,
    clock: PlanningClock,
) -> list[RouteCandidate]:
    """Return routes that were found, the one of the least joint time first.

    A trajectory that optimisation alone finds counts as a route too.

    Args:
        problem: Its arm and obstacles count.
        start: Shape (n,).
        goals: Free configurations, one of which it must reach, shape (G, n).
        options: How to find them.
        clock: Announces progress and may end the work.

    Raises:
        Infeasible: Status no_trajectory: none was found.
        TimeLimitReached: Before one was.
    """
    found: list[RouteCandidate] = []
    ends = np.vstack([start, goals])
    limits = problem.robot.limits
    for margin in (*_MARGINS, _MIN_MARGIN):
        if found and margin == _MIN_MARGIN:
            break
        space = FreeSpace(problem, margin, ends)
        search = RouteSearch(space, start, goals, limits.lower_position, limits.upper_position)
        for k in range(options.tries):
            clock.enter(f"route {k + 1} of {options.tries}, {1000 * margin:g} mm from obstacles")
            route = search.route(options.seed + k, options.checks, lambda: clock.remaining <= 0)
            found += _candidates(problem.robot, space, route)
            if found and clock.used > _SHARE_OF_TIME:
                return sorted(found, key=lambda candidate: candidate.joint_time)
    if not found:
        clock.check()
        raise _no_route(problem, search, options)
    space = FreeSpace(problem, _MIN_MARGIN, ends)
    for margin in _MARGINS:
        clock.enter(f"a trajectory without a route, {1000 * margin:g} mm from obstacles")
        way = _candidates(problem.robot, space, _trajectory(problem, goals[0], margin, clock))
        found += way
        if way or clock.used > _SHARE_OF_TIME:
            break
    return sorted(found, key=lambda candidate: candidate.joint_time)


def _candidates(
    robot: RobotModel, space: FreeSpace, route: FloatArray | None
) -> list[RouteCandidate]:
    corners = None if route is None else tool_corners(robot, space, route)
    if corners is None:
        return []
    return [RouteCandidate(space, corners, _joint_time(robot, corners.lines))]


def _trajectory(
    problem: PlanningProblem, goal: FloatArray, margin: float, clock: PlanningClock
) -> FloatArray | None:
    """Return the fastest trajectory from straight joint lines, if it avoids all obstacles."""
    wider = replace(problem.farther_apart(margin), goal=goal)
    planned = plan_under(clock, wider, "fast")
    if planned.trajectory is None:
        return None
    return planned.trajectory.per_piece(_SAMPLES_PER_PIECE).position


def _joint_time(robot: RobotModel, lines: tuple[FloatArray, ...]) -> float:
    speed = np.where(np.isfinite(robot.limits.velocity), robot.limits.velocity, 1.0)
    steps = np.concatenate([abs(np.diff(q, axis=0)) / speed for q in lines])
    return float(steps.max(axis=1).sum())


def _no_route(problem: PlanningProblem, search: RouteSearch, options: RouteOptions) -> Infeasible:
    tool = problem.robot.tool_position(search.reached[None])[0]
    x, y, z = tool
    message = (
        f"no route was found in {options.tries * (1 + len(_MARGINS))} tries of {options.checks} "
        f"configurations; the last one brought the tool to [{x:.3f}, {y:.3f}, {z:.3f}] m: move "
        "what is in the way, choose another goal configuration, or give it more tries or checks"
    )
    return Infeasible(PlanStatus.NO_TRAJECTORY, message, Place().at(tool))
