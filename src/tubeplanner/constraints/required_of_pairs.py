"""How far apart pairs of solids must be along a trajectory, as the judge asks it."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.constraints.tube_membership import judged_segments
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import RequiredDistances
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


def required_of_pairs(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> FloatArray:
    """Return the distances that the pairs of `problem.collision` must keep, shape (K, P) [m].

    Of pairs that may be in contact then, -inf: they are allowed to touch.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in their order.
        time: Of K samples, increasing, shape (K,) [s]; after the end what holds there.
    """
    problem = problem.joined
    ends = trajectory.position(np.array([0.0, trajectory.duration]))
    required = RequiredDistances(problem, ends[0], ends[1])
    if required.is_constant:
        return np.tile(required.by_segment, (len(time), 1))
    segment = judged_segments(problem, trajectory, time)
    tool = problem.robot.tool_position(trajectory.position(np.minimum(time, trajectory.duration)))
    asked = required.at(segment, tool)
    for near in required.near_ends:
        asked[np.ix_(near.holds(segment, tool), near.pair)] = -np.inf
    return asked
