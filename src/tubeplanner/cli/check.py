"""`check`: certificate of a trajectory file; controllers of `--for`."""

import time
from pathlib import Path
from typing import Any

import click

from tubeplanner.certificate.judged_motion import FOREIGN_TOLERANCE, Tolerance
from tubeplanner.certificate.verification import Certificate, verify, verify_cycle
from tubeplanner.cli import console
from tubeplanner.cli.report import (
    certificate_text,
    cycle_check_text,
    other_speeds_line,
    peaks_lines,
)
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.limits.peaks import peaks_as_dict, trajectory_peaks
from tubeplanner.native.library import LIBRARY
from tubeplanner.outcome import Location
from tubeplanner.output.controllers.franka import FRANKA_ARMS, franka_limits, judged_by_franka
from tubeplanner.output.controllers.ros2_control import judged_by_jtc
from tubeplanner.output.controllers.verdict import ControllerVerdict
from tubeplanner.output.files.file_notes import notes_on_cycle_file, notes_on_file, unit_guesses
from tubeplanner.robot.notes import robot_notes, unlimited_notes
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.info import cycle_doubts, problem_doubts
from tubeplanner.task.motion import motion_of_file, move_rows
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.reader import TrajectoryFile, read_trajectory_file

_JTC = "jtc"
CONTROLLERS = (*FRANKA_ARMS, _JTC)


@click.command()
@click.argument("problem")
@click.argument("trajectory", type=console.INPUT)
@click.option("--tolerance", help="Allowed negative margin, ABS[,REL].")
@click.option(
    "--for",
    "controller",
    help="Also check the rules of a controller: fr3, fer, jtc (JointTrajectoryController).",
)
@console.SET
@console.AS_JSON
def check(
    problem: str,
    trajectory: Path,
    tolerance: str | None,
    controller: str | None,
    changes: dict[str, Any],
    as_json: bool,
) -> int:
    """Check the TRAJECTORY file against every condition of PROBLEM or of a cycle."""
    user_tolerance = None
    if tolerance is not None:
        try:
            user_tolerance = Tolerance(*(float(word) for word in tolerance.split(",")))
        except (TypeError, ValueError):
            raise OptionError(f"--tolerance '{tolerance}' is not ABS or ABS,REL") from None
    with console.shown_progress() as enter:
        loaded, loading_time = console.load_either_timed(problem, enter, changes)
        read = read_trajectory_file(trajectory, loaded.robot.joint_names)
        own = Tolerance() if read.interpolation is None else FOREIGN_TOLERANCE
        margins = user_tolerance or own
        if isinstance(loaded, Cycle):
            if controller is not None:
                raise OptionError(
                    f"--for {controller} judges the motion of a problem; of a cycle leave it out, "
                    "and check moves as problems of their own"
                )
            enter("certificate")
            return _check_cycle(loaded, trajectory, read, margins, loading_time, as_json)
        verdict = None if controller is None else judged_by(controller, loaded, read)
        enter("certificate")
        begin = time.perf_counter()
        certificate = verify(loaded, read.trajectory, margins)
        certificate_time = time.perf_counter() - begin
    message = _message(loaded, read, certificate, verdict)
    if as_json:
        times = {"certificate_time": certificate_time, "loading_time": loading_time}
        console.print_json(_report(loaded, read, certificate, verdict) | times)
    else:
        peaks = trajectory_peaks(loaded.robot, read.trajectory)
        console.say(*peaks_lines(loaded.robot, peaks), certificate_text(certificate), sep="\n")
        console.say(other_speeds_line(certificate))
        lines = [f"note: {note}" for note in _notes(loaded, read, certificate)]
        lines += [] if verdict is None else verdict.lines()
        console.say(*lines, sep="\n", end="\n" if lines else "")
        console.say(f"{trajectory} ({read.trajectory.duration:.4f} s) {message}.")
    return console.SUCCESS if certificate.passed and _accepted(verdict) else console.INFEASIBLE


def _accepted(verdict: ControllerVerdict | None) -> bool:
    return verdict is None or verdict.accepted


def _message(
    problem: PlanningProblem,
    read: TrajectoryFile,
    certificate: Certificate,
    verdict: ControllerVerdict | None,
) -> str:
    """Return the judgement as a predicate of a sentence, without the full stop."""
    reasons = [certificate.describe(name) for name in certificate.failures()]
    reasons += unit_guesses(problem, read) if reasons else []
    message = f"fails: {'; '.join(reasons)}" if reasons else "passes every condition"
    if verdict is None:
        return message
    return f"{message}; {verdict.name}: {verdict.summary}"


