"""A file that is a problem or a cycle, whichever it is."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tubeplanner.arguments import given_path
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_reader import load_cycle
from tubeplanner.problem.document_kind import is_cycle
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.problem_format import read_document
from tubeplanner.problem.problem_reader import load_problem
from tubeplanner.resources import find_problem


def load_problem_or_cycle(
    name: str | Path, directory: str | Path = ".", *, changes: Mapping[str, Any] | None = None
) -> PlanningProblem | Cycle:
    """Read a problem file or a cycle file, whichever it is.

    Args:
        name: A path, or `example:ROBOT/NAME` for a bundled one.
        directory: Where a relative path starts.
        changes: Other values by field path, as for `load_problem`.

    Raises:
        ProblemError: As `load_problem` or `load_cycle`.
        RobotError: Likewise.
    """
    load = load_cycle if is_cycle_file(name, directory) else load_problem
    return load(name, directory, changes=changes)


def is_cycle_file(name: str | Path, directory: str | Path = ".") -> bool:
    """Return whether a file is a cycle's rather than a problem's.

    Args:
        name: As for `load_problem_or_cycle`.
        directory: Likewise.

    Raises:
        ProblemError: It does not exist, or cannot be read.
    """
    return is_cycle(read_document(find_problem(name, given_path("directory", directory))))
