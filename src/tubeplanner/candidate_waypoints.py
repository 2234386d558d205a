"""The configurations that phase 1 may pass: equally spaced along the reference path."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.inverse_kinematics import solve_position
from tubeplanner.problem import PlanningProblem
from tubeplanner.reference_branch import ReferenceBranch

_STILL = 1e-9  # [m]: a hand that moves less stands still
# Where inverse kinematics goes farther from the branch than this, it left it [rad or m].
_FARTHEST_FROM_BRANCH = 0.1


def candidate_waypoints(
    problem: PlanningProblem, branch: ReferenceBranch, count: int
) -> FloatArray:
    """Return M configurations whose hands are equally spaced along the branch.

    Args:
        problem: What is asked.
        branch: The arm along the reference path.
        count: M >= 2.

    Returns:
        Shape (M, n) [rad or m]; the first is the start, the last the goal. Where the hand stands
        still throughout, they are equally spaced in joint space.
    """
    q = np.concatenate(branch.segments)
    segment = np.repeat(
        np.arange(len(branch.segments)), [len(segment) for segment in branch.segments]
    )
    hand = problem.robot.tool_position(q)
    way = _travelled(hand)
    if way[-1] < _STILL:
        way = _travelled(q)
    wanted = way[-1] * np.arange(1, count - 1) / (count - 1)
    before = np.searchsorted(way, wanted, side="right") - 1
    share = ((wanted - way[before]) / (way[before + 1] - way[before]))[:, None]
    targets = (1 - share) * hand[before] + share * hand[before + 1]
    near = (1 - share) * q[before] + share * q[before + 1]
    return np.vstack([branch.start, _solved(problem, targets, near, segment[before]), branch.goal])


def _travelled(points: FloatArray) -> FloatArray:
    """Return the length of the way to each of P points, shape (P,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _solved(
    problem: PlanningProblem, targets: FloatArray, near: FloatArray, segment: IntArray
) -> FloatArray:
    """Return configurations that have the hand at targets (P, 3), close to others, (P, n)."""
    solved = near.copy()
    for i, k in enumerate(segment):
        lower, upper = problem.joint_lower[k], problem.joint_upper[k]
        solution = solve_position(problem.robot, targets[i], near[i], lower, upper)
        if abs(solution.q - near[i]).max() <= _FARTHEST_FROM_BRANCH:
            solved[i] = solution.q
    return solved
