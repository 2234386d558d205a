"""Changes of single fields by path, such as `obstacles.wall.position`."""

import re
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any, TypeVar

from tubeplanner.checks import is_number
from tubeplanner.documents import DocumentError, parse_yaml, require_shallow
from tubeplanner.errors import OptionError, ProblemError, faults_of, shown, unknown_name
from tubeplanner.fields import SchemaLocation, Section, check_fields
from tubeplanner.task.includes import INCLUDE, ProblemLayers
from tubeplanner.task.problem_format import ProblemFields, require_problem

_Section = TypeVar("_Section", bound=Section)

# ---- Changes of single fields, made before the schema's check.
#
# A path is keys joined by dots; an item of a list has its index or its `name` as key. Names with
# dots are recognised where they exist. A value such as `x0.5` scales every number below the path.

_FACTOR = re.compile(r"x([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")


def parse_change(option: str, text: str) -> tuple[str, Any]:
    """Return path and value of FIELD.PATH=VALUE, the value in YAML."""
    path, value = _parted_at_equals(option, text, "VALUE", "tube.radius=0.02")
    return path, _parsed(option, text, value)


def parse_variation(option: str, text: str) -> tuple[str, list[Any]]:
    """Return path and values of FIELD.PATH=V1,V2,...: a list in YAML without its brackets."""
    path, values = _parted_at_equals(option, text, "V1,V2,...", "tube.radius=0.01,0.02")
    parsed: list[Any] = _parsed(option, text, f"[{values}]")
    return path, parsed


def require_path(path: object) -> None:
    """Raise ProblemError unless a field path is text."""
    if not isinstance(path, str):
        raise ProblemError(f"{shown(path)} is no field path; give text, such as 'tube.radius'")


def require_changes(changes: object) -> None:
    """Raise ProblemError unless changes are a map from field paths."""
    if not isinstance(changes, Mapping):
        raise ProblemError(f"changes are {shown(changes)}; give a map from field paths to values")
    for path in changes:
        require_path(path)


def factor_of(value: Any) -> float | None:
    """Return the factor of a value like `x0.5`; None: the value is no factor."""
    match = _FACTOR.fullmatch(value) if isinstance(value, str) else None
    return None if match is None else float(match[1])


def is_of_objective(path: str) -> bool:
    """Return True if a path leads to the objective or a field of the objective."""
    return path.split(".")[0] == "objective"


