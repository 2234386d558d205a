"""Notes on a motion that is shown as one of a cycle: does it pass, and is it made for it?"""

from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.files.cycle_notes import notes_on_cycle_file
from tubeplanner.trajectory.trajectory_file import TrajectoryFile
from tubeplanner.verification.cycle_verification import verify_cycle


def cycle_motion_notes(motion: CycleMotion, name: str, file: TrajectoryFile) -> list[str]:
    """Return sentences: the verdict as of `check`, then what else is to be known of the file.

    Args:
        motion: The motion of a cycle.
        name: What it is called.
        file: Its file.
    """
    certificate = verify_cycle(motion.cycle, motion)
    failures = "; ".join(map(certificate.describe, certificate.failures()))
    notes = [f"fails: {failures}" if failures else "passes every condition"]
    return [f"{name}: {note}" for note in [*notes, *notes_on_cycle_file(motion.cycle, file)]]
