"""Arguments of public functions: what is of another kind is refused, with what to give instead."""

import os
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from tubeplanner.errors import OptionError, shown

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
