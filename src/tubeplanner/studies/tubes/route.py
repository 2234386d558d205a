"""Find_route: a tube from start, goal and obstacles."""

from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import require_free
from tubeplanner.checks import checked_options, require_between, require_count
from tubeplanner.errors import ProblemError
from tubeplanner.first_guess.branches import configured_ends
from tubeplanner.first_guess.inverse_kinematics import solve_position
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
from tubeplanner.studies.tubes.planned_tube import (
    PlannedTube,
    TubeAnswer,
    answer_of,
    followed,
    in_tube,
    measure_options,
    measured_plan,
    plan_under,
)
from tubeplanner.studies.tubes.routes import (
    ToolCorners,
    tool_corners,
)
from tubeplanner.studies.tubes.segment_measurement import samples_of
from tubeplanner.task.problem import PlanningProblem

# ---- A tube from start, goal and obstacles alone: the question that Suh & Bishop 1988 left open.
#
# Routes are found at random; the tool's path along each becomes few reference points. The most
# promising routes are planned in tubes of equal radius, and the fastest is the answer; a tube in
# which nothing collides is measured around it.

# Routes are compared by the trajectory through a tube of this radius [m].
_RADIUS_TO_COMPARE = 0.05
_MAX_COMPARED = 3
_COMPARING_FRACTION = 0.6  # of a time limit, after which no more routes are compared
_MAX_MEASURED = 2  # where the tube around the fastest route is blocked, the next is measured
_STEPS = 4  # routes, their comparison, the plan, the measured tube


@dataclass(frozen=True)
class RouteOptions:
    """How to find a route.

    Attributes:
        seed: Of all random numbers, >= 1; the same seed gives the same answer.
        edges: Number of straight edges between configurations that the search tests at most.
        band: Width by which joints may leave the route's ranges, before measuring [rad or m].
        max_radius: Largest radius of a segment [m].
        samples: Number of configurations of a segment in the last counterexample search.
        time_limit: Wall time after which the search ends with the best it has [s]; None: never.
    """

    seed: int = 1
    edges: int = 300_000
    band: float = 0.4
    max_radius: float = 0.2
    samples: int = 2_000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        require_count(self, 1, "seed", "edges", "samples")
        require_between(self, 0, np.inf, "band")
        require_between(self, 0, np.inf, "max_radius", unit="m")
        if self.time_limit is not None:
            require_between(self, 0, None, "time_limit", unit="s")


@dataclass(frozen=True, eq=False)
class RouteCandidate:
    """A route whose tool goes straight between few reference points."""

    space: FreeSpace  # the free configurations
    corners: ToolCorners  # reference points, and configurations between
    joint_time: float  # least time of joints at their velocity limits, else 1 rad/s or 1 m/s [s]


