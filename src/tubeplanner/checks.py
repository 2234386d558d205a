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
    """Return whether a value is a real number; truth values are none."""
    return isinstance(value, NUMBER) and not isinstance(value, bool)


def are_numbers(values: object, count: int) -> bool:
    """Return whether something is a row of so many finite real numbers."""
    is_array = isinstance(values, np.ndarray) and values.ndim == 1
    if not (is_array or isinstance(values, list | tuple)):
        return False
    row: Any = values
    return len(row) == count and all(is_number(one) and is_finite(one) for one in row)


def is_finite(value: Any) -> bool:
    """Return whether a number is one that a float can be: whole numbers may be larger."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def in_figures(value: Any) -> str:
    """Return a number in six digits, and anything else as messages show it."""
    return f"{value:g}" if is_number(value) and is_finite(value) else shown(value)


def require_count(options: object, least: int, *names: str, most: int | None = None) -> None:
    """Raise unless options are whole numbers within bounds.

    Args:
        options: What has the options as attributes.
        least: The lower bound, which is allowed.
        *names: The attributes.
        most: The upper bound, which is allowed; None: there is none.

    Raises:
        OptionError: One is not.
    """
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
    """Raise unless options are numbers within bounds that are not allowed themselves.

    Args:
        options: What has the options as attributes.
        above: The lower bound.
        below: The upper bound; None: infinity is allowed.
        *names: The attributes.
        unit: Of all of them.

    Raises:
        OptionError: One is not.
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


# ---- Arguments of public functions: what is of another kind is refused, with what to give instead.

_Kind = TypeVar("_Kind")


def given_options(given: object, kind: type[_Kind], called: str = "options are") -> _Kind:
    """Return options, those that a class has by default if none are given.

    Args:
        given: They, or None.
        kind: Their class.
        called: What messages begin with.

    Raises:
        OptionError: They are of another kind.
    """
    if given is None:
        return kind()
    if not isinstance(given, kind):
        raise OptionError(f"{called} {shown(given)}; give {kind.__name__}")
    return given


def given_row(name: str, given: object, of: str) -> list[Any]:
    """Return a list, a tuple or an array as a list.

    Args:
        name: What messages call it.
        given: It.
        of: Of what, in words.

    Raises:
        OptionError: It is none.
    """
    is_row = isinstance(given, list | tuple | range)
    if isinstance(given, np.ndarray) and given.ndim > 0:
        return list(given.tolist())
    if not is_row:
        raise OptionError(f"{name} is {shown(given)}; give a list of {of}")
    return list(given)  # type: ignore[call-overload]  # a list, tuple or range


def require_executor(executor: object) -> None:
    """Raise OptionError unless an executor is None or one."""
    if executor is not None and not callable(getattr(executor, "submit", None)):
        raise OptionError(
            f"executor is {shown(executor)}; give one of concurrent.futures, such as "
            "WorkerProcesses()"
        )


def given_path(name: str, given: object) -> Path:
    """Return a path; messages call it by a name.

    Raises:
        OptionError: It is neither text nor a path.
    """
    if not isinstance(given, str | os.PathLike):
        raise OptionError(f"{name} is {shown(given)}; give a path")
    return Path(given)
