"""Files written whole or not at all: staged content, held signals, all files of a run at once."""

import errno
import hashlib
import os
import signal
import stat
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from importlib import import_module
from pathlib import Path

from tubeplanner.errors import OptionError, OutputError


@contextmanager
def signals_held() -> Iterator[None]:
    """Hold SIGINT and SIGTERM until the end, where they are raised again.

    Outside the main thread nothing is held: Python raises no KeyboardInterrupt there.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pending: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        for number in before:
            signal.signal(number, lambda number, _: pending.append(number))
        yield
    finally:
        # SIGINT last: once restored, it may raise at once, and no other handler is then missing.
        for number, handler in reversed(before.items()):
            # None: the program that embeds Python set the handler; Python cannot restore it.
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        for pending_signal in pending:
            signal.raise_signal(pending_signal)


# ---- New content of a file, staged beside the file.
#
# A process that is killed leaves at most `.NAME.tmp` beside the file NAME; the next writer of NAME
# removes it. A lock tells the file of a killed process from that of another live one.

_IS_WINDOWS = os.name == "nt"  # there an open file can be neither replaced nor removed
_MAX_NAME_LENGTH = 255  # [bytes], of a file in its folder
_LOCKED_BYTE = 2**31 - 2  # on Windows
_PATIENCE, _PAUSE = 5.0, 0.01  # with another process that writes the same file [s]


class StagedFile:
    """A file `.NAME.tmp` that replaces the file NAME, or is removed.

    For use in a `with` statement inside `signals_held`, where Ctrl-C does not come.
    """

    def __init__(self, target: Path) -> None:
        """Make the staged file, empty, and readable for its owner alone."""
        self._target, self._path = target, temporary_path(target)
        self._descriptor: int | None = _new_file(self._path)
        self._is_put = False

    def __enter__(self) -> "StagedFile":
        return self

    def __exit__(self, *exception: object) -> None:
        """Remove the staged file unless the target is replaced."""
        if not self._is_put:
            self._leave(lambda: self._path.unlink(missing_ok=True))

    def write(self, data: bytes, mode: int | None = None) -> None:
        """Write the content, and set the mode unless None."""
        assert self._descriptor is not None
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._descriptor, rest) :]
        if mode is not None and os.chmod in os.supports_fd:  # not on Windows
            os.chmod(self._descriptor, mode)

    def sync(self) -> None:
        """Wait until the content is on the disk."""
        assert self._descriptor is not None
        os.fsync(self._descriptor)

    def put(self) -> None:
        """Replace the target."""
        self._leave(lambda: self._path.replace(self._target))
        self._is_put = True

    def _leave(self, move: Callable[[], object]) -> None:
        if not _IS_WINDOWS:
            move()
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
        if _IS_WINDOWS:
            move()


def temporary_path(target: Path) -> Path:
    """Return the path of the staged file of a target."""
    name = f".{target.name}.tmp"
    if len(os.fsencode(name)) > _MAX_NAME_LENGTH:
        name = f".{hashlib.sha256(os.fsencode(target.name)).hexdigest()}.tmp"
    return target.with_name(name)


def _new_file(path: Path) -> int:
    """Return the descriptor of a new, locked file; the file of a killed process is removed."""
    end = time.monotonic() + _PATIENCE
    while True:
        try:
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
            descriptor = os.open(path, flags, 0o600)
        except FileExistsError:
            _remove_left(path, end)
            continue
        # Another process may have removed the file before it was locked.
        if _IS_WINDOWS or (_locked(descriptor) and _is_at(path, descriptor)):
            return descriptor
        os.close(descriptor)


def _remove_left(path: Path, end: float) -> None:
    """Remove the file of a killed process; while a live process has the file, pause until `end`."""
    if _IS_WINDOWS:
        with suppress(PermissionError):  # a live process has it open
            path.unlink(missing_ok=True)
            return
    else:
        flags = [getattr(os, name) for name in ("O_NOFOLLOW", "O_NONBLOCK")]
        try:
            descriptor = os.open(path, os.O_RDONLY | sum(flags))
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
    """Return True if a file could be locked, or its file system has no locks."""
    with suppress(OSError):
        return lock(descriptor)
    return True


def lock(descriptor: int) -> bool:
    """Lock a file until it is closed; return False if another process has locked it.

    Raises:
        OSError: Its file system has no locks.
    """
    try:
        fcntl = import_module("fcntl")
    except ImportError:  # Windows, where a locked byte cannot be read: it is one far behind the end
        msvcrt, position = import_module("msvcrt"), os.lseek(descriptor, 0, os.SEEK_CUR)
        os.lseek(descriptor, _LOCKED_BYTE, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except PermissionError:
            return False
        finally:
            os.lseek(descriptor, position, os.SEEK_SET)
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _is_at(path: Path, descriptor: int) -> bool:
    """Return True if a path leads to an open file."""
    try:
        return os.path.samestat(os.lstat(path), os.fstat(descriptor))
    except FileNotFoundError:
        return False


# ---- Output files: all files of a run are replaced, or none.

_REMEDY_FOR_FULL_DISK = "; make room, or name a file on another disk"
_REMEDIES = {
    errno.ENOSPC: _REMEDY_FOR_FULL_DISK,
    errno.EDQUOT: _REMEDY_FOR_FULL_DISK,
    errno.EFBIG: "; raise the limit of file sizes (`ulimit -f`)",
    errno.EBUSY: "; wait for it, or name another file",
}


def require_writable(outputs: Sequence[Path], inputs: Sequence[Path] = ()) -> None:
    """Raise unless files can be written, before work is spent on their contents."""
    targets = {_target(path, "input"): path for path in inputs}
    for path in outputs:
        target = _target(path)
        if target in targets:
            raise OutputError(
                f"output {path} is the same file as {targets[target]}; choose another"
            )
        targets[target] = path
        try:
            is_special = not stat.S_ISREG(target.stat().st_mode)
        except (FileNotFoundError, NotADirectoryError):
            is_special = False
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


def require_ending(path: Path | None, option: str, endings: Sequence[str]) -> None:
    """Raise OptionError unless an output file's name, if any, has one of the endings, if any."""
    if path is not None and endings and path.suffix.lower() not in endings:
        *others, last = endings
        listed = f"{', '.join(others)} or {last}" if others else last
        raise OptionError(f"{option} {path}: name a file that ends in {listed}")


