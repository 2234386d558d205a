"""Notes about a trajectory file, besides its certificate."""

import numpy as np

from tubeplanner.errors import shown
from tubeplanner.files.fingerprint import problem_hash, robot_hash
from tubeplanner.files.part_hashes import differing_parts
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.trajectory_file import TrajectoryFile

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
    if not isinstance(problem.start, np.ndarray):
        return None
    names, revolute = problem.robot.joint_names, problem.robot.revolute
    start, q = problem.start, trajectory.reordered(names).position(0.0)
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
