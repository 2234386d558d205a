"""Files written whole or not at all: staged content, held signals, all files of a run at once."""

import errno
import fcntl
import hashlib
import os
import signal
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from errno import EBUSY, EDQUOT, EFBIG, ENOSPC
from pathlib import Path
from types import TracebackType

from tubeplanner.errors import OutputError

# ---- Ctrl-C and SIGTERM, kept waiting while something is done that has no half.


@contextmanager
def signals_held() -> Iterator[None]:
    """Let SIGINT and SIGTERM wait until the end, where they are raised again.

    Outside the main thread nothing is held: Python raises no KeyboardInterrupt there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        for number in before:
            signal.signal(number, lambda which, _: came.append(which))
        yield
    finally:
        # SIGINT last: the moment it is let through, nothing is left to be put back.
        for number, handler in reversed(before.items()):
            # None: whoever embeds Python handles it, and Python cannot hand it back.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        for which in came:
            signal.raise_signal(which)


# ---- New content of a file, beside it until it is put in its place.
#
# A process that is killed leaves at most `.NAME.tmp` beside the file NAME; whoever next writes NAME
# removes it. A lock tells what was left from what another process is about to put in its place.

_LONGEST_NAME = 255  # [bytes], of a file in its folder
_PATIENCE, _PAUSE = 5.0, 0.01  # with another process that writes the same file [s]


class StagedFile:
    """A file `.NAME.tmp` that takes the place of the file NAME, or is removed.

    To be used in a `with` statement, where Ctrl-C does not come: within `signals_held`.
    """

    def __init__(self, target: Path) -> None:
        """Make it, empty, and readable for its owner alone.

        Args:
            target: The file whose place it takes; no link.

        Raises:
            OSError: It cannot be made, or another process is writing the same file, and goes on.
        """
        self._target, self._path = target, temporary_path(target)
        self._descriptor: int | None = _new_file(self._path)

    def __enter__(self) -> "StagedFile":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Remove it, unless it was put in its place."""
        if self._descriptor is not None:
            self._path.unlink(missing_ok=True)
            self._close()

    def write(self, data: bytes, mode: int | None = None) -> None:
        """Write its content, and set its mode if one is given.

        Raises:
            OSError: It cannot be written.
        """
        assert self._descriptor is not None
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._descriptor, rest) :]
        if mode is not None:
            os.fchmod(self._descriptor, mode)

    def sync(self) -> None:
        """Wait until it is on the disk.

        Raises:
            OSError: It does not get there, as where a disk tells only now that it is full.
        """
        assert self._descriptor is not None
        os.fsync(self._descriptor)

    def put(self) -> None:
        """Put it in its place.

        Raises:
            OSError: The system refuses.
        """
        self._path.replace(self._target)
        self._close()

    def _close(self) -> None:
        assert self._descriptor is not None
        os.close(self._descriptor)
        self._descriptor = None


def temporary_path(target: Path) -> Path:
    """Return where the new content of a file is written."""
    name = f".{target.name}.tmp"
    if len(os.fsencode(name)) > _LONGEST_NAME:
        name = f".{hashlib.sha256(os.fsencode(target.name)).hexdigest()}.tmp"
    return target.with_name(name)


def _new_file(path: Path) -> int:
    """Return the descriptor of a new file that is locked; what was left under its name goes."""
    end = time.monotonic() + _PATIENCE
    while True:
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        except FileExistsError:
            _remove_left(path, end)
            continue
        # Whoever met it before it was locked may have removed it.
        if _locked(descriptor) and _is_at(path, descriptor):
            return descriptor
        os.close(descriptor)


def _remove_left(path: Path, end: float) -> None:
    """Remove what a killed process left; wait a while for one that lives."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except FileNotFoundError:
        return
    try:
        if _locked(descriptor):
            if _is_at(path, descriptor):
                path.unlink()
            return
    finally:
        os.close(descriptor)
    if time.monotonic() > end:
        raise OSError(errno.EBUSY, "another process is writing it", str(path))
    time.sleep(_PAUSE)


def _locked(descriptor: int) -> bool:
    """Return whether a file could be locked; file systems without locks are taken at their word."""
    with suppress(OSError):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def _is_at(path: Path, descriptor: int) -> bool:
    """Return whether an open file is what a path leads to."""
    try:
        return os.path.samestat(os.lstat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


# ---- Output files, replaced whole or not at all: all of a run's files, or none of them.

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
