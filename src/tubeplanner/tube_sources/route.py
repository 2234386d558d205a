"""A tube from start, goal and obstacles alone: the question that Suh & Bishop 1988 left open.

Routes are found at random; the hand's path along each becomes few reference points. The most
promising are planned, and the tube of the fastest is measured.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.planner import plan
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.tube_sources.goal_configurations import goal_configurations
from tubeplanner.tube_sources.reference_tube import reference_tube
from tubeplanner.tube_sources.route_candidates import (
    RouteCandidate,
    RouteOptions,
    route_candidates,
)
from tubeplanner.tube_sources.tube_measurement import MeasureOptions, measure_tube
from tubeplanner.verification.refusal import require_free

# Routes are compared by the motion through a tube of this radius [m].
_RADIUS_TO_COMPARE = 0.05
_MOST_COMPARED = 3


@dataclass(frozen=True, eq=False)
class RouteResult:
    """What came of looking for a route.

    Attributes:
        status: Success means that the motion through the measured tube is certified.
        message: One sentence.
        place: Where, if there is no answer.
        problem: What was asked, with its tube and goal; None unless successful.
        planned: The plan of that problem; likewise.
        durations: Of the routes that were compared, each in a tube of 0.05 m, the least joint time
            first [s]; NaN where planning was in vain.
        routing_time: Wall time from the loaded problem to the answer [s].
    """

    status: PlanStatus
    message: str
    place: Place
    problem: PlanningProblem | None = None
    planned: PlanResult | None = None
    durations: tuple[float, ...] = ()
    routing_time: float = 0.0

    @property
    def succeeded(self) -> bool:
        """Whether there is a tube with a certified motion."""
        return self.status is PlanStatus.SUCCESS

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        planned = {} if self.planned is None else self.planned.as_dict()
        compared = [None if np.isnan(duration) else duration for duration in self.durations]
        tube = None if self.problem is None else self.problem.tube
        return {
            **planned,
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "routing_time": self.routing_time,
            "compared_durations": compared,
            "points": None if tube is None else tube.points.tolist(),
            "radius": None if tube is None else tube.radius.tolist(),
        }


def find_route(
    problem: PlanningProblem,
    options: RouteOptions | None = None,
    progress: Callable[[object], None] | None = None,
) -> RouteResult:
    """Find a tube from a problem's start to its goal, and plan the motion through it.

    Args:
        problem: Start, goal and obstacles count; its tube does not, but for its last point where
            the goal is left open: there the hand is to go.
        options: How to find it.
        progress: Called with every stage as it begins.

    Raises:
        OptionError: OMPL is not installed.
        ProblemError: The start is given by a seed.
    """
    if isinstance(problem.start, Seed):
        raise ProblemError("start.joints is required: a seed belongs to the first point of a tube")
    begin = time.perf_counter()
    durations: list[float] = []
    found = planned = None
    try:
        finder = _RouteFinder(problem, options or RouteOptions(), progress, durations)
        found, planned = finder.best()
        status, place = PlanStatus.SUCCESS, Place()
        message = f"route of {len(found.tube.points)} reference points, {planned.message}"
    except Infeasible as reason:
        status, message, place = reason.status, str(reason), reason.place
    elapsed = time.perf_counter() - begin
    return RouteResult(status, message, place, found, planned, tuple(durations), elapsed)


class _RouteFinder:
    """The steps from a problem without a tube to one with the tube of its fastest route."""

    def __init__(
        self,
        problem: PlanningProblem,
        options: RouteOptions,
        progress: Callable[[object], None] | None,
        durations: list[float],
    ) -> None:
        self._problem, self._options = problem, options
        self._enter = progress or (lambda stage: None)
        self._durations = durations

    def best(self) -> tuple[PlanningProblem, PlanResult]:
        """Return the problem in its measured tube, and the motion through it.

        Raises:
            Infeasible: There is none; the reason is that of the fastest route.
        """
        problem, options = self._problem, self._options
        start = problem.start
        assert not isinstance(start, Seed)
        require_free(problem, "start", start)
        goals = goal_configurations(problem, start, options.seed)
        routes = route_candidates(problem, goals, options, self._enter)
        first = None
        for candidate in self._fastest_first(routes[:_MOST_COMPARED]):
            try:
                return self._measured(candidate)
            except Infeasible as reason:
                first = first or reason
        assert first is not None
        raise first

    def _fastest_first(self, routes: list[RouteCandidate]) -> list[RouteCandidate]:
        """Return routes in the order of the durations of their motions in equal tubes."""
        for k, route in enumerate(routes):
            self._enter(f"planning along route {k + 1} of {len(routes)}")
            compared = plan(self._in_tube(route, _RADIUS_TO_COMPARE), PlanOptions(quality="fast"))
            self._durations.append(np.nan if compared.duration is None else compared.duration)
        return [routes[k] for k in np.argsort(self._durations)]  # NaN comes last

    def _in_tube(self, route: RouteCandidate, radius: float) -> PlanningProblem:
        """Return the problem in the tube of a route, not measured yet."""
        robot, corners = self._problem.robot, route.corners
        tube = reference_tube(robot, corners.points, corners.lines, self._options.band, radius)
        return self._problem.with_tube(tube, route.goal)

    def _measured(self, route: RouteCandidate) -> tuple[PlanningProblem, PlanResult]:
        """Return the problem in the measured tube of a route, and its plan.

        Raises:
            Infeasible: The tube has no room, or there is no certified motion in it.
        """
        options = self._options
        how = MeasureOptions(options.max_radius, options.samples, options.seed)
        measured = measure_tube(self._in_tube(route, options.max_radius), how, self._enter)
        if measured.problem is None:
            raise Infeasible(measured.status, measured.message, measured.place)
        self._enter("planning through the measured tube")
        planned = plan(measured.problem)
        if not planned.succeeded:
            raise Infeasible(planned.status, planned.message, planned.place)
        return measured.problem, planned
