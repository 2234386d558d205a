"""A tube from start, goal and obstacles alone: the question that Suh & Bishop 1988 left open.

Routes are found at random; the tool's path along each becomes few reference points. The most
promising are planned, and the tube of the fastest is measured.
"""

import time
from collections.abc import Callable

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.planner import plan
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.tube_sources.goal_configurations import goal_configurations
from tubeplanner.tube_sources.joint_route import require_ompl
from tubeplanner.tube_sources.measured_plan import (
    MeasuredPlan,
    in_tube,
    measure_options,
    measured_plan,
)
from tubeplanner.tube_sources.route_candidates import (
    RouteCandidate,
    RouteOptions,
    route_candidates,
)
from tubeplanner.tube_sources.tube_answer import TubeAnswer, answer_of
from tubeplanner.verification.refusal import require_free

# Routes are compared by the trajectory through a tube of this radius [m].
_RADIUS_TO_COMPARE = 0.05
_MAX_COMPARED = 4
# A measured tube whose trajectory takes longer than this, times the fastest one compared, has been
# squeezed by an obstacle: the next route may be wider.
_ENOUGH = 1.3
_MAX_MEASURED = 2


def find_route(
    problem: PlanningProblem,
    options: RouteOptions | None = None,
    progress: Callable[[object], None] | None = None,
) -> TubeAnswer:
    """Find a tube from a problem's start to its goal, and plan the trajectory through it.

    Args:
        problem: Start, goal and obstacles count; its tube does not, but for its last point where
            the goal is left open: there the tool is to go.
        options: How to find it.
        progress: Called with every stage as it begins.

    Raises:
        OptionError: OMPL is not installed.
        ProblemError: The start is given by a seed.
    """
    start = problem.start
    if isinstance(start, Seed):
        raise ProblemError("start.joints is required: a seed belongs to the first point of a tube")
    require_ompl()
    begin = time.perf_counter()
    finder = _RouteFinder(problem, options or RouteOptions(), progress or (lambda stage: None))
    found: MeasuredPlan | Infeasible
    try:
        found = finder.fastest(start)
    except Infeasible as reason:
        found = reason
    elapsed = time.perf_counter() - begin
    return answer_of(found, compared=tuple(finder.durations), search_time=elapsed)


class _RouteFinder:
    """The steps from a problem without a tube to one with the tube of its fastest route."""

    def __init__(
        self, problem: PlanningProblem, options: RouteOptions, enter: Callable[[object], None]
    ) -> None:
        self._problem, self._options, self._enter = problem, options, enter
        self.durations: list[float | None] = []

    def fastest(self, start: FloatArray) -> MeasuredPlan:
        """Return the problem in the measured tube that has the fastest trajectory, and its plan.

        Raises:
            Infeasible: There is none; the reason is that of the route that promised most.
        """
        options = self._options
        require_free(self._problem, "start", start)
        goals = goal_configurations(self._problem, start, options.seed)
        routes = route_candidates(self._problem, start, goals, options, self._enter)
        best, first, measured = None, None, 0
        how = measure_options(options.max_radius, options.samples, options.seed)
        for route, enough in self._fastest_first(routes[:_MAX_COMPARED]):
            try:
                found = measured_plan(
                    self._problem, route.space, route.corners, options.band, how, self._enter
                )
            except Infeasible as reason:
                first = first or reason
                continue
            if best is None or found.duration < best.duration:
                best = found
            measured += 1
            if best.duration <= enough or measured == _MAX_MEASURED:
                break
        if best is None:
            assert first is not None
            raise first
        return best

    def _fastest_first(self, routes: list[RouteCandidate]) -> list[tuple[RouteCandidate, float]]:
        """Return routes by their durations in equal tubes, and what is fast enough."""
        for k, route in enumerate(routes):
            self._enter(f"planning along route {k + 1} of {len(routes)}")
            problem = in_tube(self._problem, route.corners, self._options.band, _RADIUS_TO_COMPARE)
            self.durations.append(plan(problem, PlanOptions(quality="fast")).duration)
        known = [float("inf") if one is None else one for one in self.durations]
        order = sorted(range(len(routes)), key=lambda k: known[k])
        return [(routes[k], _ENOUGH * min(known)) for k in order]
