"""How much of the time that a motion may take is of use to its objective."""

import numpy as np

from tubeplanner.constraints.effort_costs import EffortCosts
from tubeplanner.problem.objective import ENERGY, SMOOTHNESS, Objective
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_TRIED = 50


def cheapest_duration(problem: PlanningProblem, shortest: JointTrajectory, longest: float) -> float:
    """Return in which duration the shortest motion, run slower, costs least [s].

    Slower motions take less to be accelerated, but are held against gravity for longer.

    Args:
        problem: The planning problem, whose objective says what counts.
        shortest: Its shortest motion.
        longest: How long it may take [s].

    Returns:
        One of 50 evenly spaced durations; the longest for smoothness.
    """
    objective = problem.objective or Objective()
    if objective.minimise == SMOOTHNESS:
        return longest
    costs = EffortCosts(problem.robot, shortest)
    tried = np.linspace(shortest.duration, longest, _TRIED).tolist()
    if objective.minimise == ENERGY:
        weights = objective.energy_weights(problem.robot)
        return float(min(reversed(tried), key=lambda duration: costs.energy(weights, duration)))
    return float(min(reversed(tried), key=costs.work))
