"""The types of what journals hold, checked before it is used: a journal may have been edited."""

import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from pydantic import TypeAdapter


def require_fields(kind: type, values: Mapping[str, Any]) -> None:
    """Raise unless JSON values, by name, may be the fields of a dataclass.

    Args:
        kind: The dataclass.
        values: As `json.loads` returns them.

    Raises:
        ValueError: A name is unknown, a field that it needs is missing, a type is another one, or a
            number is not finite.
    """
    known = {each.name for each in fields(kind)}
    unknown = [name for name in values if name not in known]
    if unknown:
        raise ValueError(f"it has {unknown[0]!r}")
    TypeAdapter(kind).validate_json(json.dumps(values, allow_nan=False), strict=True)