class _Walk:
    """Walk along a path into a document."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._rest: str | None = path

    def change(self, fields: Any, value: Any, location: SchemaLocation) -> None:
        """Change the value at the path in a document whose schema begins at a place."""
        holder = fields
        while True:
            key, location = self._step(holder, location)
            old = holder[key] if isinstance(holder, list) else holder.get(key)
            if self._rest is None:
                holder[key] = self._new(old, value)
                return
            # A copy: an alias elsewhere in the document keeps its value.
            holder[key] = {} if old is None and location.may_be_map else deepcopy(old)
            holder = holder[key]

    def _step(self, holder: Any, location: SchemaLocation) -> tuple[Any, SchemaLocation]:
        """Go to the next key of a map or item of a list; return the key or index, and its place."""
        if isinstance(holder, dict):
            key = self._next([*holder, *location.keys])
            below = location.below(key)
            if below is None and key not in holder:
                raise self._fault(unknown_name("key", key, location.keys))
            return key, below or SchemaLocation.of()
        if isinstance(holder, list):
            names = [item.get("name") if isinstance(item, dict) else None for item in holder]
            numbers = [str(k) for k in range(len(holder))]
            walked = self._walked
            key = self._next([*names, *numbers])
            if key in names:
                return names.index(key), location.item
            if key in numbers:
                return int(key), location.item
            if item_names := [name for name in names if isinstance(name, str)]:
                raise self._fault(unknown_name("name", key, item_names))
            count = len(holder)
            raise self._fault(
                f"{walked} has no item {shown(key)}; there are {count}, from 0 to {count - 1}"
            )
        state = "is not given" if holder is None else f"is {shown(holder)}, which has no parts"
        raise self._fault(f"{self._walked} {state}; give it as a whole")

    def _next(self, known: list[Any]) -> str:
        """Return the next key: the longest known key that fits, or else the text up to a dot."""
        rest = self._rest or ""
        fitting = [
            name for name in known if isinstance(name, str) and f"{rest}.".startswith(f"{name}.")
        ]
        key = max(fitting, key=len) if fitting else rest.partition(".")[0]
        self._rest = rest[len(key) + 1 :] if len(rest) > len(key) else None
        return key

    def _new(self, old: Any, value: Any) -> Any:
        """Return the new value: the given value, or the old value scaled."""
        factor = factor_of(value)
        if factor is None:
            return value
        if not _has_numbers(old):
            state = "nothing is given there" if old is None else f"it is {shown(old)}"
            raise self._fault(f"{state}: {value} has no number to scale; give a value")
        try:
            return _scaled(old, factor)
        except OverflowError:
            raise self._fault(f"{value} of a number that is too large; give a value") from None

    @property
    def _walked(self) -> str:
        """The part of the path up to here."""
        rest = "" if self._rest is None else f".{self._rest}"
        return self._path.removesuffix(rest)

    def _fault(self, reason: str) -> ProblemError:
        return ProblemError(f"{self._path}: {reason}")


def _has_numbers(value: Any) -> bool:
    if isinstance(value, dict | list):
        parts = value.values() if isinstance(value, dict) else value
        return any(_has_numbers(part) for part in parts)
    return is_number(value)


def _scaled(value: Any, factor: float) -> Any:
    """Return a copy of a value with every number scaled."""
    if isinstance(value, dict | list):
        scaled = deepcopy(value)  # keeps the formatting of a file
        for key in value if isinstance(value, dict) else range(len(value)):
            scaled[key] = _scaled(value[key], factor)
        return scaled
    return factor * float(value) if is_number(value) else value


def _parted_at_equals(option: str, text: str, form: str, example: str) -> tuple[str, str]:
    path, equals, value = (part.strip() for part in text.partition("="))
    if not (path and equals and value):
        raise OptionError(f"{option} {shown(text)}: give FIELD.PATH={form}, such as {example}")
    return path, value


def _parsed(option: str, text: str, value: str) -> Any:
    try:
        return parse_yaml(value)
    except DocumentError as error:
        raise OptionError(f"{option} {shown(text)}: the value is no YAML: {error}") from None


# ---- The fields of a problem, with changes.


def read_problem_fields(path: Path, changes: Mapping[str, Any] | None = None) -> ProblemFields:
    """Read a problem file, YAML 1.2 or JSON, and its included files, with changes by path."""
    return checked_layers(ProblemLayers.read(path), changes)


def checked_layers(
    layers: ProblemLayers,
    changes: Mapping[str, Any] | None = None,
    model: type[_Section] = ProblemFields,  # type: ignore[assignment]
) -> _Section:
    """Return the checked fields of merged layers, with other values at some field paths."""
    if model is ProblemFields:
        require_problem(layers.documents[-1], layers.sources[-1])
    data = changed_problem(layers.merged, changes, model)
    return check_fields(model, data, layers.sources[-1], layers.source_of)


def changed_problem(
    data: Any, changes: Mapping[str, Any] | None, model: type[Section] = ProblemFields
) -> Any:
    """Return a copy of the merged content of a file with other values at field paths.

    Changes are made in their order; a missing key is made if the schema of the model has it.
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
    if not changes or not isinstance(data, dict):
        return data
    fields = deepcopy(data)
    for path, value in changes.items():
        with faults_of(path, DocumentError):
            require_shallow(value)
        _Walk(path).change(fields, value, SchemaLocation((model,)))
    return fields
