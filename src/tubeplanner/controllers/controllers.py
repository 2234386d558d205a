"""The controllers that `check --for` knows."""

from tubeplanner.controllers.controller_verdict import ControllerVerdict
from tubeplanner.controllers.franka_control import judged_by_franka
from tubeplanner.controllers.franka_limits import FRANKA_ARMS, franka_limits
from tubeplanner.controllers.joint_trajectory_controller import judged_by_jtc
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.trajectory_file import TrajectoryFile

_JTC = "jtc"
CONTROLLERS = (*FRANKA_ARMS, _JTC)


def judged_by(name: str, problem: PlanningProblem, file: TrajectoryFile) -> ControllerVerdict:
    """Return what a controller makes of a trajectory file.

    Args:
        name: One of `CONTROLLERS`.
        problem: The planning problem.
        file: The trajectory.

    Raises:
        OptionError: There is no such controller, or it is for another arm.
        TrajectoryError: The trajectory moves other joints.
    """
    if name not in CONTROLLERS:
        raise OptionError(f"--for: {unknown_name('controller', name, CONTROLLERS)}")
    if name == _JTC:
        return judged_by_jtc(name, problem, file)
    return judged_by_franka(name, problem.robot, file.trajectory, franka_limits(name))
