"""How much of the speed that the limits allow a trajectory does not use."""

import numpy as np

from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limits import largest_speeds, speed_limits
from tubeplanner.constraints.tube_membership import current_segments
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_SAMPLES = 1000


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
    known = np.stack([at.position, at.velocity, at.acceleration, trajectory.jerk(time)])
    samples = PathSamples(problem, known, lambda: current_segments(problem, trajectory, at))
    factor = largest_speeds(samples, speed_limits(problem))
    with np.errstate(divide="ignore"):
        return float(np.mean(1 - 1 / np.maximum(factor, 1.0)))
