"""New content of a file, beside it until it is put in its place.

A process that is killed leaves at most `.NAME.tmp` beside the file NAME; whoever next writes NAME
removes it. A lock tells what was left from what another process is about to put in its place.
"""

import errno
import fcntl
import hashlib
import os
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType

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
