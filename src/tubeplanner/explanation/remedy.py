"""What was found by planning with a change: a remedy, or how much room there is."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from tubeplanner.short_repr import short_repr
from tubeplanner.studies.json_values import json_value


@dataclass(frozen=True)
class Remedy:
    """A single change that makes a problem possible: planning with it was certified.

    Attributes:
        field: Path of what is changed.
        before: Its value as it is.
        after: Its value then.
        unit: Of the value; empty: none.
        duration: Of the certified motion with it [s].
        text: The change in words.
        changes: Values by field path that make it, as `load_problem` takes them.
        cost: The change over its scale: the value itself, 0.1 m or 0.1 rad.
        too_little: The largest value that was tried and not enough; None: none was.
        too_little_text: The same in words; empty: none was.
        is_smallest: Whether that is within 5 % of the change.
    """

    field: str
    before: Any
    after: Any
    unit: str
    duration: float
    text: str
    changes: Mapping[str, Any]
    cost: float
    too_little: Any
    too_little_text: str
    is_smallest: bool

    __repr__ = short_repr

    def as_dict(self) -> dict[str, Any]:
        """Return the remedy as JSON values; infinity is `.inf`."""
        fields = asdict(self)
        first = {"field": self.field, "from": fields.pop("before"), "to": fields.pop("after")}
        first |= {"unit": self.unit, "certified": True}
        return json_value({**first, **fields})


@dataclass(frozen=True)
class Room:
    """How far one quantity of a problem may change for the worse until nothing is found any more.

    Attributes:
        field: Path of what is changed.
        before: Its value as it is.
        after: The worst value with which a motion was certified; None: none was found.
        unit: Of the value; empty: none.
        duration: Of that motion [s]; None without one.
        text: The room in words.
        too_much: The mildest value with which none was found; None: all that was tried is possible.
        too_much_text: The same in words; empty: all is.
        is_exact: Whether that is within 5 % of the change.
    """

    field: str
    before: Any
    after: Any
    unit: str
    duration: float | None
    text: str
    too_much: Any
    too_much_text: str
    is_exact: bool

    __repr__ = short_repr

    def as_dict(self) -> dict[str, Any]:
        """Return the room as JSON values; infinity is `.inf`."""
        fields = asdict(self)
        first = {"field": self.field, "from": fields.pop("before"), "to": fields.pop("after")}
        return json_value({**first, **fields})
