"""Plans where the tool may be anywhere: routes that a search finds from start and goal alone."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import require_free
from tubeplanner.first_guess.branches import end_configuration
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.first_guess.pose_configurations import pose_configurations, reaching
from tubeplanner.first_guess.segment_walk import wanted_at
from tubeplanner.first_guess.upright import kept_upright
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.outcome import (
    MARGIN_TOLERANCE,
    Infeasible,
    Location,
    PlanningClock,
    PlanStatus,
    until_stopped,
)
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult, refused_result
from tubeplanner.planning.route_plans import EDGES, MAX_ROUTES, SEED, RoutePlans, with_route
from tubeplanner.task.holding import loss_at_rest
from tubeplanner.task.problem import PlanningProblem

# Routes to each of several goals but the first, and in all.
_MAX_ROUTES_EACH, _MAX_ROUTES_IN_ALL = 2, 8


def free_plan(problem: PlanningProblem, options: PlanOptions, clock: PlanningClock) -> PlanResult:
    """Return the fastest plan that `search_plans` finds; after Ctrl-C or the time limit, so far."""
    plans = RoutePlans(options, clock)

    def work() -> None:
        start = end_configuration(problem, problem.endpoints[0], 0)
        begun = replace(problem, start=start)
        require_free(begun, "start", start, is_given=problem.endpoints[0].joints is not None)
        goals = goal_configurations(begun, start, SEED)
        for _ in search_plans(plans, begun, goals, SEED, EDGES):
            clock.check()

    try:
        _, stopped_by = until_stopped(work)
    except Infeasible as reason:
        return plans.best or refused_result(reason, options.method)
    return plans.result(stopped_by)


def search_plans(
    plans: RoutePlans, problem: PlanningProblem, goals: FloatArray, seed: int, edges: int
) -> Iterator[None]:
    """Plan from a start configuration to goals (G, n), by their bounds; yield before each search.

    An arm that may end where it begins rests. Else the straight line in joint space is refined.
    Where it is not nearly as fast as the lower bound, routes are searched for. The seed and the
    number of edges are those of all searches.

    Raises:
        Infeasible: Status no_trajectory: no route was found.
        TimeLimitReached: Before the end; likewise KeyboardInterrupt.
    """
    start = problem.endpoints[0].joints
    assert start is not None
    if plans.rest(with_route(problem, np.array([start, goals[0]]))):
        return
    for k, goal in enumerate(goals):
        line = with_route(problem, np.array([start, goal]))
        least = lower_bound(line).duration
        is_last = plans.routes >= _MAX_ROUTES_IN_ALL and plans.best is not None
        if is_last or plans.are_enough(least):
            return
        plans.refine_line(line)
        yield
        if k == 0 and len(goals) > 1 and plans.best is None:  # some may have no route
            plans.search(problem, goals, 1, seed=seed, edges=edges)
        if not plans.are_enough(least):
            count = _MAX_ROUTES_EACH if k else MAX_ROUTES
            plans.search(problem, goal[None], count, seed=seed, edges=edges)


# ---- Configurations in which the motion may end: the given one, or those of a tool position or a
# pose of the tool.

_DRAWS, _MORE_DRAWS = 100, 1000  # more where no configuration is free
_MAX_GOALS = 8
_DECIMALS = 9
_REACHED = MARGIN_TOLERANCE / 2  # [m]
_SAME = 0.1  # [rad or m] of every joint
_AROUND = np.pi  # [rad or m] about the start: where configurations are drawn


def goal_configurations(problem: PlanningProblem, start: FloatArray, seed: int) -> FloatArray:
    """Return free configurations (G, n) for the goal, by the lower bound on motions to each.

    Of the goal configuration, or where that is open of the tool's pose or position there, from many
    seeds.

    Raises:
        Infeasible: No configuration is free (status tube_blocked), or the tool does not reach the
            goal (status unreachable).
    """
    goal = problem.endpoints[1]
    if goal.joints is not None:
        require_free(problem, "goal", goal.joints)
        return goal.joints[None]
    try:
        return _free_by_bound(problem, start, _drawn(problem, start, seed, _DRAWS))
    except Infeasible:
        more = _drawn(problem, start, seed, _MORE_DRAWS)
    return _free_by_bound(problem, start, more)


def _free_by_bound(problem: PlanningProblem, start: FloatArray, seeds: FloatArray) -> FloatArray:
    """Return free configurations (G, n) of a goal's pose or position, from seeds (s, n)."""
    goal = problem.endpoints[1]
    if goal.pose is not None:
        solutions = list(pose_configurations(problem, goal.pose, -1))
        if goal.pose.seed is None:
            others = reaching(problem.robot, goal.pose, seeds, *_range(problem), seeds)
            solutions += [q for q in others if _is_new(q, solutions)]
    else:
        inner = kept_upright(problem, start) or problem
        solutions = _reaching(inner, seeds if goal.seed is None else goal.seed[None])
    lost = [loss_at_rest(problem.robot, problem.holding, q) for q in solutions]
    solutions = [q for q, reason in zip(solutions, lost, strict=True) if reason is None]
    if not solutions:
        tool = problem.tube.points[-1]
        raise Infeasible(PlanStatus.UNREACHABLE, f"goal: {lost[0]}", Location().at(tool))
    free: list[FloatArray] = []
    blocked = None
    by_bound = sorted(
        (lower_bound(replace(problem, goal=q)).duration, float(abs(q - start).max()), k)
        for k, q in enumerate(solutions)
    )
    for *_, k in by_bound:
        try:
            if len(free) < _MAX_GOALS:
                require_free(problem, "goal", solutions[k])
                free.append(solutions[k])
        except Infeasible as reason:
            blocked = blocked or reason
    if not free and blocked is not None:
        raise blocked
    return np.array(free)


