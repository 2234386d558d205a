"""A tube from start, goal and obstacles alone: the question that Suh & Bishop 1988 left open.

Routes are found at random; the tool's path along each becomes few reference points. The most
promising are planned in tubes of equal radius, and the fastest is the answer; a tube in which
nothing collides is measured around it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tubeplanner.arguments import given_options
from tubeplanner.arrays import FloatArray
from tubeplanner.branches.configured_ends import configured_ends
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.progress import (
    PlanningClock,
    Progress,
    ProgressCallback,
    StoppedBy,
    require_callback,
    until_stopped,
)
from tubeplanner.tube_sources.goal_configurations import goal_configurations
from tubeplanner.tube_sources.joint_route import require_ompl
from tubeplanner.tube_sources.measured_plan import (
    PlannedTube,
    followed,
    in_tube,
    measure_options,
    measured_plan,
    plan_under,
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
_MAX_COMPARED = 3
_SHARE_OF_TIME = 0.6  # of a time limit: after that, no more routes are compared
# Where the tube around the fastest route is blocked, the next one's is measured.
_MAX_MEASURED = 2
_SAMPLES_PER_PIECE = 10
_STEPS = 4  # routes, their comparison, the plan, the measured tube


def find_route(
    problem: PlanningProblem,
    options: RouteOptions | None = None,
    progress: ProgressCallback | None = None,
) -> TubeAnswer:
    """Find a tube from a problem's start to its goal, and plan the trajectory through it.

    Args:
        problem: Start, goal and obstacles count; its tube does not, but for its last point where
            the goal is left open: there the tool is to go.
        options: How to find it.
        progress: Called as each stage begins, with the duration of the best trajectory so far.

    Raises:
        OptionError: OMPL is not installed, or an argument is of another kind.
        ProblemError: The problem is none, or its start is given by a seed.
        KeyboardInterrupt: Ctrl-C before anything was certified.
    """
    PlanningProblem.require(problem)
    options = given_options(options, RouteOptions)
    require_callback(progress)
    if isinstance(problem.start, Seed):
        raise ProblemError("start.joints is required: a seed belongs to the first point of a tube")
    require_ompl()
    try:
        problem, chosen = configured_ends(problem)
    except Infeasible as reason:
        return answer_of(reason)
    start = problem.start
    assert isinstance(start, np.ndarray)
    finder = _RouteFinder(problem, options, progress, chosen)
    try:
        _, stopped_by = until_stopped(lambda: finder.search(start))
    except Infeasible as reason:
        return answer_of(reason, **finder.facts)
    if finder.best is not None:
        if stopped_by is None:
            found = followed(finder.best, finder.clock)
        else:
            found = finder.best
            finder.note_stop(stopped_by)
        return answer_of(found, stopped_by=stopped_by, **finder.facts)
    if stopped_by == "interrupt":
        raise KeyboardInterrupt
    late = finder.clock.past_limit
    return TubeAnswer(PlanStatus.TIME_LIMIT, late, Place(), stopped_by=stopped_by, **finder.facts)


@dataclass(frozen=True, eq=False)
class _Compared:
    """A route whose trajectory through a tube of the common radius is certified."""

    route: RouteCandidate
    problem: PlanningProblem
    result: PlanResult

    @property
    def planned(self) -> PlannedTube:
        return PlannedTube(self.problem, self.result)

    @property
    def way(self) -> FloatArray:
        assert self.result.trajectory is not None
        return self.result.trajectory.per_piece(_SAMPLES_PER_PIECE).position


class _RouteFinder:
    """The steps from a problem without a tube to one with the tube of its fastest route.

    Attributes:
        clock: Of the whole search.
        best: The fastest trajectory that is certified so far, and its tube.
        measured: The measured tube, if there is one.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        options: RouteOptions,
        progress: ProgressCallback | None,
        notes: tuple[str, ...],
    ) -> None:
        self._problem, self._options = problem, options
        self.clock = PlanningClock(options.time_limit, self._shown(progress))
        self.best: PlannedTube | None = None
        self.measured: PlannedTube | None = None
        self._step = 1
        self._durations: list[float | None] = []
        self._notes = list(notes)

    @property
    def facts(self) -> dict[str, Any]:
        """What an answer tells beside its tube."""
        return {
            "measured": self.measured,
            "notes": tuple(self._notes),
            "compared": tuple(self._durations),
            "search_time": self.clock.elapsed,
        }

    def search(self, start: FloatArray) -> None:
        """Find the fastest trajectory, then the measured tube.

        Raises:
            Infeasible: There is none; the reason is that of the route that promised most.
            TimeLimitReached: Before the end; likewise KeyboardInterrupt.
        """
        require_free(self._problem, "start", start)
        goals = goal_configurations(self._problem, start, self._options.seed)
        routes = route_candidates(self._problem, start, goals, self._options, self.clock)
        routes = routes[:_MAX_COMPARED]
        self._step = 2
        fastest = self._fastest_first(routes)
        if not fastest:
            self._step = 4
            self.best = self.measured = self._measured_first(routes)
            return
        self._step = 3
        self.clock.enter("planning along the fastest route")
        first = fastest[0].problem
        self._offer(PlannedTube(first, plan_under(self.clock, first)))
        self._step = 4
        self._measure(fastest[:_MAX_MEASURED])

    def note_stop(self, stopped_by: StoppedBy) -> None:
        """Note that the search was ended early."""
        self._notes.append(
            f"the search was stopped by {stopped_by.replace('_', ' ')} in step {self._step} of "
            f"{_STEPS}: there may be a faster tube"
        )

    def _fastest_first(self, routes: list[RouteCandidate]) -> list[_Compared]:
        """Return the routes with a certified trajectory in equal tubes, by its duration."""
        found: list[_Compared] = []
        for k, route in enumerate(routes):
            if found and self.clock.used > _SHARE_OF_TIME:
                break
            problem = in_tube(self._problem, route.corners, self._options.band, _RADIUS_TO_COMPARE)
            with self.clock.within(f"route {k + 1} of {len(routes)}"):
                self.clock.enter("planning along it")
                result = plan_under(self.clock, problem, "fast")
            self._durations.append(result.duration)
            if result.succeeded:
                found.append(_Compared(route, problem, result))
                self._offer(found[-1].planned)
        return sorted(found, key=lambda each: each.planned.duration)

    def _measure(self, compared: list[_Compared]) -> None:
        """Measure a tube around the first of some routes that has the space."""
        reason = None
        for k, each in enumerate(compared):
            try:
                with self.clock.within(f"route {k + 1} of at most {len(compared)}"):
                    self.measured = self._measured(each.route, each.way)
            except Infeasible as why:
                reason = reason or why
                continue
            self._offer(self.measured)
            return
        self._notes.append(
            f"no tube could be measured in which nothing collides: {reason}; the trajectory itself "
            "is certified"
        )

    def _measured_first(self, routes: list[RouteCandidate]) -> PlannedTube:
        """Return the first measured tube that has a trajectory.

        Raises:
            Infeasible: There is none.
        """
        reason = None
        for k, route in enumerate(routes):
            try:
                with self.clock.within(f"route {k + 1} of at most {len(routes)}"):
                    return self._measured(route, None)
            except Infeasible as why:
                reason = reason or why
        assert reason is not None
        raise reason

    def _measured(self, route: RouteCandidate, way: FloatArray | None) -> PlannedTube:
        options = self._options
        how = measure_options(options.max_radius, options.samples, options.seed)
        return measured_plan(
            self._problem, route.space, route.corners, options.band, how, self.clock, way
        )

    def _offer(self, found: PlannedTube) -> None:
        """Keep a certified trajectory if it is the fastest so far."""
        if not found.result.succeeded:
            return
        if self.best is None or found.duration < self.best.duration:
            self.best = found

    def _shown(self, progress: ProgressCallback | None) -> Callable[[Progress], None] | None:
        """Return a callback that tells how far the whole search has come."""
        if progress is None:
            return None

        def show(stage: Progress) -> None:
            best = None if self.best is None else self.best.duration
            whole = f"step {self._step} of {_STEPS}, {stage.stage}"
            progress(replace(stage, stage=whole, best_duration=best))

        return show
