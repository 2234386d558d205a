"""A note on what the second stage has gained."""

import numpy as np

from tubeplanner.constraints.effort_costs import EffortCosts
from tubeplanner.constraints.effort_variation import effort_variation
from tubeplanner.planning.jerk_note import largest_jerk
from tubeplanner.problem.objective import ENERGY, SMOOTHNESS, Objective
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


def gain_note(problem: PlanningProblem, before: JointTrajectory, after: JointTrajectory) -> str:
    """Return what the second stage has gained, as the problem's objective counts it.

    Args:
        problem: The planning problem.
        before: The shortest motion.
        after: What the second stage has made of it.
    """
    objective = problem.objective or Objective()
    longer = 100 * (after.duration / before.duration - 1)
    if objective.minimise == SMOOTHNESS:
        done = "smoothed"
        gained = _smoothness_gained(problem.robot, before, after)
    else:
        done = f"{objective.minimise} saved"
        gained = _saved(problem.robot, objective, before, after)
    return (
        f"{done}: the shortest motion takes {before.duration:.4f} s; in {longer:.2f} % more time, "
        f"{gained}"
    )


def _saved(
    robot: RobotModel, objective: Objective, before: JointTrajectory, after: JointTrajectory
) -> str:
    """Return how much energy or work two motions take."""
    costs = [EffortCosts(robot, trajectory) for trajectory in (after, before)]
    if objective.minimise == ENERGY:
        weights = objective.energy_weights(robot)
        values = [cost.energy(weights) for cost in costs]
        unit = "with the given weights" if objective.weights else "limits^2 s"
        what = "integral of the squared efforts"
    else:
        values, unit, what = [cost.work() for cost in costs], "J", "work of the motors"
    return f"the {what} is {values[0]:.4g} instead of {values[1]:.4g} {unit}"


def _smoothness_gained(robot: RobotModel, before: JointTrajectory, after: JointTrajectory) -> str:
    """Return what smoothing has done, with the joints whose efforts swing most."""
    swings = [_largest_swing(robot, trajectory, before) for trajectory in (after, before)]
    jerks = [largest_jerk(robot, trajectory)[1] for trajectory in (after, before)]
    return (
        f"the effort that swings most moves through {swings[0]} instead of {swings[1]}, "
        f"and the largest jerk is {jerks[0]} instead of {jerks[1]}"
    )


def _largest_swing(
    robot: RobotModel, trajectory: JointTrajectory, shortest: JointTrajectory
) -> str:
    variation = effort_variation(robot, trajectory, shortest)
    joint = int(variation.argmax())
    is_limited = bool(np.isfinite(robot.limits.effort[joint]))
    unit = "limits" if is_limited else "times the largest effort of the shortest motion"
    return f"{variation[joint]:.1f} {unit} ('{robot.joint_names[joint]}')"
