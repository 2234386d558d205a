"""What `check` makes of the trajectory file of a cycle."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tubeplanner.commands.console import empty_report
from tubeplanner.commands.cycle_report import cycle_check_text
from tubeplanner.constraints.trajectory_peaks import peaks_as_dict, trajectory_peaks
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion, move_rows
from tubeplanner.cycle.motion_of_file import motion_of_file
from tubeplanner.files.cycle_notes import notes_on_cycle_file
from tubeplanner.native.library import LIBRARY
from tubeplanner.outcome import Place
from tubeplanner.robot.robot_notes import robot_notes
from tubeplanner.trajectory.trajectory_file import TrajectoryFile
from tubeplanner.verification.cycle_certificate import CycleCertificate
from tubeplanner.verification.cycle_verification import verify_cycle
from tubeplanner.verification.judged_condition import Tolerance


@dataclass(frozen=True, eq=False)
class CheckedCycle:
    """The motion of a cycle from a file, and its judgement.

    Attributes:
        motion: The motion.
        certificate: Of it.
        certificate_time: Wall time that judging took [s].
        notes: What else is to be known of the file.
    """

    motion: CycleMotion
    certificate: CycleCertificate
    certificate_time: float
    notes: tuple[str, ...]

    @property
    def message(self) -> str:
        """What is said of the trajectory, without the full stop."""
        told: dict[str, str] = {}
        for failure in self.certificate.failures():
            reason = self.certificate.describe(failure)
            told.setdefault(reason.partition(": ")[2], reason)  # moves without a stop fail together
        reasons = "; ".join(told.values())
        return f"fails: {reasons}" if reasons else "passes every condition"

    def as_dict(self) -> dict[str, Any]:
        """Return the JSON object, loading_time still absent."""
        motion, failures = self.motion, self.certificate.failures()
        status = "certificate_failed" if failures else "success"
        where = self.certificate.place(failures[0]) if failures else Place()
        return {
            **empty_report(status, f"the trajectory {self.message}", where.as_dict()),
            "duration": motion.trajectory.duration,
            "certificate_time": self.certificate_time,
            **peaks_as_dict(trajectory_peaks(motion.cycle.robot, motion.trajectory)),
            "moves": move_rows(motion),
            "marks": [mark.as_dict() for mark in motion.marks],
            "build": LIBRARY.build,
            "notes": list(self.notes),
            "certificate": self.certificate.as_dict(),
            "controller": None,
        }

    def text(self) -> str:
        """Return what is printed otherwise, but for the last line."""
        return cycle_check_text(self.motion, self.certificate, self.notes)


def checked_cycle(
    cycle: Cycle, path: Path, file: TrajectoryFile, tolerance: Tolerance
) -> CheckedCycle:
    """Judge the trajectory of a file as the motion of a cycle.

    Args:
        cycle: The cycle.
        path: The file.
        file: What it holds.
        tolerance: How far below zero margins may lie.

    Raises:
        TrajectoryError: It has no marks, or others than the cycle's steps, or other joints.
    """
    motion = motion_of_file(cycle, path, file)
    begin = time.perf_counter()
    certificate = verify_cycle(cycle, motion, tolerance)
    spent = time.perf_counter() - begin
    notes = (*notes_on_cycle_file(cycle, file), *robot_notes(cycle.robot))
    return CheckedCycle(motion, certificate, spent, notes)
