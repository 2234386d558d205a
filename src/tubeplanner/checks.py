"""Checks of user input: numbers within bounds, options, rows, paths, executors."""

import math
import os
from math import inf
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tubeplanner.errors import OptionError, shown

# ---- Bounds of options: an error names the option, its value and the bounds.

WHOLE_NUMBER = (int, np.integer)
NUMBER = (float, np.floating, *WHOLE_NUMBER)


def is_number(value: object) -> bool:
    """Return True if a value is a real number; truth values are not."""
    return isinstance(value, NUMBER) and not isinstance(value, bool)


def are_numbers(values: object, count: int) -> bool:
    """Return True if a list, tuple or array has `count` finite real numbers and no more."""
    is_array = isinstance(values, np.ndarray) and values.ndim == 1
    if not (is_array or isinstance(values, list | tuple)):
        return False
    row: Any = values
    return len(row) == count and all(is_number(x) and is_finite(x) for x in row)


def is_finite(value: Any) -> bool:
    """Return True if a number is a finite float; larger whole numbers are not."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def in_figures(value: Any) -> str:
    """Return a number with six significant digits, any other value as `shown`."""
    return f"{value:g}" if is_number(value) and is_finite(value) else shown(value)


def require_count(options: object, least: int, *names: str, most: int | None = None) -> None:
    """Raise OptionError unless attributes of options are whole numbers within bounds."""
    bounds = f">= {least}" + ("" if most is None else f" and <= {most}")
    for name in names:
        value = getattr(options, name)
        if not isinstance(value, WHOLE_NUMBER):
            raise OptionError(f"{name} is {shown(value)}; it must be a whole number {bounds}")
        if value < least or (most is not None and value > most):
            raise OptionError(f"{name} is {value}; it must be {bounds}")


def require_between(
    options: object, above: float, below: float | None, *names: str, unit: str = ""
) -> None:
    """Raise OptionError unless attributes of options are numbers strictly within bounds.

    With None as upper bound infinity is allowed.
    """
    upper = {None: "", inf: " and finite"}.get(below, f" and < {below}")
    bounds = f"> {above}{upper}"
    for name in names:
        value = getattr(options, name)
        if not isinstance(value, NUMBER):
            raise OptionError(f"{name} is {shown(value)}; it must be a number {bounds}")
        if not (value > above and (below is None or value < below)):
            raise OptionError(
                f"{name} is {in_figures(value)}{unit and ' '}{unit}; it must be {bounds}"
            )


def require_kind(options: object, name: str, kind: type) -> None:
    """Raise OptionError unless an option is an instance of a class."""
    value = getattr(options, name)
    if not isinstance(value, kind):
        raise OptionError(f"{name} is {shown(value)}; it must be {kind.__name__}")


# ---- Arguments of public functions: an error says what to give instead of another kind.

_Kind = TypeVar("_Kind")


def checked_options(value: object, kind: type[_Kind], label: str = "options are") -> _Kind:
    """Return options, or the default ones of their class for None."""
    if value is None:
        return kind()
    if not isinstance(value, kind):
        raise OptionError(f"{label} {shown(value)}; give {kind.__name__}")
    return value


def checked_row(name: str, value: object, of: str) -> list[Any]:
    """Return a list, tuple, range or array as a list; messages name its members by a noun."""
    if isinstance(value, np.ndarray) and value.ndim > 0:
        return list(value.tolist())
    if not isinstance(value, list | tuple | range):
        raise OptionError(f"{name} is {shown(value)}; give a list of {of}")
    return list(value)


def require_executor(executor: object) -> None:
    """Raise OptionError unless an executor is None or has a method `submit`."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise OptionError(
            f"executor is {shown(executor)}; give one of concurrent.futures, such as "
            "WorkerProcesses()"
        )


def checked_path(name: str, value: object) -> Path:
    """Return an argument as a path."""
    if not isinstance(value, str | os.PathLike):
        raise OptionError(f"{name} is {shown(value)}; give a path")
    return Path(value)
