"""Short text: names of joints and links, dataclasses on one line, cells of tables."""

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from tubeplanner.checks import is_number
from tubeplanner.errors import TubePlannerError, shown

# ---- Names of joints, links and solids: short text that a terminal shows as it is.

MAX_NAME_LENGTH = 200  # [characters]


def require_name(what: str, name: object, error: type[TubePlannerError]) -> str:
    """Return a name that messages, files and figures can hold.

    Control characters and marks that turn the direction of writing are refused: in a terminal they
    would make other text of what follows.

    Args:
        what: What messages call it, such as "joint_names[0]".
        name: The name.
        error: What is raised.

    Raises:
        TubePlannerError: Of the kind asked for: it is no text, empty, too long, or holds a
            character that cannot be shown.
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


# ---- What a dataclass prints: its fields on one line, large ones by what and how many they are.

_MOST_NUMBERS = 8  # of an array that is printed in full
_MOST_CHARACTERS = 60  # of a value


def short_repr(instance: Any) -> str:
    """Return the representation of a dataclass; fields that are None, empty or hidden are left out.

    To be its method: `__repr__ = short_repr`.
    """
    named = {f.name: getattr(instance, f.name, None) for f in fields(instance) if _is_shown(f)}
    given = [f"{name}={_brief(value)}" for name, value in named.items() if not _is_empty(value)]
    return f"{type(instance).__name__}({', '.join(given)})"


def _is_shown(field: Any) -> bool:
    return bool(field.repr) and not field.name.startswith("_")


def _is_empty(value: object) -> bool:
    return value is None or (isinstance(value, str | tuple | list | Mapping) and not value)


def _brief(value: object) -> str:
    """Return a value on one line: arrays by shape, many or long members by kind and count."""
    if isinstance(value, np.ndarray):
        if value.size > _MOST_NUMBERS:
            return f"<array {value.shape}>"
        return np.array2string(value, precision=4, separator=", ").replace("\n", "")
    if isinstance(value, Enum):
        return str(value.value)
    if isinstance(value, Mapping) and len(str(value)) > _MOST_CHARACTERS:
        return f"<{len(value)} by name>"
    if isinstance(value, tuple | list) and len(str(value)) > _MOST_CHARACTERS:
        kinds = dict.fromkeys(type(member).__name__ for member in value)
        return f"<{len(value)} {' or '.join(kinds)}>"
    text = shown(value, _MOST_CHARACTERS)
    return f"<{type(value).__name__}>" if is_dataclass(value) and text.endswith("...") else text


# ---- Values of fields as tables and JSON have them.


def json_value(value: Any) -> Any:
    """Return a value of YAML as JSON has it: infinity and NaN become their words."""
    if isinstance(value, dict):
        return {str(key): json_value(part) for key, part in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [json_value(part) for part in value]
    if is_number(value) and not np.isfinite(value):
        return {np.inf: ".inf", -np.inf: "-.inf"}.get(value, ".nan")
    return value


def value_text(value: Any) -> str:
    """Return a field's value as a table has it: lists and maps as JSON."""
    written = json_value(value)
    return written if isinstance(written, str) else json.dumps(written)


# ---- Cells of tables that spreadsheets would run: text that begins as a formula does.

FORMULA_BEGINS = ("=", "+", "-", "@")


def without_formulas(table: str) -> str:
    """Return CSV whose cells are numbers or text: an apostrophe is put before what is a formula.

    Args:
        table: CSV with lines that end in a newline alone.
    """
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
