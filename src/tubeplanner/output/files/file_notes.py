"""Notes on trajectory files: other problem, other robot, verdict, likely mistakes."""

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.certificate.judged_motion import FOREIGN_TOLERANCE, Tolerance
from tubeplanner.certificate.verification import Certificate, CycleCertificate, verify_motion
from tubeplanner.errors import TrajectoryError, shown
from tubeplanner.output.files.fingerprint import CARRIED, differing_parts, robot_hash, task_hash
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.pinocchio_model import locked_value
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import Motion, Task, motion_of_file
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.reader import TrajectoryFile

_NEAR = 1e-2  # [rad or m]: starts this near count as equal
_NEAR_LOCKED = 1e-3  # [rad or m]
_UNITS = {1e3: "milliseconds", 1e6: "microseconds"}  # in a second
_USUAL_STEPS = 5e-4, 0.1  # [s]: between the samples of recorders and controllers
_MAX_USE = 2.0  # of the speed limits, in the unit of the guess
_TURN = 2 * np.pi
_COLUMNS_SHOWN = 20


def notes_on_file(task: Task, file: TrajectoryFile, *, failed: bool = False) -> list[str]:
    """Return notes on interpolation, origin and likely mistakes; more if the certificate failed.

    The file has the joints of the task, in any order.
    """
    if isinstance(task, Cycle):  # files of cycles are ours
        return _notes_on_origin(task, file)
    notes = []
    if file.interpolation is not None:
        notes.append(f"samples are joined by {file.interpolation}")
    if file.ignored:
        more = len(file.ignored) - _COLUMNS_SHOWN
        columns = ", ".join(map(shown, file.ignored[:_COLUMNS_SHOWN]))
        columns += f" and {more} more" if more > 0 else ""
        notes.append(f"columns that are not read: {columns}")
    notes += [*file.remarks, *_notes_on_still_joints(task.robot, file.still)]
    notes += [*_notes_on_origin(task, file), *unit_guesses(task, file)]
    misreading = _likely_misreading(task, file.trajectory) if failed else None
    return notes if misreading is None else [*notes, misreading]


def _notes_on_still_joints(robot: RobotModel, still: Mapping[str, float]) -> Iterator[str]:
    """Yield notes on joints of a file that are not planned, with their values [rad or m]."""
    if still:
        values = ", ".join(f"{shown(name)} at {value:.6g}" for name, value in still.items())
        yield f"joints that stand still and are not planned: {values}"
    for name in still.keys() & robot.urdf.joints.keys():
        value = locked_value(robot.urdf, name, robot.joint_names, robot.locked_joints)
        if not abs(still[name] - value) <= _NEAR_LOCKED:
            yield (
                f"'{name}' stands at {still[name]:.6g} rad or m in the file, at {value:.6g} in the "
                "problem, for which it is judged; give it in robot.locked_joints"
            )


def unit_guesses(problem: PlanningProblem, file: TrajectoryFile) -> list[str]:
    """Return questions on units in which a file makes sense for the problem."""
    robot, guesses = problem.robot, []
    motion = file.trajectory.reordered(robot.joint_names)
    q = motion.position(motion.breakpoints)
    radians = np.where(robot.revolute, np.radians(q), q)
    if _fits(problem, radians) > _fits(problem, q):
        guesses.append("degrees? its positions fit the problem when divided by 57.3; give radians")
        q = radians
    step = np.diff(motion.breakpoints)
    use = float((abs(np.diff(q, axis=0)) / step[:, None] / robot.limits.velocity).max())
    for factor, unit in _UNITS.items():
        between, (shortest, longest) = float(np.median(step)), _USUAL_STEPS
        is_usual = shortest <= between / factor <= longest and 0 < use * factor <= _MAX_USE
        if file.samples is not None and is_usual:
            guesses.append(
                f"{unit}? its samples are {between:.3g} s apart, and its joints reach "
                f"{100 * use:.2g} % of their speed limits; give seconds"
            )
    return guesses


def _fits(problem: PlanningProblem, q: FloatArray) -> tuple[bool, bool]:
    """Return True if positions (N, n) begin at the start, and if they are in limits or one turn."""
    robot, start = problem.robot, problem.endpoints[0].joints
    limits, tube = robot.limits, problem.tube
    if start is None:
        distance = np.linalg.norm(robot.tool_position(q[0]) - tube.points[0])
        begins = bool(distance <= tube.radius[0] + _NEAR)
    else:
        begins = np.allclose(q[0], start, atol=_NEAR)
    inside = (q >= limits.lower_position - _NEAR) & (q <= limits.upper_position + _NEAR)
    return begins, bool((inside | (abs(q) <= _TURN)).all())


def _notes_on_origin(task: Task, file: TrajectoryFile) -> list[str]:
    """Return a note if a trajectory was made for another task; none if the file does not say."""
    is_other_robot = file.robot_hash not in (None, robot_hash(task.robot))
    if not is_other_robot and file.problem_hash in (None, task_hash(task)):
        return []
    noun = "cycle" if isinstance(task, Cycle) else "problem"
    if parts := ", ".join(differing_parts(task, file.part_hashes)):
        return [f"the trajectory was made for another {noun}; what differs: {parts}"]
    if is_other_robot:
        return ["the trajectory was made for another robot, payload, limits or motors"]
    return [f"the trajectory was made for another {noun} with this robot"]


def _likely_misreading(problem: PlanningProblem, trajectory: JointTrajectory) -> str | None:
    """Return a guess at the reason of a wrong start; None without a guess."""
    if (start := problem.endpoints[0].joints) is None:
        return None
    names = problem.robot.joint_names
    q = trajectory.reordered(names).position(0.0)
    if np.allclose(q, start, atol=_NEAR):
        return None
    if np.allclose(np.sort(q), np.sort(start), atol=_NEAR):
        order = np.argsort(np.argsort(start))
        sources = np.argsort(q)[order]
        pairs = [(i, j) for i, j in enumerate(sources) if i != j]
        swapped = ", ".join(f"'{names[j]}' starts where '{names[i]}' should" for i, j in pairs)
        return f"its joints look to be in another order: {swapped}"
    return None


def motion_notes(
    task: Task, path: Path, name: str, file: TrajectoryFile
) -> tuple[Motion, Certificate | CycleCertificate, list[str]]:
    """Return a motion that is shown, its certificate, as of `check`, and notes.

    The first note is the verdict, then come notes on the file.

    Raises:
        TrajectoryError: The motion has other joints than the problem, or as `motion_of_file`.
    """
    try:
        motion = motion_of_file(task, path, file)
    except TrajectoryError as error:
        if isinstance(task, Cycle):  # its message has the path
            raise
        raise TrajectoryError(f"{name}: {error}") from None
    tolerance = Tolerance() if file.interpolation is None else FOREIGN_TOLERANCE
    certificate = verify_motion(motion, tolerance)
    failures = "; ".join(map(certificate.describe, certificate.failures()))
    notes = [f"fails: {failures}" if failures else "passes every condition"]
    notes += notes_on_file(task, file, failed=not certificate.passed)
    if has_other_part(task, file):
        notes.append("it is drawn with an empty hand, as it carried something else")
    return motion, certificate, [f"{name}: {note}" for note in notes]


def has_other_part(task: Task, file: TrajectoryFile) -> bool:
    """Return True if a problem's motion was made with other carried solids than the problem's."""
    is_cycle = isinstance(task, Cycle)
    return not is_cycle and CARRIED in differing_parts(task, file.part_hashes)
