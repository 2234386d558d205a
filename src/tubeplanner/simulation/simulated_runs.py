"""Trajectories executed by arms that are drawn at random, and judged."""

from collections.abc import Callable

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.execution import executed
from tubeplanner.simulation.judged_runs import JudgedRun, judged_runs
from tubeplanner.simulation.plant import Draw, drawn_plants
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


def simulated_runs(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    errors: Robustness,
    draw: Draw,
    checkpoint: Callable[[], None] = lambda: None,
) -> list[JudgedRun]:
    """Return what becomes of a trajectory in each run.

    Args:
        problem: The planning problem.
        trajectory: Of its joints, in any order.
        errors: Sizes of the errors, and the controller.
        draw: How many arms, and which.
        checkpoint: Called often; may raise to end the work.

    Raises:
        OptionError: MuJoCo is not installed.
        RobotError: Joints of the robot follow others.
        TrajectoryError: The trajectory moves other joints than the problem's.
    """
    plants = drawn_plants(problem.robot, errors, draw)
    controlled = (errors.controller, errors.control_period)
    execution = executed(problem, trajectory, plants, *controlled, checkpoint)
    return judged_runs(problem, trajectory, execution, checkpoint)
