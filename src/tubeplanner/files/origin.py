"""What a trajectory file says of where it comes from."""

from typing import Any

from tubeplanner import __version__
from tubeplanner.files.fingerprint import problem_hash, robot_hash
from tubeplanner.files.part_hashes import part_hashes
from tubeplanner.problem.problem import PlanningProblem


def origin(problem: PlanningProblem, method: str | None = None) -> dict[str, Any]:
    """Return the origin that a trajectory file states, as JSON values.

    Args:
        problem: The planning problem.
        method: How the trajectory was made; None: not known, and not stated.
    """
    return {
        **({} if method is None else {"method": method}),
        "tubeplanner_version": __version__,
        "problem": problem.name,
        "problem_hash": problem_hash(problem),
        "robot_hash": robot_hash(problem.robot),
        "part_hashes": part_hashes(problem),
    }
