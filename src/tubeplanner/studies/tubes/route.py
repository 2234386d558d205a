"""Find_route: the fastest motion from start, goal and obstacles alone, and its joint route."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import require_free
from tubeplanner.checks import checked_options, require_between, require_count
from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.branches import configured_ends
from tubeplanner.first_guess.joint_routes import FreeSpace, RouteSearch
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.outcome import (
    Infeasible,
    Location,
    PlanningClock,
    PlanStatus,
    Progress,
    ProgressCallback,
    require_callback,
    until_stopped,
)
from tubeplanner.planning.free_plans import goal_configurations, search_plans
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.route_plans import EDGES, SEED, RoutePlans
from tubeplanner.studies.tubes.planned_tube import (
    PlannedTube,
    TubeAnswer,
    answer_of,
    common_tool_limits,
    followed,
    measure_options,
    measured_plan,
)
from tubeplanner.studies.tubes.routes import tool_corners
from tubeplanner.studies.tubes.segment_measurement import samples_of
from tubeplanner.task.endpoints import GoalRegion
from tubeplanner.task.problem import PlanningProblem

# ---- A motion from start, goal and obstacles alone: the question that Suh & Bishop 1988 left open.
#
# The tool may be anywhere. Goal configurations come in the order of their lower bounds. First the
# straight line to the best goal in joint space is refined; where that is not nearly as fast as its
# bound, routes are searched for, and each is refined. The fastest motion is the answer. Its route
# goes into a problem file, of which `plan` makes that motion.

_STEPS = 3  # the joint line, routes, the motion that is written and a measured tube
# A tube is measured about a motion with so much room [m], else about as many routes.
_ROOM, _MAX_MEASURED = (0.03, 0.01), 2


@dataclass(frozen=True)
class RouteOptions:
    """How to find a route.

    Attributes:
        seed: Of all random numbers, >= 1; the same seed gives the same answer.
        edges: Number of straight edges between configurations that the search tests at most.
        band: Width by which joints may leave the route's ranges, before measuring [rad or m].
        max_radius: Largest radius of a measured segment [m].
        samples: Number of configurations of a segment in the last counterexample search.
        time_limit: Wall time after which the search ends with the best it has [s]; None: never.
        measures: Whether a tube in which nothing collides is measured around the motion.
    """

    seed: int = SEED
    edges: int = EDGES
    band: float = 0.4
    max_radius: float = 0.2
    samples: int = 2_000
    time_limit: float | None = None
    measures: bool = False

    def __post_init__(self) -> None:
        require_count(self, 1, "seed", "edges", "samples")
        require_between(self, 0, np.inf, "band")
        require_between(self, 0, np.inf, "max_radius", unit="m")
        if self.time_limit is not None:
            require_between(self, 0, None, "time_limit", unit="s")


def find_route(
    problem: PlanningProblem,
    options: RouteOptions | None = None,
    progress: ProgressCallback | None = None,
) -> TubeAnswer:
    """Find the fastest motion from a problem's start to its goal, and a route for it.

    Args:
        problem: Start, goal and obstacles count. The tube does not, but for its last point, which
            is the goal where the goal is left open, and a limit on the tool's speed.
        options: How to find the route.
        progress: Called as each stage begins, with the duration of the best motion so far.

    Raises:
        OptionError: An argument is of another kind.
        ProblemError: The problem is none, or its start is given by a seed.
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    PlanningProblem.require(problem)
    options = checked_options(options, RouteOptions)
    require_callback(progress)
    if problem.endpoints[0].kind == "seed":
        raise ProblemError("start.joints is required: a seed belongs to the first point of a tube")
    finder = _RouteFinder(problem, options, progress)
    try:
        _, stopped_by = until_stopped(finder.search)
    except Infeasible as reason:
        return answer_of(reason, **finder.facts)
    plans, clock = finder.plans, finder.clock
    if plans.best is None and stopped_by == "interrupt":
        raise KeyboardInterrupt
    if plans.best is None and stopped_by is not None:
        late, status = clock.past_limit, PlanStatus.TIME_LIMIT
        return TubeAnswer(status, late, Location(), stopped_by=stopped_by, **finder.facts)
    result = plans.result(stopped_by)
    if plans.problem is None:
        return TubeAnswer(result.status, result.message, result.location, **finder.facts)
    answer: PlannedTube | Infeasible = PlannedTube(plans.problem, result)
    if stopped_by is None:
        answer = followed(PlannedTube(plans.problem, result), clock)
    else:
        finder.notes.append(
            f"the search was stopped by {stopped_by.replace('_', ' ')} in step {finder.step} of "
            f"{_STEPS}: there may be a faster motion"
        )
    if isinstance(answer, PlannedTube):  # the bound is that of all goal configurations
        answer = replace(answer, result=replace(answer.result, bound=finder.bound))
    return answer_of(answer, stopped_by=stopped_by, **finder.facts)


