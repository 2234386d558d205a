"""Exceptions for bad input, one family; wrong values in messages; former names. No NumPy.

Bad input raises. An impossible task is not an error: `plan` returns a result whose status, message
and location say why.
"""

import copy
import difflib
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

# ---- Exceptions for bad input: one family.

MAX_SHOWN = 60  # [characters] of a value in a message


class TubePlannerError(Exception):
    """Base of everything this package raises on purpose."""

    def __init__(self, message: str) -> None:
        """Keep a message; control characters in its names and paths become codes."""
        super().__init__(on_one_line(message))

    def within(self, source: str) -> Self:
        """Return a copy whose message begins with its source."""
        result = copy.copy(self)
        result.args = (on_one_line(f"{source}: {self}"),)
        return result


class RobotError(TubePlannerError):
    """The robot description cannot be used: file, joint, link, limit or mesh is named."""


class ProblemError(TubePlannerError):
    """The planning problem contradicts itself or its robot: the field is named."""


class TrajectoryError(TubePlannerError):
    """The trajectory or its file cannot be used: the field is named."""


class OptionError(TubePlannerError):
    """An option has a value outside its range."""


class OutputError(TubePlannerError):
    """An output file could not be written; what was there before is untouched."""


@contextmanager
def faults_of(
    field: str, *kinds: type[Exception], error: type[TubePlannerError] = ProblemError
) -> Iterator[None]:
    """Raise errors of some kinds as those of a field: its name, then their message."""
    try:
        yield
    except kinds as reason:
        raise error(f"{field}: {reason}") from None


def shown(value: object, most: int = MAX_SHOWN) -> str:
    """Return the text of a value for a message: printable, cut after `most` characters."""
    if isinstance(value, str | bytes | list | tuple):
        value = value[: most + 1]  # the representation of a long row takes long
    try:
        text = repr(value)
    except ValueError:  # Python writes no whole number of more than 4300 digits
        text = f"a {type(value).__name__} too long to write"
    text = on_one_line(text[: most + 1])
    return text if len(text) <= most else text[:most] + "..."


def on_one_line(text: str) -> str:
    """Return a text without line breaks, control characters replaced by their codes."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def unknown_name(kind: str, name: object, known: Iterable[str]) -> str:
    """Return a message for a name that does not exist, with the names that exist.

    Args:
        kind: Noun for the name, such as "joint".
        name: The unknown name.
        known: Every valid name.
    """
    names = list(known)
    word = name[: 2 * MAX_SHOWN] if isinstance(name, str) else shown(name)
    close = difflib.get_close_matches(word, names, n=1)
    hint = f" (did you mean '{close[0]}'?)" if close else ""
    return f"unknown {kind} {shown(name)}{hint}; there is: {', '.join(names) or 'none'}"


# ---- Libraries that only some commands need.

# By the name of the extra in pyproject.toml.
REQUIREMENTS = {
    "compare": "toppra>=0.6.3",
    "dask": "distributed>=2024.1",
    "dxf": "ezdxf>=1.3",
    "meshes": "trimesh[easy]>=5.0",
    "simulate": "mujoco>=3.2.7",
    "xacro": "xacro>=2.1",
}


def not_installed(extra: str, what: str, library: str) -> str:
    """Return a message for a missing library, with the command that installs the library.

    In a checkout the command installs the extra, editable: without `-e` pip would replace the
    checkout by a copy. Elsewhere it installs the library: this package is in no registry.

    Args:
        extra: Extra that brings the library, a key of `REQUIREMENTS`.
        what: Feature that needs the library.
        library: Name of the library in the message.
    """
    checkout = Path(__file__).resolve().parents[2]
    if (checkout / "pyproject.toml").is_file():
        remedy = f"pip install -e '.[{extra}]' in {checkout}"
    else:
        remedy = f"pip install '{REQUIREMENTS[extra]}'"
    return f"{what} takes {library}, which is not installed: {remedy}"


# ---- Former public names: read as the present ones, with one DeprecationWarning each.

_warned: set[str] = set()


class FormerName:
    """A former name of an attribute: its value is that of the present name."""

    def __init__(self, name: str) -> None:
        """Take the present name of the attribute."""
        self._name = name

    def __set_name__(self, owner: type, name: str) -> None:
        self._former = f"{owner.__name__}.{name}"

    def __get__(self, instance: object, owner: type | None = None) -> Any:
        if instance is None:
            return self
        warn_of_former_name(self._former, self._name)
        return getattr(instance, self._name)


def warn_of_former_name(former: str, name: str) -> None:
    """Warn of a former name at its first use in a process."""
    if former not in _warned:
        _warned.add(former)
        warnings.warn(f"{former} is called {name} now", DeprecationWarning, stacklevel=3)
