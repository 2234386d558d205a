"""The configurations that phase 1 may pass: equally spaced along the reference path."""

from collections.abc import Callable

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.branches.reference_branch import ReferenceBranch
from tubeplanner.branches.reference_turn import wanted_at
from tubeplanner.polyline import arc_lengths
from tubeplanner.problem.problem import PlanningProblem

_STILL = 1e-9  # [m]: a tool that moves less stands still
# Inverse kinematics that goes farther from the branch than this has left it [rad or m].
_MAX_BRANCH_DISTANCE = 0.1


def candidate_waypoints(
    problem: PlanningProblem,
    branch: ReferenceBranch,
    count: int,
    checkpoint: Callable[[], None] = lambda: None,
) -> FloatArray:
    """Return M configurations whose tools are equally spaced along the branch.

    Args:
        problem: The planning problem.
        branch: The arm along the reference path.
        count: M >= 2.
        checkpoint: Called before each; it may raise to end the work.

    Returns:
        Shape (M, n) [rad or m]; the first is the start, the last the goal. Where the tool stands
        still throughout, they are equally spaced in joint space.
    """
    q = np.concatenate(branch.segments)
    segment = np.repeat(
        np.arange(len(branch.segments)), [len(segment) for segment in branch.segments]
    )
    tool = problem.robot.tool_position(q)
    arc_length = arc_lengths(tool)
    if arc_length[-1] < _STILL:
        arc_length = arc_lengths(q)
    wanted = arc_length[-1] * np.arange(1, count - 1) / (count - 1)
    before = np.searchsorted(arc_length, wanted, side="right") - 1
    share = ((wanted - arc_length[before]) / (arc_length[before + 1] - arc_length[before]))[:, None]
    targets = (1 - share) * tool[before] + share * tool[before + 1]
    near = (1 - share) * q[before] + share * q[before + 1]
    inner = near.copy()
    for i, k in enumerate(segment[before]):
        checkpoint()
        inner[i] = _solved(problem, targets[i], near[i], int(k))
    return np.vstack([branch.start, inner, branch.goal])


def _solved(
    problem: PlanningProblem, target: FloatArray, near: FloatArray, segment: int
) -> FloatArray:
    """Return a configuration (n,) that has the tool at a target (3,), close to another."""
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    turned = wanted_at(problem, target, segment, near)
    solution = solve_position(problem.robot, target, near, lower, upper, rotation=turned)
    return solution.q if abs(solution.q - near).max() <= _MAX_BRANCH_DISTANCE else near
