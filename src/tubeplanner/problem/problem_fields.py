"""The fields of a problem, with changes of single ones that are made before they are checked."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tubeplanner.errors import ProblemError
from tubeplanner.problem.document_kind import require_problem
from tubeplanner.problem.field_paths import changed_fields, require_changes
from tubeplanner.problem.field_types import Section
from tubeplanner.problem.problem_format import ProblemFields, check_problem_fields
from tubeplanner.problem.problem_layers import INCLUDE, ProblemLayers
from tubeplanner.problem.schema_place import SchemaPlace


def read_problem_fields(path: Path, changes: Mapping[str, Any] | None = None) -> ProblemFields:
    """Read a problem file, YAML 1.2 or JSON, and what it includes.

    Args:
        path: The file.
        changes: Other values, by field path.

    Raises:
        ProblemError: A file cannot be read or is a cycle, a key is unknown or doubled, a value has
            the wrong type. The message names the file and the field.
    """
    return checked_layers(ProblemLayers.read(path), changes)


def checked_layers(
    layers: ProblemLayers, changes: Mapping[str, Any] | None = None
) -> ProblemFields:
    """Return the fields that layers give together, with other values at some field paths.

    Raises:
        ProblemError: As `read_problem_fields`.
    """
    require_problem(layers.documents[-1], layers.sources[-1])
    data = changed_problem(layers.merged, changes)
    return check_problem_fields(data, layers.sources[-1], layers.source_of)


def changed_problem(
    data: Any, changes: Mapping[str, Any] | None, model: type[Section] = ProblemFields
) -> Any:
    """Return what a problem file and its included ones hold, with other values at field paths.

    Args:
        data: What they hold.
        changes: Other values, by field path.
        model: Of the file.

    Raises:
        ProblemError: As `changed_fields`; or changes are no map from paths, or included files
            would be others.
    """
    if changes is None:
        return data
    require_changes(changes)
    for path in changes:
        if path.split(".")[0] == INCLUDE:
            raise ProblemError(
                f"{path}: values are changed after files are included; change {INCLUDE} in the "
                "file, or set the fields themselves"
            )
    return changed_fields(data, changes, SchemaPlace.of(model))
