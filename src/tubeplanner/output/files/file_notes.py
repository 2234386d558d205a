"""Notes on a trajectory file: other problem, other robot, failed certificate."""

import numpy as np

from tubeplanner.certificate.cycle_verification import verify_cycle
from tubeplanner.certificate.judged_motion import FOREIGN_TOLERANCE, Tolerance
from tubeplanner.certificate.verification import verify
from tubeplanner.errors import TrajectoryError, shown
from tubeplanner.output.files.fingerprint import (
    CARRIED,
    cycle_hash,
    differing_cycle_parts,
    differing_parts,
    problem_hash,
    robot_hash,
)
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.cycle_motion import CycleMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.reader import TrajectoryFile

# ---- Notes about a trajectory file, besides its certificate.

_NEAR = 1e-2  # [rad or m]: starts this close to each other are the same
_COLUMNS_SHOWN = 20


def notes_on_file(problem: PlanningProblem, file: TrajectoryFile, *, failed: bool) -> list[str]:
    """Return sentences: how samples were joined, for what the file was made, likely mistakes.

    Args:
        problem: The planning problem.
        file: Its trajectory has the problem's joints, in any order.
        failed: Whether its certificate failed.
    """
    notes = []
    if file.interpolation is not None:
        notes.append(f"samples are joined by {file.interpolation}")
    if file.ignored:
        notes.append(f"columns that are not read: {_listed(file.ignored)}")
    notes += _notes_on_origin(problem, file)
    misreading = _likely_misreading(problem, file.trajectory) if failed else None
    return notes if misreading is None else [*notes, misreading]


def _listed(columns: tuple[str, ...]) -> str:
    named = ", ".join(map(shown, columns[:_COLUMNS_SHOWN]))
    more = len(columns) - _COLUMNS_SHOWN
    return f"{named} and {more} more" if more > 0 else named


def _notes_on_origin(problem: PlanningProblem, file: TrajectoryFile) -> list[str]:
    """Return a sentence if a trajectory was not made for the problem."""
    is_other_robot = file.robot_hash not in (None, robot_hash(problem.robot))
    if not is_other_robot and file.problem_hash in (None, problem_hash(problem)):
        return []
    if differing := differing_parts(problem, file.part_hashes):
        return [
            f"the trajectory was made for another problem; what differs: {', '.join(differing)}"
        ]
    if is_other_robot:
        return ["the trajectory was made for another robot, payload, limits or motors"]
    return ["the trajectory was made for another problem with this robot"]


def _likely_misreading(problem: PlanningProblem, trajectory: JointTrajectory) -> str | None:
    """Return a guess why a trajectory does not start where it should; None if there is none."""
    if (start := problem.endpoints[0].joints) is None:
        return None
    names, revolute = problem.robot.joint_names, problem.robot.revolute
    q = trajectory.reordered(names).position(0.0)
    if np.allclose(q, start, atol=_NEAR):
        return None
    radians = np.where(revolute, np.radians(q), q)
    if np.allclose(radians, start, atol=_NEAR):
        return "its positions look like degrees; radians are needed"
    if np.allclose(np.sort(q), np.sort(start), atol=_NEAR):
        order = np.argsort(np.argsort(start))
        sources = np.argsort(q)[order]
        swapped = [
            f"'{names[j]}' starts where '{names[i]}' should"
            for i, j in enumerate(sources)
            if i != j
        ]
        return f"its joints look to be in another order: {', '.join(swapped)}"
    return None


# ---- Notes on a motion that is shown under a problem: does it pass there, and is it made for it?


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


# ---- Notes about the trajectory file of a cycle, besides its certificate.


def notes_on_cycle_file(cycle: Cycle, file: TrajectoryFile) -> list[str]:
    """Return a sentence if a trajectory was not made for the cycle; none if it does not say."""
    is_other_robot = file.robot_hash not in (None, robot_hash(cycle.robot))
    if not is_other_robot and file.problem_hash in (None, cycle_hash(cycle)):
        return []
    if differing := differing_cycle_parts(cycle, file.part_hashes):
        return [f"the trajectory was made for another cycle; what differs: {', '.join(differing)}"]
    if is_other_robot:
        return ["the trajectory was made for another robot, payload, limits or motors"]
    return ["the trajectory was made for another cycle with this robot"]


# ---- Notes on a motion that is shown as one of a cycle: does it pass, and is it made for it?


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