def _notes(problem: PlanningProblem, read: TrajectoryFile, certificate: Certificate) -> list[str]:
    notes = notes_on_file(problem, read, failed=not certificate.passed)
    robot = problem.robot
    return [*notes, *problem_doubts(problem), *unlimited_notes(robot), *robot_notes(robot)]


def _report(
    problem: PlanningProblem,
    read: TrajectoryFile,
    certificate: Certificate,
    verdict: ControllerVerdict | None,
) -> dict[str, object]:
    """Return the JSON object, times still absent."""
    passed = certificate.passed and _accepted(verdict)
    message = f"the trajectory {_message(problem, read, certificate, verdict)}"
    if verdict is not None and verdict.gravest is not None:
        message += f": {verdict.gravest.error}: {verdict.gravest.message}"
    where = _where(certificate, verdict).as_dict()
    return {
        **console.empty_report("success" if passed else "certificate_failed", message, where),
        "duration": read.trajectory.duration,
        **peaks_as_dict(trajectory_peaks(problem.robot, read.trajectory)),
        "build": LIBRARY.build,
        "notes": _notes(problem, read, certificate),
        "certificate": certificate.as_dict(),
        "controller": None if verdict is None else verdict.as_dict(),
    }


def _where(certificate: Certificate, verdict: ControllerVerdict | None) -> Location:
    """Return the place of the first failed condition, else of the controller's gravest error."""
    failures = certificate.failures()
    if failures:
        return certificate.conditions[failures[0]].where
    if verdict is None or verdict.gravest is None:
        return Location()
    gravest = verdict.gravest
    time = gravest.time if gravest.first_time is None else gravest.first_time
    return Location(time=time, joint=gravest.joint)


def judged_by(name: str, problem: PlanningProblem, file: TrajectoryFile) -> ControllerVerdict:
    """Return the verdict of a controller on a trajectory file.

    Args:
        name: An entry of `CONTROLLERS`.
        problem: The planning problem.
        file: The trajectory.

    Raises:
        OptionError: The controller is unknown, or for another arm.
        TrajectoryError: The trajectory moves other joints.
    """
    if name not in CONTROLLERS:
        raise OptionError(f"--for: {unknown_name('controller', name, CONTROLLERS)}")
    if name == _JTC:
        return judged_by_jtc(name, problem, file)
    return judged_by_franka(name, problem.robot, file.trajectory, franka_limits(name))


# ---- The trajectory file of a cycle.


def _check_cycle(
    cycle: Cycle,
    path: Path,
    file: TrajectoryFile,
    tolerance: Tolerance,
    loading_time: float,
    as_json: bool,
) -> int:
    """Judge the trajectory of a file as the motion of a cycle; print, return the exit status.

    Raises:
        TrajectoryError: The file has no marks, or others than the cycle's steps, or other joints.
    """
    motion = motion_of_file(cycle, path, file)
    begin = time.perf_counter()
    certificate = verify_cycle(cycle, motion, tolerance)
    certificate_time = time.perf_counter() - begin
    doubts = (*cycle_doubts(cycle), *unlimited_notes(cycle.robot))
    notes = (*notes_on_cycle_file(cycle, file), *doubts, *robot_notes(cycle.robot))
    failures, by_condition = certificate.failures(), dict[str, str]()
    for failure in failures:
        reason = certificate.describe(failure)
        # Moves without a stop fail together: the first names them.
        by_condition.setdefault(reason.partition(": ")[2], reason)
    reasons = "; ".join(by_condition.values())
    message = f"fails: {reasons}" if reasons else "passes every condition"
    if as_json:
        status = "certificate_failed" if failures else "success"
        where = certificate.location(failures[0]) if failures else Location()
        report = {
            **console.empty_report(status, f"the trajectory {message}", where.as_dict()),
            "duration": motion.trajectory.duration,
            "certificate_time": certificate_time,
            **peaks_as_dict(trajectory_peaks(motion.cycle.robot, motion.trajectory)),
            "moves": move_rows(motion),
            "marks": [mark.as_dict() for mark in motion.marks],
            "build": LIBRARY.build,
            "notes": list(notes),
            "certificate": certificate.as_dict(),
            "controller": None,
        }
        console.print_json({**report, "loading_time": loading_time})
    else:
        console.say(cycle_check_text(motion, certificate, notes))
        console.say(f"{path} ({motion.trajectory.duration:.4f} s) {message}.")
    return console.SUCCESS if certificate.passed else console.INFEASIBLE
