"""How much of the speed that the limits allow a trajectory does not use."""

import numpy as np

from tubeplanner.constraints.time_scaling import scaling_factor
from tubeplanner.constraints.tube_membership import current_segments
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_SAMPLES = 2000


def unused_speed(problem: PlanningProblem, trajectory: JointTrajectory) -> float:
    """Return the mean over time of 1 - 1/b(t), from 0 to 1.

    b(t) is how many times faster the limits, jerk included, would let the trajectory run at that
    instant (Suh & Bishop 1988, property 2). Where it is 1, some limit is fully used; the fastest
    trajectory of a tube uses one nearly everywhere.

    Args:
        problem: The planning problem.
        trajectory: Within its limits.
    """
    time = (np.arange(_SAMPLES) + 0.5) * trajectory.duration / _SAMPLES
    at = trajectory.at(time)
    known = (at.position, at.velocity, at.acceleration, trajectory.jerk(time))
    segment = current_segments(problem, at.position)
    factor = scaling_factor(problem, *known, segment=segment)
    with np.errstate(divide="ignore"):
        return float(np.mean(1 - 1 / np.maximum(factor, 1.0)))
