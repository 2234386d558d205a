"""The files of an answer, written by a command.

Commands hold Ctrl-C back before they draw an answer that took its time. Those whose work is to
draw enter a stage before they write: it raises a Ctrl-C that a library swallowed, and that may have
spoiled what it drew.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Protocol

from tubeplanner.commands.console import say, say_unwritten
from tubeplanner.commands.interrupts import hold_interrupts
from tubeplanner.errors import OptionError
from tubeplanner.files.output_files import write_files

OTHERS_NOT_TRIED = "; interrupted, the others were not tried"


def write_answer(contents: Mapping[Path, bytes], folder: Path | None = None) -> None:
    """Write the files of an answer; from here on, Ctrl-C no longer makes it look interrupted.

    Args:
        contents: As for `write_files`: all are written, or none.
        folder: Likewise.

    Raises:
        OutputError: They could not be written.
    """
    hold_interrupts()
    write_files(contents, folder)


def say_files(written: list[Path], *options: str) -> None:
    """Print the files that were written, each on its line, or which options write some."""
    if written:
        say(*written, sep="\n")
    else:
        say_unwritten(*options)


def require_used(changes: Iterable[str], slack: float | None) -> None:
    """Raise if an objective is set that counts for nothing, as marks are the shortest durations."""
    from tubeplanner.problem.field_paths import is_of_objective

    for path in changes:
        if is_of_objective(path) and slack is None:
            raise OptionError(f"--set {path}: without --slack the shortest motions are planned")


class _Table(Protocol):
    """A result of several plans, such as that of a sweep or of a study."""

    def csv(self) -> str: ...

    def as_dict(self) -> dict[str, Any]: ...


def table_bytes(result: _Table, path: Path) -> bytes:
    """Return a table as its file holds it: CSV or JSON, by the ending."""
    if path.suffix.lower() == ".csv":
        return result.csv().encode()
    return (json.dumps(result.as_dict(), allow_nan=False) + "\n").encode()
