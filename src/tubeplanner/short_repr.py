"""What a dataclass prints: its fields on one line, large ones by what and how many they are."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from tubeplanner.errors import shown

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
