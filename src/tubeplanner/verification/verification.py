"""The independent judge: does a trajectory solve the problem?

It uses robot, tube, collision geometry and the trajectory's polynomials, and nothing of the code
that made the trajectory.
"""

from tubeplanner.arguments import given_options
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.certificate import Certificate
from tubeplanner.verification.conditions import JUDGED, SEGMENT_MARGINS
from tubeplanner.verification.judged_condition import Tolerance
from tubeplanner.verification.judged_motion import JudgedMotion
from tubeplanner.verification.other_speeds import OtherSpeeds
from tubeplanner.verification.tube_visits import Visit


def verify(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    tolerance: Tolerance | None = None,
) -> Certificate:
    """Judge a trajectory.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        tolerance: How far below zero margins may lie; default: 1e-6 m, rad and relative.

    Raises:
        ProblemError: The problem is none.
        TrajectoryError: The trajectory is none, or moves other joints than the problem's.
        OptionError: The tolerance is none.
    """
    PlanningProblem.require(problem)
    JointTrajectory.require(trajectory)
    tolerance = given_options(tolerance, Tolerance, "the tolerance is")
    trajectory = trajectory.reordered(problem.robot.joint_names)
    motion = JudgedMotion(problem.joined, trajectory, tolerance, SEGMENT_MARGINS)
    conditions = {name: judge(motion) for name, judge in JUDGED.items()}
    speeds = OtherSpeeds(problem.robot, trajectory, tolerance.relative)
    return Certificate(conditions, tolerance, problem.collision.left_out, speeds)


def judged_visits(problem: PlanningProblem, trajectory: JointTrajectory) -> list[Visit]:
    """Return when a trajectory is in which segment, as `verify` judges it.

    Args:
        problem: The planning problem; the segments are those of `PlanningProblem.joined`.
        trajectory: Of the problem's joints, in any order.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    return JudgedMotion(problem.joined, trajectory, Tolerance(), SEGMENT_MARGINS).visits
