"""Output files, replaced whole or not at all: all of a run's files, or none of them."""

import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

from tubeplanner.errors import OutputError


def require_writable(outputs: Sequence[Path], inputs: Sequence[Path] = ()) -> None:
    """Raise unless files could be written, before work is spent on their contents.

    Args:
        outputs: Where files are to go.
        inputs: Files that must not be overwritten.

    Raises:
        OutputError: A folder does not exist or cannot be written to, a path is no regular file,
            two outputs are the same file, or an output is an input.
    """
    taken = {path.resolve(): path for path in inputs}
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
            raise OutputError(f"output {path}: the folder {target.parent} does not exist")
        if not os.access(target.parent, os.W_OK):
            raise OutputError(f"output {path}: the folder {target.parent} cannot be written to")


def make_folder(folder: Path) -> None:
    """Make a folder, unless it is there, in one that is.

    Raises:
        OutputError: It cannot be made.
    """
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(f"folder {folder} could not be made: {error.strerror}") from error


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Replace files by new contents; a link's target is replaced, not the link.

    Everything is written beside its target first, so that a full disk leaves all as it was.

    Raises:
        OutputError: A file could not be written. Nothing was changed, unless the system refused to
            rename a file that it had let be written.
    """
    require_writable(list(contents))
    staged: dict[Path, Path] = {}
    try:
        for path, data in contents.items():
            staged[path] = _stage(path, data)
        for path, temporary in staged.items():
            try:
                temporary.replace(_target(path))
            except OSError as error:
                raise OutputError(f"output {path} could not be written: {error}") from error
    finally:
        for temporary in staged.values():
            temporary.unlink(missing_ok=True)


def _stage(path: Path, data: bytes) -> Path:
    """Write data to a new file beside a path's target, with the mode the target has or would."""
    target = _target(path)
    temporary = None
    try:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:60]}.")
        temporary = Path(name)
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        temporary.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())
    except OSError as error:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
        raise OutputError(f"output {path} could not be written: {error.strerror}") from error
    return temporary


def _target(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError) as error:
        raise OutputError(f"output {path} cannot be resolved: {error}") from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
