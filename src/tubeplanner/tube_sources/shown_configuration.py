"""The configuration in which an arm is shown: a problem's start, or one that shows it well."""

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.problem.problem import PlanningProblem, Seed
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.robot.typical_configurations import typical_configurations


def shown_configuration(arm: RobotModel, problem: PlanningProblem | None) -> FloatArray:
    """Return a configuration (n,) in which to show an arm.

    Args:
        arm: The arm.
        problem: Whose start it is, if there is one; of a seed the nearest that inverse kinematics
            gets to the first point of the tube.
    """
    if problem is None:
        best: FloatArray = typical_configurations(arm)[0]
        return best
    if not isinstance(problem.start, Seed):
        return problem.start
    lower, upper = problem.joint_lower[0], problem.joint_upper[0]
    return solve_position(arm, problem.tube.points[0], problem.start.joints, lower, upper).q
