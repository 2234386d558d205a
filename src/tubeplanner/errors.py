"""Exceptions for bad input: one family.

Bad input raises. An impossible task is not an error: `plan` returns a result whose status, message
and place say why.
"""

import difflib
from collections.abc import Iterable


class TubePlannerError(Exception):
    """Base of everything this package raises on purpose."""


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


def unknown_name(kind: str, name: object, known: Iterable[str]) -> str:
    """Return a message for a name that does not exist, listing those that do.

    Args:
        kind: What the name stands for, such as "joint".
        name: The name that was not found.
        known: Every name that would have been accepted.
    """
    names = list(known)
    close = difflib.get_close_matches(str(name), names, n=1)
    hint = f" (did you mean '{close[0]}'?)" if close else ""
    return f"unknown {kind} {name!r}{hint}; there is: {', '.join(names) or 'none'}"
