"""Straight lines in joint space between configurations at the reference points.

Refinement may start from them where no continuous branch follows the reference path, or where a
branch leads it to a trajectory that is not the fastest. The tool may still be outside the tube.
"""

from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import PositionSolution, solve_position
from tubeplanner.branches.reference_branch import ReferenceBranch, end_configuration
from tubeplanner.branches.reference_turn import wanted_at
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.problem.problem import PlanningProblem

_POINTS_PER_SEGMENT = 21
_TURNED_OFF = 1e-6  # [rad]
_AROUND = 0.5  # [rad or m]: how far joints are moved to find another configuration
_GOAL_TOLERANCE = 1e-7  # [m] of the tool from an open goal


def joint_lines(problem: PlanningProblem) -> ReferenceBranch:
    """Return joint lines from the start over the reference points to the goal.

    Raises:
        Infeasible: Status unreachable: start or goal have no configuration.
    """
    start = end_configuration(problem, problem.start, 0)
    given = problem.given_goal
    goal = None if given is None else end_configuration(problem, given, -1)
    count = problem.tube.segment_count
    corners = [start]
    for k in range(1, count + (goal is None)):
        near = corners[-1]
        if goal is not None:
            near = near + (goal - near) / (count + 1 - k)
        corners.append(_corner(problem, k, near))
    if goal is not None:
        corners.append(goal)
    share = np.linspace(0, 1, _POINTS_PER_SEGMENT)[:, None]
    lines = tuple((1 - share) * a + share * b for a, b in pairwise(corners))
    return ReferenceBranch(lines)


def _corner(problem: PlanningProblem, k: int, near: FloatArray) -> FloatArray:
    """Return a configuration (n,) at reference point k, or at an open goal, near another one.

    Where that violates the rotation tolerance, it searches for others nearby.
    """
    segments = [k - 1, min(k, problem.tube.segment_count - 1)]
    lower, upper = (
        problem.joint_lower[segments].max(axis=0),
        problem.joint_upper[segments].min(axis=0),
    )
    goal = problem.open_goal if k == problem.tube.segment_count else None
    point = problem.tube.points[k] if goal is None else goal.position
    if goal is not None and goal.bounds_rotation:
        turned = wanted_at(problem, point, k)
    else:
        turned = wanted_at(problem, point, k - 1, near)

    def solution(seed: FloatArray) -> PositionSolution:
        return solve_position(problem.robot, point, seed, lower, upper, rotation=turned)

    best = solution(near)
    if best.rotation_error > _TURNED_OFF:
        steps = _AROUND * np.vstack([np.eye(len(near)), -np.eye(len(near))])
        found = [best, *(solution(near + step) for step in steps)]
        least = min(one.rotation_error for one in found) + _TURNED_OFF
        turned_best = [one for one in found if one.rotation_error <= least]
        best = min(turned_best, key=lambda one: float(abs(one.q - near).max()))
    if goal is not None and best.error > max(goal.tolerance, _GOAL_TOLERANCE):
        message = f"no goal: the tool was brought no nearer than {best.error:.4g} m"
        place = Place(segment=problem.tube.segment_number(k - 1, point)).at(point)
        raise Infeasible(PlanStatus.UNREACHABLE, message, place)
    return best.q
