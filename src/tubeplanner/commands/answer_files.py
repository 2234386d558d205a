"""The files of an answer, written by a command.

Commands hold Ctrl-C back before they draw an answer that took its time. Those whose work is to
draw enter a stage before they write: it raises a Ctrl-C that a library swallowed, and that may have
spoiled what it drew.
"""

from collections.abc import Mapping
from pathlib import Path

from tubeplanner.commands.interrupts import hold_interrupts


def write_answer(contents: Mapping[Path, bytes], folder: Path | None = None) -> None:
    """Write the files of an answer; from here on, Ctrl-C no longer makes it look interrupted.

    Args:
        contents: As for `write_files`: all are written, or none.
        folder: Likewise.

    Raises:
        OutputError: They could not be written.
    """
    from tubeplanner.files.output_files import write_files

    hold_interrupts()
    write_files(contents, folder)
