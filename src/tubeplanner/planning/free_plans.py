"""Plans where the tool may be anywhere: routes that a search finds from start and goal alone."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.refusal import require_free
from tubeplanner.first_guess.branches import end_configuration, least_time
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.first_guess.pose_configurations import spread_seeds
from tubeplanner.first_guess.segment_walk import wanted_at
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.outcome import (
    MARGIN_TOLERANCE,
    Infeasible,
    Location,
    PlanningClock,
    PlanStatus,
    until_stopped,
)
from tubeplanner.planning.options import STOP_AT_CORNERS, PlanOptions
from tubeplanner.planning.result import PlanResult, refused_result
from tubeplanner.planning.route_plans import EDGES, MAX_ROUTES, SEED, RoutePlans, with_route
from tubeplanner.task.problem import PlanningProblem

_MAX_ROUTES_EACH = 2  # to each of several configurations of an open goal but the first


def free_plan(problem: PlanningProblem, options: PlanOptions, clock: PlanningClock) -> PlanResult:
    """Return the fastest plan along some routes; after Ctrl-C or the time limit, so far.

    First the straight line in joint space is refined. Where it is not nearly as fast as the lower
    bound, routes are searched for. Of an open goal, some configurations are tried, by their bounds.
    """
    plans, stops = RoutePlans(options, clock), options.method == STOP_AT_CORNERS

    def search(begun: PlanningProblem, goals: FloatArray, count: int) -> None:
        plans.search(begun, goals, 1 if stops else count, seed=SEED, edges=EDGES)

    def work() -> None:
        start = end_configuration(problem, problem.endpoints[0], 0)
        begun = replace(problem, start=start)
        goals = _goals(begun, start)
        for k, goal in enumerate(goals):
            line = with_route(begun, np.array([start, goal]))
            least = lower_bound(line).duration
            if plans.are_enough(least):
                return
            if not stops:
                plans.refine_line(line)
            if len(goals) > 1 and plans.best is None:
                search(begun, goals, 1)  # to any: some may have no route
            if not plans.are_enough(least):
                search(begun, goal[None], _MAX_ROUTES_EACH if k else MAX_ROUTES)

    try:
        _, stopped_by = until_stopped(work)
    except Infeasible as reason:
        return plans.best or refused_result(reason, options.method)
    return plans.result(stopped_by)


# ---- Configurations of the goal.

_MAX_GOALS = 8
_SAME = 0.1  # [rad or m] of every joint


def _goals(problem: PlanningProblem, start: FloatArray) -> FloatArray:
    """Return configurations (G, n) of the goal, of an open goal some free ones by their bounds.

    Raises:
        Infeasible: The tool does not reach the goal, or no configuration is free.
    """
    region = problem.open_goal
    if region is None:
        return end_configuration(problem, problem.endpoints[1], -1)[None]
    distinct: list[FloatArray] = []
    for q in reaching(problem, start, problem.joint_lower[-1], problem.joint_upper[-1]):
        if all(abs(q - other).max() > _SAME for other in distinct):
            distinct.append(q)
    if not distinct:
        message = "no configuration was found with the tool at the goal; move it nearer"
        raise Infeasible(PlanStatus.UNREACHABLE, message, Location().at(region.position))
    # Of those with the same bound the nearest comes first.
    distinct.sort(key=lambda q: (least_time(replace(problem, goal=q)), float(abs(q - start).max())))
    free: list[FloatArray] = []
    blocked: Infeasible | None = None
    for q in distinct:
        try:
            require_free(replace(problem, goal=q), "goal", q)
            free.append(q)
        except Infeasible as reason:
            blocked = blocked or reason
    if blocked is not None and not free:
        raise blocked
    return np.array(free[:_MAX_GOALS])


def reaching(
    problem: PlanningProblem, near: FloatArray, lower: FloatArray, upper: FloatArray
) -> Iterator[FloatArray]:
    """Yield configurations (n,) within bounds with the tool at an open goal."""
    goal, rotation = problem.open_goal, problem.rotation
    assert goal is not None
    last = problem.tube.segment_count - 1 + goal.bounds_rotation
    for seed in [near, *spread_seeds(lower, upper)]:
        target = wanted_at(problem, goal.position, last, seed)
        solution = solve_position(problem.robot, goal.position, seed, lower, upper, rotation=target)
        if solution.error > MARGIN_TOLERANCE / 2:
            continue
        if rotation is not None:
            matrix, tool = problem.robot.tool_pose(solution.q[None])
            if rotation.margin(matrix, tool, last)[0] < 0:
                continue
        yield solution.q
