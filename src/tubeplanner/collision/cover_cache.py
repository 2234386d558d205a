"""What was computed of meshes before, kept in the user's cache folder.

An entry is named by a hash of all that it was computed from, so that none is ever stale. What
cannot be read or written is computed again: the cache changes times, never answers.
"""

import hashlib
import os
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np

from tubeplanner.arrays import read_only
from tubeplanner.collision.convex_shape import ConvexShape

VARIABLE = "TUBEPLANNER_CACHE"  # a folder, or "off"
# Part of every name: another number, and entries made by other code are not found any more.
_FORMAT = "2"
_UNREADABLE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile)

Arrays = dict[str, np.ndarray]


def cache_folder() -> Path | None:
    """Return the folder of the cache, or None if there is to be none."""
    given = os.environ.get(VARIABLE)
    if given == "off":
        return None
    if given:
        return Path(given)
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA")
    else:
        base = os.environ.get("XDG_CACHE_HOME")
    try:
        default = Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
    except RuntimeError:  # a user without a home
        return Path(base) / "tubeplanner" if base else None
    return (Path(base) if base else default) / "tubeplanner"


def content_hash(parts: Iterable[bytes | str | np.ndarray]) -> str:
    """Return a hash of some contents, arrays by their shape and bits."""
    digest = hashlib.sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            content = f"{part.dtype}{part.shape}".encode() + np.ascontiguousarray(part).tobytes()
        else:
            content = part.encode() if isinstance(part, str) else part
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()


def packed(shapes: Sequence[ConvexShape]) -> Arrays:
    """Return shapes as arrays."""
    return {
        "vertices": np.concatenate([np.zeros((0, 3)), *(shape.vertices for shape in shapes)]),
        "counts": np.array([len(shape.vertices) for shape in shapes], dtype=np.int64),
        "radius": np.array([shape.radius for shape in shapes], dtype=np.float64),
    }


def unpacked(arrays: Mapping[str, np.ndarray]) -> list[ConvexShape]:
    """Return the shapes that `packed` made arrays of."""
    ends = np.cumsum(arrays["counts"])
    parts = np.split(arrays["vertices"], ends[:-1]) if len(ends) else []
    return [
        ConvexShape(read_only(vertices), float(radius))
        for vertices, radius in zip(parts, arrays["radius"], strict=True)
    ]


def cached(kind: str, key: str | None, compute: Callable[[], Mapping[str, np.ndarray]]) -> Arrays:
    """Return some arrays from the cache, or else compute and keep them.

    Args:
        kind: What they are: part of the entry's name.
        key: From `content_hash`, of all that they depend on; None: nothing is kept.
        compute: Computes them.
    """
    folder = cache_folder()
    if folder is None or key is None:
        return dict(compute())
    path = folder / f"{kind}-{_FORMAT}-{key[:40]}.npz"
    found = _read(path)
    if found is None:
        found = dict(compute())
        _write(path, found)
    return found


def _read(path: Path) -> Arrays | None:
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as entry:
            return {name: entry[name] for name in entry.files}
    except _UNREADABLE:
        return None


def _write(path: Path, arrays: Arrays) -> None:
    """Write an entry whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, unfinished = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as file:
                np.savez(file, **arrays)  # type: ignore[arg-type]
            Path(unfinished).replace(path)
        except BaseException:
            Path(unfinished).unlink(missing_ok=True)
            raise
    except OSError:
        return