def find_route(
    problem: PlanningProblem,
    options: RouteOptions | None = None,
    progress: ProgressCallback | None = None,
) -> TubeAnswer:
    """Find a tube from a problem's start to its goal, and plan the trajectory.

    Args:
        problem: Start, goal and obstacles count. The tube does not, but for its last point, which
            is the goal where the goal is left open.
        options: How to find the tube.
        progress: Called as each stage begins, with the duration of the best trajectory so far.

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
    # The tube that is found is one of many: the bound is that of all motions from start to goal.
    bound = lower_bound(problem.with_tube(Tube.anywhere(*problem.tube.points[[0, -1]])))
    try:
        problem, notes = configured_ends(problem)
    except Infeasible as reason:
        return answer_of(reason)
    start = problem.endpoints[0].joints
    assert start is not None
    finder = _RouteFinder(problem, options, progress, notes)
    try:
        _, stopped_by = until_stopped(lambda: finder.search(start))
    except Infeasible as reason:
        return answer_of(reason, **finder.facts)
    if finder.best is not None:
        answer: PlannedTube | Infeasible = finder.best
        if stopped_by is None:
            answer = followed(finder.best, finder.clock)
        else:
            finder.notes.append(
                f"the search was stopped by {stopped_by.replace('_', ' ')} in step {finder.step} "
                f"of {_STEPS}: there may be a faster tube"
            )
        if isinstance(answer, PlannedTube):
            answer = replace(answer, result=replace(answer.result, bound=bound))
        return answer_of(answer, stopped_by=stopped_by, **finder.facts)
    if stopped_by == "interrupt":
        raise KeyboardInterrupt
    late = finder.clock.past_limit
    return TubeAnswer(
        PlanStatus.TIME_LIMIT, late, Location(), stopped_by=stopped_by, **finder.facts
    )


class _RouteFinder:
    """The steps from a problem to the tube of its fastest route.

    Attributes:
        clock: Of the whole search.
        best: The fastest certified trajectory so far, and its tube.
        measured: The measured tube, if any.
        step: Number of the current step, from 1.
        notes: On the search.
    """

    def __init__(
        self,
        problem: PlanningProblem,
        options: RouteOptions,
        progress: ProgressCallback | None,
        notes: tuple[str, ...],
    ) -> None:
        def announce(stage: Progress) -> None:
            assert progress is not None
            best = None if self.best is None else self.best.duration
            whole = f"step {self.step} of {_STEPS}, {stage.stage}"
            progress(replace(stage, stage=whole, best_duration=best))

        self._problem, self._options = problem, options
        self.clock = PlanningClock(options.time_limit, None if progress is None else announce)
        self.best: PlannedTube | None = None
        self.measured: PlannedTube | None = None
        self.step = 1
        self._durations: list[float | None] = []
        self.notes = list(notes)

    @property
    def facts(self) -> dict[str, Any]:
        """Fields of an answer beside its tube."""
        return {
            "measured": self.measured,
            "notes": tuple(self.notes),
            "compared": tuple(self._durations),
            "search_time": self.clock.elapsed,
        }

    def search(self, start: FloatArray) -> None:
        """Find the fastest trajectory, then the measured tube.

        Raises:
            Infeasible: There is no trajectory; the reason is that of the most promising route.
            TimeLimitReached: Before the end.
            KeyboardInterrupt: Before the end.
        """
        require_free(self._problem, "start", start)
        goals = goal_configurations(self._problem, start, self._options.seed)
        routes = route_candidates(self._problem, start, goals, self._options, self.clock)
        routes = routes[:_MAX_COMPARED]
        self.step = 2
        fastest = self._fastest_first(routes)
        if not fastest:
            self.step = 4
            self.best = self.measured = self._measured([(route, None) for route in routes])
            return
        self.step = 3
        self.clock.enter("planning along the fastest route")
        first = fastest[0][1].problem
        self._offer(PlannedTube(first, plan_under(self.clock, first)))
        self.step = 4
        try:
            self.measured = self._measured(
                [(route, samples_of(planned.result)) for route, planned in fastest[:_MAX_MEASURED]]
            )
        except Infeasible as reason:
            self.notes.append(
                f"no tube could be measured in which nothing collides: {reason}; the trajectory "
                "itself is certified"
            )
        else:
            self._offer(self.measured)

    def _fastest_first(
        self, routes: list[RouteCandidate]
    ) -> list[tuple[RouteCandidate, PlannedTube]]:
        """Return the routes with a certified trajectory in equal tubes, by its duration."""
        compared: list[tuple[RouteCandidate, PlannedTube]] = []
        for k, route in enumerate(routes):
            if compared and self.clock.used > _COMPARING_FRACTION:
                break
            problem = in_tube(self._problem, route.corners, self._options.band, _RADIUS_TO_COMPARE)
            with self.clock.within(f"route {k + 1} of {len(routes)}"):
                self.clock.enter("planning along it")
                result = plan_under(self.clock, problem, "fast")
            self._durations.append(result.duration)
            if result.succeeded:
                planned = PlannedTube(problem, result)
                compared.append((route, planned))
                self._offer(planned)
        return sorted(compared, key=lambda each: each[1].duration)

    def _measured(self, routes: list[tuple[RouteCandidate, FloatArray | None]]) -> PlannedTube:
        """Return the measured tube of the first route that has the space and a trajectory.

        With each route comes its fast trajectory (N, n), whose needs decide, or None.

        Raises:
            Infeasible: There is none; the reason is that of the first route.
        """
        band = self._options.band
        how = measure_options(self._options.max_radius, self._options.samples, self._options.seed)
        reason = None
        for k, (route, guide) in enumerate(routes):
            parts = (self._problem, route.space, route.corners)
            try:
                with self.clock.within(f"route {k + 1} of at most {len(routes)}"):
                    return measured_plan(*parts, band, how, self.clock, guide)
            except Infeasible as why:
                reason = reason or why
        assert reason is not None
        raise reason

    def _offer(self, planned: PlannedTube) -> None:
        """Replace the best trajectory by a certified trajectory if that is faster."""
        if not planned.result.succeeded:
            return
        if self.best is None or planned.duration < self.best.duration:
            self.best = planned


# ---- Routes from start to goal: each search finds another.

_MAX_ROUTES = 6
# Distances beyond the clearance at which optimisation alone looks for a trajectory [m].
_MARGINS = (0.03, 0.01)
_FRACTION_OF_TIME = 0.3  # of a time limit, after which no more routes are searched if there is one


def route_candidates(
    problem: PlanningProblem,
    start: FloatArray,
    goals: FloatArray,
    options: RouteOptions,
    clock: PlanningClock,
) -> list[RouteCandidate]:
    """Return routes from a start (n,) to any of free goals (G, n), the least joint time first.

    Arm and obstacles of the problem count. A trajectory that optimisation alone finds counts as a
    route too.

    Raises:
        Infeasible: Status no_trajectory: no route was found.
        TimeLimitReached: The time limit passed before a route was found.
    """
    candidates: list[RouteCandidate] = []
    search = RouteSearch(problem, start, goals)
    space = FreeSpace(problem, 0.0, np.vstack([start, goals]))
    clock.enter("searching for routes")
    routes = search.routes(options.seed, options.edges, lambda: clock.remaining <= 0)
    for route in islice(routes, _MAX_ROUTES):
        candidates += _candidates(space, route)
        if candidates and clock.used > _FRACTION_OF_TIME:
            return sorted(candidates, key=lambda candidate: candidate.joint_time)
    if not candidates:
        clock.check()
        tool = problem.robot.tool_position(search.reached[None])[0]
        x, y, z = tool
        message = (
            f"no route was found by {search.edges} edges; the last search brought the tool to "
            f"[{x:.3f}, {y:.3f}, {z:.3f}] m: move what is in the way, choose another goal "
            "configuration, or give it more edges"
        )
        raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Location().at(tool))
    for margin in _MARGINS:
        clock.enter(f"a trajectory without a route, {1000 * margin:g} mm from obstacles")
        wider = replace(problem.farther_apart(margin), goal=goals[0])
        guide = _candidates(space, samples_of(plan_under(clock, wider, "fast")))
        candidates += guide
        if guide or clock.used > _FRACTION_OF_TIME:
            break
    return sorted(candidates, key=lambda candidate: candidate.joint_time)


def _candidates(space: FreeSpace, route: FloatArray | None) -> list[RouteCandidate]:
    corners = None if route is None else tool_corners(space, route)
    if corners is None:
        return []
    speed = space.robot.limits.velocity
    speed = np.where(np.isfinite(speed), speed, 1.0)
    steps = np.concatenate([abs(np.diff(q, axis=0)) / speed for q in corners.lines])
    return [RouteCandidate(space, corners, joint_time=float(steps.max(axis=1).sum()))]


# ---- Configurations in which the trajectory may end: the given one, or those of a tool position.

_DRAWS = 100
_MAX_GOALS = 8
_DECIMALS = 6
_REACHED = 1e-6  # [m]
_SAME = 0.1  # [rad or m] of every joint
_AROUND = np.pi  # [rad or m] about the start: where configurations are drawn


def goal_configurations(problem: PlanningProblem, start: FloatArray, seed: int) -> FloatArray:
    """Return free configurations (G, n) for the goal, nearest to the start (n,) first.

    Of the goal configuration, or where that is open of the tool position there, from random seeds.

    Raises:
        Infeasible: No configuration is free (status tube_blocked), or the tool does not reach the
            goal (status unreachable).
    """
    if (q := problem.endpoints[1].joints) is not None:
        require_free(problem, "goal", q)
        return q[None]
    limits, goal = problem.robot.limits, problem.endpoints[1]
    target = problem.tube.points[-1] if goal.region is None else goal.region.position
    if goal.seed is not None:
        seeds = goal.seed[None]
    else:
        low = np.maximum(limits.lower_position, start - _AROUND)
        high = np.minimum(limits.upper_position, start + _AROUND)
        drawn = np.random.default_rng(seed).uniform(low, high, (_DRAWS, len(start)))
        seeds = np.vstack([start, drawn])
    solutions: list[FloatArray] = []
    least = np.inf
    for near in seeds:
        solution = solve_position(
            problem.robot, target, near, limits.lower_position, limits.upper_position
        )
        least = min(least, solution.error)
        is_new = all(abs(solution.q - other).max() > _SAME for other in solutions)
        if solution.error <= _REACHED and is_new:
            solutions.append(np.round(solution.q, _DECIMALS))
    if not solutions:
        message = (
            f"no configuration was found for the goal: the tool stops {least:.4g} m short, from "
            f"{len(seeds)} starts; move the goal nearer"
        )
        raise Infeasible(PlanStatus.UNREACHABLE, message, Location().at(target))
    free, blocked = [], None
    for q in sorted(solutions, key=lambda q: float(abs(q - start).max())):
        try:
            require_free(problem, "goal", q)
            free.append(q)
        except Infeasible as reason:
            blocked = blocked or reason
    if not free and blocked is not None:
        raise blocked
    return np.array(free[:_MAX_GOALS])