def write_files(contents: Mapping[Path, bytes], folder: Path | None = None) -> None:
    """Replace files by new contents; a link's target is replaced, not the link.

    All files are staged beside their targets first, so that a full disk changes nothing. Ctrl-C and
    SIGTERM wait until the files are replaced.

    Args:
        contents: New content of each file.
        folder: Is made first unless it exists, in an existing one; None: no folder is made.
    """
    with signals_held(), ExitStack() as undo:
        if folder is not None:
            _make_folder(folder, undo)
        require_writable(list(contents))
        staged: dict[Path, StagedFile] = {}
        # In one order for all processes, so that no two wait for each other.
        for path in sorted(contents, key=_target):
            with _named(path):
                staged[path] = file = undo.enter_context(StagedFile(_target(path)))
                file.write(contents[path], _mode(_target(path)))
                file.sync()
        for path, file in staged.items():
            with _named(path):
                file.put()
        undo.pop_all()  # nothing to undo


def _make_folder(folder: Path, undo: ExitStack) -> None:
    """Make a missing folder; undoing removes the folder while empty."""

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
    """Turn an OSError into an OutputError that names the output and a remedy."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"output {path} could not be written: {error.strerror}{_remedy(error)}"
        ) from error


def _remedy(error: OSError) -> str:
    return _REMEDIES.get(error.errno or 0, "; name a file in another folder")


def _mode(target: Path) -> int:
    """Return the mode of a file: its own, or that of a new file."""
    if target.exists():
        return target.stat().st_mode & 0o777
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def _target(path: Path, kind: str = "output") -> Path:
    try:
        target = path.resolve()
        if os.path.islink(target):  # Python 3.13 resolves up to the circle, and says nothing
            raise OSError("its symbolic links lead in a circle")
        return target
    except (OSError, RuntimeError, ValueError) as error:
        raise OutputError(f"{kind} {path} cannot be resolved: {error}") from error
