"""A change of one quantity of a problem, by any size."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

FIGURES = 3  # of a size: what is certified is what is printed
_SHOWN = 2 * FIGURES  # of a value that a size is added to

_MILLI = {"m": "mm", "s": "ms"}


@dataclass(frozen=True)
class Proposal:
    """A change by a certain size.

    Attributes:
        changes: Values by field path, as `load_problem` takes them.
        after: The quantity then, as JSON values.
        text: The change, as one tells it to somebody.
        brief: Its size, or the value then, where the rest is known; empty: it has none.
    """

    changes: Mapping[str, Any]
    after: Any
    text: str
    brief: str = ""


@dataclass(frozen=True)
class Change:
    """A change of one quantity in one direction.

    Attributes:
        kind: Which sort of quantity, such as "radius" or "effort".
        field: The quantity's path in the problem file.
        before: The quantity as it is, as JSON values.
        unit: Of the quantity and of sizes; empty: none.
        scale: The size that counts as one: the quantity itself, 0.1 m or 0.1 rad.
        most: The largest size that makes sense.
        propose: From a size, up to the largest: the change by it.
        about: Names of what it concerns: "segment 3", a joint, an obstacle.
        is_switch: Whether it is made or not, and has no size but 1.
        is_loss: Whether sizes are taken off the quantity: then what is left counts as well.
    """

    kind: str
    field: str
    before: Any
    unit: str
    scale: float
    most: float
    propose: Callable[[float], Proposal]
    about: frozenset[str] = frozenset()
    is_switch: bool = False
    is_loss: bool = False

    def __repr__(self) -> str:
        return f"<Change of {self.field}, up to {self.most:g} {self.unit}>"


def rounded(size: float) -> float:
    """Return a number in the figures that texts show."""
    return float(f"{size:.{FIGURES}g}")


def exact(value: float) -> float:
    """Return a number without what adding rounded ones leaves behind it."""
    return float(f"{value:.10g}")


def figures(value: float, unit: str = "") -> str:
    """Return a number in the figures that texts show, with its unit; metres as millimetres."""
    if unit in _MILLI and abs(value) < 1:
        value, unit = 1000 * value, _MILLI[unit]
    return f"{value:.{_SHOWN}g} {unit}".rstrip()


def from_to(before: float, after: float, unit: str) -> str:
    """Return "30 -> 42 mm"."""
    both = (before, after)
    if unit in _MILLI and max(map(abs, both)) < 1:
        both, unit = (1000 * before, 1000 * after), _MILLI[unit]
    first, then = (f"{value:.{_SHOWN}g}" for value in both)
    return f"{first} -> {then} {unit}".rstrip()
