"""`check`: certificate of a trajectory file; controllers of `--for`."""

import time
from pathlib import Path
from typing import Any

import click

from tubeplanner.certificate.judged_motion import FOREIGN_TOLERANCE, Tolerance
from tubeplanner.certificate.verification import Certificate, CycleCertificate, verify_motion
from tubeplanner.cli import console
from tubeplanner.cli.report import check_lines, geometry_lines
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.limits.holding_limit import holding_peaks
from tubeplanner.limits.peaks import peaks_as_dict, trajectory_peaks
from tubeplanner.limits.process_stretches import all_marks, stretch_runs
from tubeplanner.native.library import LIBRARY
from tubeplanner.outcome import Location
from tubeplanner.output.controllers import (
    FRANKA_ARMS,
    ControllerVerdict,
    franka_limits,
    judged_by_franka,
    judged_by_jtc,
)
from tubeplanner.output.files.file_notes import notes_on_file, unit_guesses
from tubeplanner.robot.notes import robot_notes, unlimited_notes
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.info import task_doubts
from tubeplanner.task.motion import CycleMotion, Motion, ProblemMotion, motion_of_file, move_rows
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
        loaded, loading_time = console.load_task_timed(problem, enter, changes)
        read = read_trajectory_file(trajectory, loaded.robot.joint_names)
        own = Tolerance() if read.interpolation is None else FOREIGN_TOLERANCE
        motion = motion_of_file(loaded, trajectory, read)
        verdict = None if controller is None else judged_by(controller, motion, read)
        enter("certificate")
        begin = time.perf_counter()
        certificate = verify_motion(motion, user_tolerance or own)
        certificate_time = time.perf_counter() - begin
    robot, duration = loaded.robot, motion.trajectory.duration
    notes = notes_on_file(loaded, read, failed=not certificate.passed)
    notes += [*task_doubts(loaded), *unlimited_notes(robot), *robot_notes(robot)]
    message = _message(motion, read, certificate)
    if verdict is not None:
        message += f"; {verdict.name}: {verdict.summary}"
    passed = certificate.passed and (verdict is None or verdict.accepted)
    if as_json:
        sentence = f"the trajectory {message}"
        if verdict is not None and verdict.gravest is not None:
            sentence += f": {verdict.gravest.error}: {verdict.gravest.message}"
        status, where = "success" if passed else "certificate_failed", _where(certificate, verdict)
        moves: dict[str, Any] = {}
        if isinstance(motion, CycleMotion):
            moves = {"moves": move_rows(motion)}
        fields = {
            **console.empty_report(status, sentence, where.as_dict()),
            "duration": duration,
            "certificate_time": certificate_time,
            "loading_time": loading_time,
            **peaks_as_dict(trajectory_peaks(robot, motion.trajectory)),
            "holding": [each.as_dict() for each in holding_peaks(motion.sections)],
            "stretches": [each.as_dict() for each in stretch_runs(motion.sections)],
            **moves,
            "marks": [each.as_dict() for each in all_marks(motion.marks, motion.sections)],
            "build": LIBRARY.build,
            "notes": notes,
            "certificate": certificate.as_dict(),
            "controller": None if verdict is None else verdict.as_dict(),
        }
        console.print_json(fields)
    else:
        lines = [*check_lines(motion, certificate), *(f"note: {note}" for note in notes)]
        if isinstance(loaded, Cycle):
            lines += geometry_lines(loaded)
        lines += [] if verdict is None else verdict.lines()
        console.say(*lines, f"{trajectory} ({duration:.4f} s) {message}.", sep="\n")
    return console.SUCCESS if passed else console.INFEASIBLE


def _message(
    motion: Motion, read: TrajectoryFile, certificate: Certificate | CycleCertificate
) -> str:
    """Return the judgement as a predicate of a sentence, without the full stop."""
    reasons = [certificate.describe(failure) for failure in certificate.failures()]
    if isinstance(motion, ProblemMotion):
        reasons += unit_guesses(motion.task, read) if reasons else []
    else:
        by_condition: dict[str, str] = {}
        for reason in reasons:  # moves without a stop fail together: the first names them
            by_condition.setdefault(reason.partition(": ")[2], reason)
        reasons = list(by_condition.values())
    return f"fails: {'; '.join(reasons)}" if reasons else "passes every condition"


def _where(
    certificate: Certificate | CycleCertificate, verdict: ControllerVerdict | None
) -> Location:
    """Return the place of the first failed condition, else of the controller's gravest error."""
    if failures := certificate.failures():
        if isinstance(certificate, CycleCertificate):
            return certificate.location(failures[0])
        return certificate.conditions[failures[0]].where
    if verdict is None or verdict.gravest is None:
        return Location()
    gravest = verdict.gravest
    time = gravest.time if gravest.first_time is None else gravest.first_time
    return Location(time=time, joint=gravest.joint)


def judged_by(name: str, motion: Motion, file: TrajectoryFile) -> ControllerVerdict:
    """Return the verdict of a controller, an entry of `CONTROLLERS`, on the motion of a file.

    Raises:
        OptionError: The controller is unknown, or for another arm.
    """
    if name not in CONTROLLERS:
        raise OptionError(f"--for: {unknown_name('controller', name, CONTROLLERS)}")
    if name == _JTC:
        return judged_by_jtc(name, motion, file)
    return judged_by_franka(name, motion.task.robot, motion.trajectory, franka_limits(name))
