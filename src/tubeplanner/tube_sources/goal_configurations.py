"""Configurations in which the trajectory may end: the given one, or those of a tool position."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.verification.refusal import require_free

_DRAWS = 100
_MAX_GOALS = 8
_DECIMALS = 6
_REACHED = 1e-6  # [m]
_SAME = 0.1  # [rad or m] of every joint
_AROUND = np.pi  # [rad or m]: how far from the start configurations are drawn


def goal_configurations(problem: PlanningProblem, start: FloatArray, seed: int) -> FloatArray:
    """Return free configurations (G, n) for the goal, the nearest to the start first.

    Args:
        problem: Its goal, or where that is open the tool position there.
        start: Shape (n,).
        seed: Of random numbers, where the goal is a tool position.

    Raises:
        Infeasible: None is free (status tube_blocked), or the tool does not reach the goal
            (status unreachable).
    """
    if isinstance(problem.goal, np.ndarray):
        require_free(problem, "goal", problem.goal)
        return problem.goal[None]
    free, blocked = [], None
    for q in _reaching(problem, start, seed):
        try:
            require_free(problem, "goal", q)
            free.append(q)
        except Infeasible as reason:
            blocked = blocked or reason
    if not free and blocked is not None:
        raise blocked
    return np.array(free[:_MAX_GOALS])


def _reaching(problem: PlanningProblem, start: FloatArray, seed: int) -> list[FloatArray]:
    """Return configurations that have the tool at the goal, the nearest to the start first.

    Raises:
        Infeasible: Status unreachable.
    """
    limits, region = problem.robot.limits, problem.open_goal
    target = problem.tube.points[-1] if region is None else region.position
    if isinstance(problem.goal, Seed):
        seeds = problem.goal.joints[None]
    else:
        low = np.maximum(limits.lower_position, start - _AROUND)
        high = np.minimum(limits.upper_position, start + _AROUND)
        drawn = np.random.default_rng(seed).uniform(low, high, (_DRAWS, len(start)))
        seeds = np.vstack([start, drawn])
    found: list[FloatArray] = []
    least = np.inf
    for near in seeds:
        solution = solve_position(
            problem.robot, target, near, limits.lower_position, limits.upper_position
        )
        least = min(least, solution.error)
        is_new = all(abs(solution.q - other).max() > _SAME for other in found)
        if solution.error <= _REACHED and is_new:
            found.append(np.round(solution.q, _DECIMALS))
    if not found:
        message = (
            f"no configuration was found for the goal: the tool was brought no nearer than "
            f"{least:.4g} m from {len(seeds)} starts"
        )
        raise Infeasible(PlanStatus.UNREACHABLE, message, Place().at(target))
    return sorted(found, key=lambda q: float(abs(q - start).max()))
