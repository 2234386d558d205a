"""The motion of a leg with the times at which its moves begin."""

import numpy as np

from tubeplanner.cycle.cycle_motion import LegMotion
from tubeplanner.cycle.leg import Leg
from tubeplanner.cycle_planning.leg_plan import LegPlan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.verification import judged_visits

_SAMPLES = 200


def leg_motion(leg: Leg, plan: LegPlan) -> LegMotion:
    """Return the motion of a leg's plan, which has one."""
    trajectory = plan.result.trajectory
    assert trajectory is not None
    begins = [_begin(plan.problem, trajectory, first) for first in leg.first_segments[1:]]
    return LegMotion(trajectory, tuple(begins))


def _begin(problem: PlanningProblem, trajectory: JointTrajectory, first: int) -> float:
    """Return when a segment begins, one of those that the problem's file has [s].

    Where segments on one line are joined: when the tool is nearest to its first point.
    """
    numbers = problem.joined.tube.numbers
    visits = judged_visits(problem, trajectory)
    k = int(np.searchsorted(numbers, first))
    if numbers[k] == first:
        return next(visit.begin for visit in visits if visit.segment >= k)
    inside = [visit for visit in visits if visit.segment == k - 1]
    times = np.linspace(inside[0].begin, inside[-1].end, _SAMPLES)
    tool = problem.robot.tool_position(trajectory.position(times))
    point = problem.tube.points[np.searchsorted(problem.tube.numbers, first)]
    return float(times[np.linalg.norm(tool - point, axis=1).argmin()])
