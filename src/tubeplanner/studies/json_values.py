"""Values of fields as tables and JSON have them."""

import json
from typing import Any

import numpy as np

from tubeplanner.options import is_number


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
