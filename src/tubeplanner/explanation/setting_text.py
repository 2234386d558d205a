"""Values of fields as they are written in a problem file and given to a command."""

import json
from collections.abc import Mapping
from math import isinf
from shlex import quote
from typing import Any


def setting_text(changes: Mapping[str, Any]) -> str:
    """Return how values by field path are given to a command, quoted for a shell."""
    pairs = (f"{path}={value_text(value)}" for path, value in changes.items())
    return " ".join(f"--set {quote(pair)}" for pair in pairs)


def value_text(value: Any) -> str:
    """Return a value of a field as a problem file may have it, on one line."""
    if isinstance(value, float) and isinf(value):
        return ".inf" if value > 0 else "-.inf"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, dict):
        pairs = (f"{value_text(key)}: {value_text(each)}" for key, each in value.items())
        return f"{{{', '.join(pairs)}}}"
    return json.dumps(value)


def tried_text(value: str, is_close: bool) -> str:
    """Return the nearest value on the other side; whether it is not as near as is asked.

    Args:
        value: In words; empty: none was tried.
        is_close: Whether it is as near as is asked.
    """
    return value if is_close else f"{value} (not narrowed)".lstrip()
