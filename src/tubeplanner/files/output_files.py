"""Output files, replaced whole or not at all: all of a run's files, or none of them."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from errno import EBUSY, EDQUOT, EFBIG, ENOSPC
from pathlib import Path

from tubeplanner.errors import OutputError
from tubeplanner.held_signals import signals_held
from tubeplanner.staged_file import StagedFile

_ROOM = "; make room, or name a file on another disk"
_REMEDIES = {
    ENOSPC: _ROOM,
    EDQUOT: _ROOM,
    EFBIG: "; raise the limit of file sizes (`ulimit -f`)",
    EBUSY: "; wait for it, or name another file",
}


def require_writable(outputs: Sequence[Path], inputs: Sequence[Path] = ()) -> None:
    """Raise unless files could be written, before work is spent on their contents.

    Args:
        outputs: Where files are to go.
        inputs: Files that must not be overwritten.

    Raises:
        OutputError: A folder does not exist or cannot be written to, a path is no regular file,
            two outputs are the same file, or an output is an input.
    """
    taken = {_target(path, "input"): path for path in inputs}
    for path in outputs:
        target = _target(path)
        if target in taken:
            raise OutputError(f"output {path} is the same file as {taken[target]}; choose another")
        taken[target] = path
        try:
            is_special = target.exists() and not target.is_file()
        except OSError as error:
            raise OutputError(f"output {path!s:.60}: {error.strerror}") from error
        if is_special:
            raise OutputError(f"output {path} is no regular file; name one")
        if not target.parent.is_dir():
            raise OutputError(f"output {path}: the folder {target.parent} does not exist; make it")
        if not os.access(target.parent, os.W_OK):
            raise OutputError(
                f"output {path}: the folder {target.parent} cannot be written to; name a file in "
                "another folder"
            )


def write_files(contents: Mapping[Path, bytes], folder: Path | None = None) -> None:
    """Replace files by new contents; a link's target is replaced, not the link.

    Everything is written beside its target first, so that a full disk leaves all as it was. Ctrl-C
    and SIGTERM wait until the files are there.

    Args:
        contents: What belongs into the files.
        folder: Is made first, unless it is there, in one that is; None: every folder is there.

    Raises:
        OutputError: A file could not be written. Nothing was changed, unless the system refused to
            rename a file that it had let be written.
    """
    with signals_held(), ExitStack() as undo:
        if folder is not None:
            _make_folder(folder, undo)
        require_writable(list(contents))
        staged: dict[Path, StagedFile] = {}
        # Always in one order, so that no two processes wait for each other.
        for path in sorted(contents, key=_target):
            with _named(path):
                staged[path] = file = undo.enter_context(StagedFile(_target(path)))
                file.write(contents[path], _mode(_target(path)))
                file.sync()
        for path, file in staged.items():
            with _named(path):
                file.put()
        undo.pop_all()  # nothing is to be undone


def _make_folder(folder: Path, undo: ExitStack) -> None:
    """Make a folder unless it is there; undone, it is removed if nothing was put into it."""

    def remove() -> None:
        with suppress(OSError):
            folder.rmdir()

    try:
        folder.mkdir()
    except FileExistsError:
        return
    except OSError as error:
        raise OutputError(
            f"folder {folder} could not be made: {error.strerror}{_remedy(error)}"
        ) from error
    undo.callback(remove)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Turn what the system refuses into an error that names the output and a remedy."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"output {path} could not be written: {error.strerror}{_remedy(error)}"
        ) from error


def _remedy(error: OSError) -> str:
    return _REMEDIES.get(error.errno or 0, "; name a file in another folder")


def _mode(target: Path) -> int:
    """Return the mode that a file has, or would have."""
    return target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask()


def _target(path: Path, kind: str = "output") -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError) as error:
        raise OutputError(f"{kind} {path} cannot be resolved: {error}") from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
