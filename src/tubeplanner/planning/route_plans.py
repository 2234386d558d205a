"""Attempts where the tool may be anywhere: the joint line, stops at a route's corners, the route.

Refinement of the straight line in joint space knows nothing of obstacles; where it leads to a
motion, that is nearly as fast as a lower bound, in nine of ten cases. A route is free on the
straight lines between its corners: stopping at each of them is an answer at once. Refinement along
a route begins with a free spline, and none of its steps leaves free space.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.branches import ReferenceBranch
from tubeplanner.first_guess.joint_routes import RouteSearch
from tubeplanner.first_guess.stop_at_corners import stop_along
from tubeplanner.geometry.tube.points import densified
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.optimizer.phased_spline import PhasedSpline
from tubeplanner.optimizer.stages import Refinement
from tubeplanner.optimizer.starts import free_start, starting_spline
from tubeplanner.outcome import (
    Infeasible,
    Location,
    PlanningClock,
    PlanStatus,
    StoppedBy,
    until_stopped,
)
from tubeplanner.planning.options import QUALITIES, STOP_AT_CORNERS, PlanOptions
from tubeplanner.planning.refined_plan import certified_refinement, entered
from tubeplanner.planning.result import (
    PlanResult,
    certified_result,
    refused_result,
    stopped_result,
)
from tubeplanner.planning.waypoint_plans import resting_plan
from tubeplanner.task.problem import PlanningProblem

# A motion that takes no longer than this multiple of a lower bound ends the attempts.
_NEARLY_LEAST = 1.01
_ROUTE_STEP = 0.05  # [rad or m] of the joint that moves most, between samples of a route
# Knot intervals of the joint line, and parts of the first division: with fewer at the end of it, a
# fifth of the motions round obstacles are missed.
_LINE_INTERVALS, _LINE_PARTS = 8, 2
_MIN_PARTS = 2  # of a knot interval of a free route
# Seed of a search, edges that it tests at most, and routes: of 9 problems whose motion was far
# above its bound, the first 3 routes had the fastest motion in 6, the first 6 in 9.
SEED: int = 1
EDGES: int = 300_000
MAX_ROUTES: int = 6
# A search ends after this number of routes in a row that gain less than this fraction.
_MAX_IN_VAIN, _GAIN = 3, 0.002


class RoutePlans:
    """Plans of problems that differ in their route and goal alone.

    Attributes:
        best: The fastest certified result; None: there is none yet.
        problem: The problem of `best`.
        durations: Duration of every attempt [s]; None where nothing was certified.
        routes: Number of routes that were found and planned along.
        edges: Number of straight edges that searches for routes tested.
        first_time: Wall time of the first certified result, by the clock [s]; None: none yet.
    """

    def __init__(self, options: PlanOptions, clock: PlanningClock) -> None:
        """Plan nothing yet."""
        self._clock, self._method = clock, options.method
        self._knots = QUALITIES[options.quality].free_knots
        self._refusal: PlanResult | None = None
        self.best: PlanResult | None = None
        self.problem: PlanningProblem | None = None
        self.durations: list[float | None] = []
        self.routes = self.edges = 0
        self.first_time: float | None = None

    def rest(self, problem: PlanningProblem) -> bool:
        """Plan a rest and return True if a problem's route ends where it begins."""
        result = resting_plan(problem, _route(problem)[[0, -1]], self._method, self._clock)
        if result is not None:
            self._offer(problem, result)
        return result is not None

    def stop_at_corners(self, problem: PlanningProblem) -> None:
        """Plan a stop at each corner of a problem's route.

        Raises:
            Infeasible: Gravity exceeds a motor's effort.
            TimeLimitReached: The time limit has passed; likewise KeyboardInterrupt, as below.
        """
        self._clock.enter("stops at the corners of the route")
        try:
            trajectory = stop_along(problem, _route(problem), self._clock.check)
        except Infeasible as reason:
            if not problem.holding:
                raise
            # A route may lean by more than a held part allows; refinement may turn the tool back.
            self._offer(problem, refused_result(reason, self._method))
            return
        self._offer(problem, certified_result(problem, trajectory, STOP_AT_CORNERS, self._clock))

    def refine_line(self, problem: PlanningProblem) -> None:
        """Plan by refinement of the straight line in joint space; raises as `stop_at_corners`.

        Nothing is planned by method "stop-at-corners"; likewise in `refine`.
        """
        if self._method == STOP_AT_CORNERS:
            return
        line = _branch(_route(problem)[[0, -1]])
        spline = starting_spline(problem, line, _LINE_INTERVALS)
        parts = max(self._knots // (_LINE_INTERVALS * _LINE_PARTS), _MIN_PARTS)
        self._refine(problem, spline, (_LINE_PARTS, parts), is_cautious=False)

    def refine(self, problem: PlanningProblem) -> None:
        """Plan by refinement of a problem's route; raises as `stop_at_corners`."""
        if self._method == STOP_AT_CORNERS:
            return
        spline = free_start(problem, _branch(_route(problem)))
        parts = max(round(self._knots / spline.grid.interval_count), _MIN_PARTS)
        self._refine(problem, spline, (parts,), is_cautious=True)

    def search(
        self, problem: PlanningProblem, goals: FloatArray, count: int, *, seed: int, edges: int
    ) -> None:
        """Search for routes to any of some goals (G, n), and plan along each, at most a number.

        The first edges are those that are left of a number of all searches. Where there is no
        motion yet, stops at the corners of the first route come first.

        Raises:
            Infeasible: Status no_trajectory: no route was found, and there is no motion yet.
            TimeLimitReached: The time limit has passed; likewise KeyboardInterrupt.
        """
        self._clock.enter("searching for a route")
        start = problem.endpoints[0].joints
        assert start is not None
        search, in_vain = RouteSearch(problem, start, goals), 0
        left = max(edges - self.edges, 1)
        for route in islice(search.routes(seed, left, lambda: self._clock.remaining <= 0), count):
            self.routes += 1
            before, along = self.duration, with_route(problem, route)
            with self._clock.within(f"route {self.routes}"):
                if self.best is None:
                    self.stop_at_corners(along)
                self.refine(along)
            in_vain = in_vain + 1 if self.duration > (1 - _GAIN) * before else 0
            is_last = self._method == STOP_AT_CORNERS or in_vain == _MAX_IN_VAIN
            if is_last or self.are_enough(lower_bound(along).duration):
                break
            self._clock.enter("searching for a route")
        self.edges += search.edges
        self._clock.check()
        if self.routes == 0 and self.best is None:
            tool = problem.robot.tool_position(search.reached[None])[0]
            x, y, z = tool
            message = (
                f"no route was found by {search.edges} edges; the last search brought the tool to "
                f"[{x:.3f}, {y:.3f}, {z:.3f}] m: move what is in the way, choose another goal "
                "configuration, or give more edges (`tubeplanner route`) or a tube"
            )
            raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Location().at(tool))

    def are_enough(self, least: float) -> bool:
        """Return True if no other plan is much faster, as all take the least duration [s]."""
        return self.duration <= _NEARLY_LEAST * least

    @property
    def duration(self) -> float:
        """Duration of the fastest certified result [s]; infinite without one."""
        best = None if self.best is None else self.best.duration
        return np.inf if best is None else best

    def result(self, stopped_by: StoppedBy | None = None) -> PlanResult:
        """Return the best result, or the first refusal, of planning that may have been stopped."""
        if self.best is None and stopped_by is not None:
            return stopped_result(self._clock, stopped_by, self._method)
        result = self.best or self._refusal
        assert result is not None
        return replace(result, stopped_by=stopped_by)

    def _refine(
        self,
        problem: PlanningProblem,
        spline: PhasedSpline,
        divisions: tuple[int, ...],
        *,
        is_cautious: bool,
    ) -> None:
        knots = spline.grid.interval_count * int(np.prod(divisions))
        refinement = Refinement(
            problem, spline, divisions, entered(knots, self._clock), is_cautious=is_cautious
        )
        result = None
        with suppress(Infeasible):  # nothing from this start
            result = certified_refinement(
                problem, refinement, self._clock, needs_reason=is_cautious
            )
        self._offer(problem, result)

    def _offer(self, problem: PlanningProblem, result: PlanResult | None) -> None:
        """Keep a result if it is the fastest, or the first refusal."""
        duration = None if result is None else result.duration
        self.durations.append(duration)
        if duration is not None and duration < self.duration:
            self.first_time = self.first_time or self._clock.elapsed
            self.best, self.problem = result, problem
        self._refusal = self._refusal or result
        if result is not None and result.stopped_by == "interrupt":
            raise KeyboardInterrupt
        self._clock.check()


def with_route(problem: PlanningProblem, route: FloatArray) -> PlanningProblem:
    """Return a problem with a route (P, n) in its tube, and the goal where it ends."""
    return problem.with_tube(replace(problem.tube, route=route), route[-1])


def _route(problem: PlanningProblem) -> FloatArray:
    assert problem.tube.route is not None
    return problem.tube.route


def _branch(route: FloatArray) -> ReferenceBranch:
    return ReferenceBranch((densified(route, _ROUTE_STEP),))


def route_plan(problem: PlanningProblem, options: PlanOptions, clock: PlanningClock) -> PlanResult:
    """Return the fastest plan along a problem's route; after Ctrl-C or the time limit, so far."""
    plans, least = RoutePlans(options, clock), lower_bound(problem).duration
    attempts: tuple[Callable[[PlanningProblem], None], ...] = (
        plans.refine_line,
        plans.stop_at_corners,
        plans.refine,
    )

    def work() -> None:
        for attempt in attempts:
            attempt(problem)
            if plans.are_enough(least):
                return

    try:
        _, stopped_by = until_stopped(work)
    except Infeasible as reason:
        return plans.best or refused_result(reason, options.method)
    return plans.result(stopped_by)
