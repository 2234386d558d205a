"""Short text: names of joints and links, dataclasses on one line, cells of tables."""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, Protocol

import numpy as np

from tubeplanner.checks import is_number
from tubeplanner.errors import TubePlannerError, shown

# ---- Names of joints, links and solids: short text that a terminal shows as it is.

MAX_NAME_LENGTH = 200  # [characters]


def require_name(what: str, name: object, error: type[TubePlannerError]) -> str:
    """Return a name that messages, files and figures can hold.

    Control characters and marks that turn the direction of writing are refused: a terminal would
    show other text after them.
    """
    if not isinstance(name, str) or not name:
        raise error(f"{what} is {shown(name)}; a name must be text that is not empty")
    if len(name) > MAX_NAME_LENGTH:
        raise error(
            f"{what} is {shown(name)}, {len(name)} characters long; shorten it to at most "
            f"{MAX_NAME_LENGTH}"
        )
    hidden = next((character for character in name if not character.isprintable()), None)
    if hidden is not None:
        raise error(
            f"{what} is {shown(name)}, with the character {hidden!r}, which cannot be shown; "
            "rename it"
        )
    return name


# ---- Dataclasses on one line; large fields by kind and size.

_MAX_NUMBERS = 8  # of an array that is printed in full
_MAX_CHARACTERS = 60  # of a value


def short_repr(instance: Any) -> str:
    """Return the representation of a dataclass; fields that are None, empty or hidden are left out.

    For use as a method: `__repr__ = short_repr`.
    """
    parts = []
    for field in fields(instance):
        if not field.repr or field.name.startswith("_"):
            continue
        value = getattr(instance, field.name, None)
        is_empty = isinstance(value, str | tuple | list | Mapping) and not value
        if value is not None and not is_empty:
            parts.append(f"{field.name}={_brief(value)}")
    return f"{type(instance).__name__}({', '.join(parts)})"


def _brief(value: object) -> str:
    """Return the short text of a value: arrays by shape, many or long members by kind and count."""
    if isinstance(value, np.ndarray):
        if value.size > _MAX_NUMBERS:
            return f"<array {value.shape}>"
        return np.array2string(value, precision=4, separator=", ").replace("\n", "")
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, Mapping) and len(str(value)) > _MAX_CHARACTERS:
        return f"<{len(value)} by name>"
    if isinstance(value, tuple | list) and len(str(value)) > _MAX_CHARACTERS:
        kinds = dict.fromkeys(type(member).__name__ for member in value)
        return f"<{len(value)} {' or '.join(kinds)}>"
    text = shown(value, _MAX_CHARACTERS)
    return f"<{type(value).__name__}>" if is_dataclass(value) and text.endswith("...") else text


# ---- Values of fields for tables and JSON.


def json_value(value: Any) -> Any:
    """Return a YAML value as a JSON value: infinity and NaN as YAML's words, arrays as lists."""
    if isinstance(value, dict):
        return {str(key): json_value(part) for key, part in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [json_value(part) for part in value]
    if is_number(value) and not np.isfinite(value):
        return {np.inf: ".inf", -np.inf: "-.inf"}.get(value, ".nan")
    return value


def value_text(value: Any) -> str:
    """Return the text of a field's value for a table; lists and maps as JSON."""
    plain = json_value(value)
    return plain if isinstance(plain, str) else json.dumps(plain)


# ---- Times, and limits that cost time.

MIN_SAVING = 1e-6  # [s]: smaller savings are rounding


class LimitCost(Protocol):
    """Cost of a limit; its text names the limit and the saving."""

    @property
    def saved(self) -> float:
        """Time that 10 % more of the limit would save [s]."""


def in_milliseconds(seconds: float) -> str:
    """Return a time in ms, with two digits or more."""
    value = 1000 * seconds
    return f"{value:.0f} ms" if abs(value) >= 9.95 else f"{value:.2g} ms"


def savings(costs: Iterable[LimitCost]) -> list[str]:
    """Return the limits whose rise saves time, each with its saving, in the given order."""
    return [str(cost) for cost in costs if cost.saved > MIN_SAVING]


# ---- Cells of tables that spreadsheets would run: text that begins as a formula does.

FORMULA_BEGINS = ("=", "+", "-", "@")


def csv_text(header: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table as CSV that is safe to open in a spreadsheet."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return without_formulas(stream.getvalue())


def without_formulas(table: str) -> str:
    """Return CSV with an apostrophe before cells that a spreadsheet would take for a formula."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    for row in csv.reader(io.StringIO(table, newline="")):
        writer.writerow([f"'{cell}" if _is_formula(cell) else cell for cell in row])
    return stream.getvalue()


def _is_formula(cell: str) -> bool:
    if not cell.lstrip().startswith(FORMULA_BEGINS):
        return False
    try:
        float(cell)
    except ValueError:
        return True
    return False
