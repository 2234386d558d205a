"""Bounds of options: an error names the option, its value and the bounds."""

import math
from math import inf
from typing import Any

import numpy as np

from tubeplanner.errors import OptionError, shown

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
