"""Straight lines in joint space between configurations at the reference points.

Refinement may start from them where no continuous branch follows the reference path, or where a
branch leads it to a motion that is not the fastest: the hand need not be in the tube yet.
"""

from itertools import pairwise

import numpy as np

from tubeplanner.inverse_kinematics import solve_position
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem import PlanningProblem
from tubeplanner.reference_branch import ReferenceBranch, end_configuration
from tubeplanner.reference_turn import wanted_at
from tubeplanner.segment_walk import as_position

_POINTS_PER_SEGMENT = 21
_GOAL_TOLERANCE = 1e-7  # [m] of the hand from an open goal


def joint_lines(problem: PlanningProblem) -> ReferenceBranch:
    """Return joint lines from the start over the reference points to the goal.

    Raises:
        Infeasible: Status unreachable: start or goal have no configuration.
    """
    start = end_configuration(problem, problem.start, 0)
    goal = None if problem.goal is None else end_configuration(problem, problem.goal, -1)
    count = problem.tube.segment_count
    corners = [start]
    for k in range(1, count + (goal is None)):
        near = corners[-1]
        if goal is not None:
            near = near + (goal - near) / (count + 1 - k)
        following = min(k, count - 1)
        lower = np.maximum(problem.joint_lower[k - 1], problem.joint_lower[following])
        upper = np.minimum(problem.joint_upper[k - 1], problem.joint_upper[following])
        point = problem.tube.points[k]
        turned = wanted_at(problem, point, k - 1, near)
        solution = solve_position(problem.robot, point, near, lower, upper, rotation=turned)
        if k == count and solution.error > _GOAL_TOLERANCE:
            message = f"no goal: the hand gets no nearer than {solution.error:.4g} m"
            place = Place(segment=k - 1, position=as_position(point))
            raise Infeasible(PlanStatus.UNREACHABLE, message, place)
        corners.append(solution.q)
    if goal is not None:
        corners.append(goal)
    share = np.linspace(0, 1, _POINTS_PER_SEGMENT)[:, None]
    return ReferenceBranch(tuple(a + share * (b - a) for a, b in pairwise(corners)))