def _reaching(problem: PlanningProblem, seeds: FloatArray) -> list[FloatArray]:
    """Return different configurations (n,) with the tool at a goal's position, from seeds (s, n).

    Raises:
        Infeasible: Status unreachable: there is none.
    """
    goal, rotation = problem.endpoints[1], problem.rotation
    target, last = problem.tube.points[-1], problem.tube.segment_count - 1
    if goal.region is not None:
        target, last = goal.region.position, last + goal.region.bounds_rotation
    solutions: list[FloatArray] = []
    least = np.inf
    for near in seeds:
        wanted = wanted_at(problem, target, last, None if problem.holding else near)
        solution = solve_position(problem.robot, target, near, *_range(problem), rotation=wanted)
        least = min(least, solution.error)
        if rotation is not None:
            matrix, tool = problem.robot.tool_pose(solution.q[None])
            if rotation.margin(matrix, tool, last)[0] < 0:
                continue
        if solution.error <= _REACHED and _is_new(solution.q, solutions):
            solutions.append(np.round(solution.q, _DECIMALS))
    if not solutions:
        message = (
            f"no configuration was found for the goal: the tool stops {least:.4g} m short, from "
            f"{len(seeds)} starts; move the goal nearer"
        )
        raise Infeasible(PlanStatus.UNREACHABLE, message, Location().at(target))
    return solutions


def _range(problem: PlanningProblem) -> tuple[FloatArray, FloatArray]:
    return problem.robot.limits.lower_position, problem.robot.limits.upper_position


def _drawn(problem: PlanningProblem, start: FloatArray, seed: int, count: int) -> FloatArray:
    """Return the start (n,) and a number of random configurations about it."""
    lower, upper = _range(problem)
    low, high = np.maximum(lower, start - _AROUND), np.minimum(upper, start + _AROUND)
    drawn = np.random.default_rng(seed).uniform(low, high, (count, len(start)))
    return np.vstack([start, drawn])


def _is_new(q: FloatArray, others: Sequence[FloatArray]) -> bool:
    return all(abs(q - other).max() > _SAME for other in others)
