"""The configuration in which an arm is shown: a problem's start, or one that shows it well."""

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.reference_branch import end_configuration
from tubeplanner.outcome import Infeasible
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.robot.typical_configurations import typical_configurations


def shown_configuration(arm: RobotModel, problem: PlanningProblem | None) -> FloatArray:
    """Return a configuration (n,) in which to show an arm.

    Args:
        arm: The arm.
        problem: Whose start it is, if there is one, and its seed or pose leads there.
    """
    if problem is not None:
        try:
            return end_configuration(problem, problem.start, 0)
        except Infeasible:
            pass
    best: FloatArray = typical_configurations(arm)[0]
    return best