class _RouteFinder:
    """The steps from a problem to its fastest motion.

    Attributes:
        bound: Lower bound on the duration of all motions from the start to the goal.
        clock: Of the whole search.
        plans: The motions along routes.
        measured: The measured tube, if any.
        step: Number of the current step, from 1.
        notes: On the search.
    """

    def __init__(
        self, problem: PlanningProblem, options: RouteOptions, progress: ProgressCallback | None
    ) -> None:
        def announce(stage: Progress) -> None:
            assert progress is not None
            best = None if self.plans.best is None else self.plans.duration
            whole = f"step {self.step} of {_STEPS}, {stage.stage}"
            progress(replace(stage, stage=whole, best_duration=best))

        self._options, self._problem = options, free_problem(problem)
        self.bound = lower_bound(self._problem)
        self.clock = PlanningClock(options.time_limit, None if progress is None else announce)
        self.plans = RoutePlans(PlanOptions(slack=0.0), self.clock)
        self.measured: PlannedTube | None = None
        self.step = 1
        self.notes: list[str] = []

    @property
    def facts(self) -> dict[str, Any]:
        """Fields of an answer beside its motion."""
        return {
            "measured": self.measured,
            "notes": tuple(self.notes),
            "routes": self.plans.routes,
            "edges": self.plans.edges,
            "first_answer_time": self.plans.first_time,
            "search_time": self.clock.elapsed,
        }

    def search(self) -> None:
        """Find the fastest motion, and the measured tube if that is required.

        Raises:
            Infeasible: An end is not free or out of reach, or no route was found.
            TimeLimitReached: Before the end; likewise KeyboardInterrupt.
        """
        pose = self._problem.endpoints[1].pose
        begun = self._problem
        if pose is not None:  # which configuration is the goal's is chosen below
            begun = replace(begun, goal=GoalRegion(pose.position))
        begun, notes = configured_ends(begun)
        self.notes += notes
        start = begun.endpoints[0].joints
        assert start is not None
        require_free(begun, "start", start)
        self._problem = replace(self._problem, start=start)
        goals = goal_configurations(self._problem, start, self._options.seed)
        for _ in search_plans(
            self.plans, self._problem, goals, self._options.seed, self._options.edges
        ):
            self.step = 2
        self.step = 3
        if self._options.measures and self.plans.best is not None:
            self._measure()

    def _measure(self) -> None:
        """Measure a tube about a motion with some room, else about a route, or note the reason."""
        assert self.plans.problem is not None
        problem, how = self.plans.problem, self._options
        ends = np.array([end.joints for end in problem.endpoints])
        space = FreeSpace(problem, 0.0, ends)
        sizes = measure_options(how.max_radius, how.samples, how.seed)
        reason: object = None
        for path, guide in self._paths_with_room(problem, ends):
            self.clock.enter("reference points along a path")
            corners = tool_corners(space, path)
            if corners is None:
                reason = reason or "links collide where the tool goes straight between points"
                continue
            parts = problem, space, corners, how.band, sizes, self.clock
            try:
                self.measured = measured_plan(*parts, guide)
                return
            except Infeasible as why:
                reason = reason or why
        self.notes.append(
            f"no tube could be measured in which nothing collides: {reason or 'there is no route'}"
            "; the motion itself is certified"
        )

    def _paths_with_room(
        self, problem: PlanningProblem, ends: FloatArray
    ) -> Iterator[tuple[FloatArray, FloatArray | None]]:
        """Yield paths (N, n), and those that are fast motions once more.

        The fastest motion touches obstacles: motions and routes keep a distance from them.
        """
        search = RouteSearch(problem, ends[0], ends[1:])
        routes = list(islice(search.routes(self._options.seed, self._options.edges), _MAX_MEASURED))
        for margin in _ROOM:
            plans = RoutePlans(PlanOptions(slack=0.0), self.clock)
            for route in [ends, *routes]:
                wider = free_problem(problem.farther_apart(margin), route)
                (plans.refine_line if route is ends else plans.refine)(wider)
                if plans.best is not None:
                    motion = samples_of(plans.best)
                    assert motion is not None
                    yield motion, motion
                    break
        for route in routes:
            yield route, None


def free_problem(problem: PlanningProblem, route: FloatArray | None = None) -> PlanningProblem:
    """Return a problem with the tool free from start to goal, and a route (P, n).

    Limits on the tool's speed and acceleration stay if they are the same in all segments.
    """
    tube, ends = problem.tube, []
    for point, end in zip((0, -1), problem.endpoints, strict=True):
        position = tube.points[point] if end.position is None else end.position
        ends.append(position)
        if end.joints is not None:
            ends[-1] = problem.robot.tool_position(end.joints[None])[0]
    return problem.with_tube(Tube.anywhere(*ends, route=route, **common_tool_limits(tube)))
