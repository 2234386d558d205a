"""Notes on a motion that is shown under a problem: does it pass there, and is it made for it?"""

from tubeplanner.errors import TrajectoryError
from tubeplanner.files.file_notes import notes_on_file
from tubeplanner.files.part_hashes import CARRIED, differing_parts
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.trajectory_file import TrajectoryFile
from tubeplanner.verification.judged_condition import FOREIGN_TOLERANCE, Tolerance
from tubeplanner.verification.verification import verify


def motion_notes(problem: PlanningProblem, name: str, file: TrajectoryFile) -> list[str]:
    """Return sentences: the verdict as of `check`, then what else is to be known of the file.

    Args:
        problem: The planning problem under which the motion is shown.
        name: What the motion is called.
        file: Its file.

    Raises:
        TrajectoryError: It moves other joints than the problem's.
    """
    tolerance = Tolerance() if file.interpolation is None else FOREIGN_TOLERANCE
    try:
        certificate = verify(problem, file.trajectory, tolerance)
    except TrajectoryError as error:
        raise TrajectoryError(f"{name}: {error}") from None
    failures = "; ".join(certificate.describe(failed) for failed in certificate.failures())
    notes = [f"fails: {failures}" if failures else "passes every condition"]
    notes += notes_on_file(problem, file, failed=not certificate.passed)
    if has_other_part(problem, file):
        notes.append("it is drawn with an empty hand, as it carried something else")
    return [f"{name}: {note}" for note in notes]


def has_other_part(problem: PlanningProblem, file: TrajectoryFile) -> bool:
    """Return whether a motion was made with other carried solids than the problem's."""
    return CARRIED in differing_parts(problem, file.part_hashes)
