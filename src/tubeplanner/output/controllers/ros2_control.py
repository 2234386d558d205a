"""Verdict of the JointTrajectoryController of ros2_control.

The controller refuses messages by its `validate_trajectory_msg`, with parameters at their defaults,
and joins points by polynomials of the degree that the given derivatives determine. It does not
check whether the arm can follow: limits are checked by the certificate.
"""

from collections.abc import Iterator

import numpy as np

from tubeplanner.output.controllers.verdict import ControllerFinding, ControllerVerdict, Effect
from tubeplanner.output.files.samples import samples_for_export
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import peak_magnitudes
from tubeplanner.trajectory.reader import GivenSamples, TrajectoryFile

_RATE = 500.0  # [Hz], as `plan --ros` writes
_MOVES = float(np.finfo(np.float32).eps)  # the controller's own bound
_AT_REST = 1e-3  # of the largest value: a smaller value at the start is rest
_FIELDS = {1: "velocities", 2: "accelerations"}
_JOINED = {1: "straight lines", 2: "cubics"}
_TITLE = "JointTrajectoryController of ros2_control, parameters at their defaults"


def judged_by_jtc(name: str, problem: PlanningProblem, file: TrajectoryFile) -> ControllerVerdict:
    """Return the controller's verdict on a file's points; on polynomials, on exported points.

    Args:
        name: One of `CONTROLLERS`.
        problem: The planning problem.
        file: Its trajectory has the problem's joints, in any order.
    """
    trajectory, points = file.trajectory.reordered(problem.robot.joint_names), file.samples
    remarks: list[ControllerFinding] = []
    if points is None:
        points = GivenSamples(0.0, ("position", "velocity", "acceleration"))
        note = samples_for_export(problem, trajectory, _RATE).note
        if note is not None:
            remarks.append(ControllerFinding(Effect.NOTED, "as plan --ros writes it", note))
    findings = (
        *_refused(problem.robot, trajectory, points),
        *_altered(problem.robot, trajectory, points),
        *remarks,
    )
    return ControllerVerdict(name, _TITLE, "refuse", findings)


def _refused(
    robot: RobotModel, trajectory: JointTrajectory, points: GivenSamples
) -> Iterator[ControllerFinding]:
    """Yield the refusals of `validate_trajectory_msg` for a readable file."""
    velocity = trajectory.velocity(trajectory.duration)
    joint = int(abs(velocity).argmax())
    if "velocity" in points.quantities and abs(velocity[joint]) > _MOVES:
        error = f"Velocity of last trajectory point of joint {robot.joint_names[joint]} is not zero"
        time = points.first_time + trajectory.duration
        yield _moving(robot, joint, 1, velocity[joint], Effect.REFUSED, error, time)
    if points.has_effort:
        error = (
            "Trajectories with effort fields are only supported for controllers using the 'effort' "
            "command interface"
        )
        yield ControllerFinding(Effect.REFUSED, error, "leave them out, as plan --ros does")


def _altered(
    robot: RobotModel, trajectory: JointTrajectory, points: GivenSamples
) -> Iterator[ControllerFinding]:
    """Yield the differences between the executed motion and the file's."""
    if points.first_time > 0:
        message = (
            "the controller adds a segment of its own, from where the arm is to the first point, "
            f"at t = {points.first_time:.4f} s"
        )
        time = points.first_time
        yield ControllerFinding(Effect.ALTERED, "no point at t = 0", message, time=time)
    for order, what in ((1, "velocity"), (2, "acceleration")):
        coefficients = trajectory.derivative_coefficients(order)
        start = coefficients[-1, 0]
        largest = peak_magnitudes(coefficients, trajectory.widths).value
        joint = int(abs(start).argmax())
        if what in points.quantities and abs(start[joint]) > _AT_REST * largest.max():
            error = f"the {what} jumps where it begins"
            time = points.first_time
            yield _moving(robot, joint, order, start[joint], Effect.ALTERED, error, time)
        if what not in points.quantities:
            error = f"points without {_FIELDS[order]} are joined by {_JOINED[order]}"
            message = f"the {what} jumps at every one; give positions, velocities and accelerations"
            yield ControllerFinding(Effect.ALTERED, error, message)
            return


def _moving(
    robot: RobotModel, joint: int, order: int, value: float, effect: Effect, error: str, time: float
) -> ControllerFinding:
    """Return the finding of a joint that is not at rest at the start or the end."""
    unit = ("rad" if robot.revolute[joint] else "m") + ("/s" if order == 1 else "/s^2")
    name = robot.joint_names[joint]
    message = f"{name} {value:.6g} {unit} at t = {time:.4f} s; it must be 0"
    return ControllerFinding(effect, error, message, name, float(value), 0.0, unit, time)
