"""How near to their ends joints come whose velocity limits fall towards these."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.velocity_by_position import VelocityByPositionLimit
from tubeplanner.problem.problem import PlanningProblem

# Where less than this share of the largest velocity is allowed, a fast motion has no business.
_WORTH_USING = 0.01


def approachable_range(problem: PlanningProblem) -> tuple[FloatArray, FloatArray]:
    """Return where joints may move at a speed worth having, and given ends: (n,) each [rad or m].

    Farther out lies what joints can leave but not enter. Infinite where there is no such limit.
    """
    count, limits = problem.robot.joint_count, problem.robot.limits
    bounds = np.tile([[-np.inf], [np.inf]], count)
    if not limits.velocity_by_position:
        return bounds[0], bounds[1]
    limit = VelocityByPositionLimit(limits)
    upper, lower = np.split(limit.edge(_WORTH_USING), 2)
    joints = limit.joints[: len(upper)]
    bounds[:, joints] = np.where(lower < upper, [lower, upper], bounds[:, joints])
    for end in (problem.start, problem.goal):
        if isinstance(end, np.ndarray):
            bounds = np.array([np.minimum(bounds[0], end), np.maximum(bounds[1], end)])
    return bounds[0], bounds[1]


def require_approachable(problem: PlanningProblem, start: FloatArray, goal: FloatArray) -> None:
    """Check that no joint must move to where it is allowed no velocity, from start to goal (n,).

    Raises:
        Infeasible: Status no_trajectory.
    """
    if not problem.robot.limits.velocity_by_position:
        return
    limit = VelocityByPositionLimit(problem.robot.limits)
    for column in limit.out_of_reach(start, goal).tolist():
        ends = (problem.start, problem.goal)
        proved = all(isinstance(end, np.ndarray) for end in ends)
        raise limit.refused(problem.robot, goal, column).replaced(proved=proved)
