"""The fields of a problem, with changes of single ones that are made before they are checked."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tubeplanner.problem.field_paths import changed_fields
from tubeplanner.problem.problem_format import ProblemFields, check_problem_fields, read_document
from tubeplanner.problem.schema_place import SchemaPlace


def read_problem_fields(path: Path, changes: Mapping[str, Any] | None = None) -> ProblemFields:
    """Read a problem file, YAML 1.2 or JSON.

    Args:
        path: The file.
        changes: Other values, by field path.

    Raises:
        ProblemError: The file cannot be read, a key is unknown or doubled, a value has the wrong
            type. The message names the file and the field.
    """
    return check_problem_fields(changed_problem(read_document(path), changes), str(path))


def changed_problem(data: Any, changes: Mapping[str, Any] | None) -> Any:
    """Return what a problem file holds, with other values at some field paths.

    Raises:
        ProblemError: As `changed_fields`.
    """
    return changed_fields(data, changes or {}, SchemaPlace.of(ProblemFields))
