"""Covers and hulls of earlier runs, in the user's cache folder.

The name of an entry has a hash of all that it was computed from, so that no entry is ever stale; an
entry begins with a hash of its name and content, so that a damaged entry is never used. An entry
that cannot be read or written is computed again: the cache changes times, never answers.
"""

import hashlib
import io
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import platformdirs

from tubeplanner import __version__
from tubeplanner.arrays import read_only
from tubeplanner.geometry.convex_shapes import ConvexShape
from tubeplanner.writing import StagedFile, signals_held

VARIABLE = "TUBEPLANNER_CACHE"  # a folder, or "off"
# Part of every name: with another number, entries made by other code are not found any more.
_FORMAT = f"{__version__}-4"
_DIGEST_SIZE = hashlib.sha256().digest_size

Arrays = dict[str, np.ndarray]


def cache_folder() -> Path | None:
    """Return the folder of the cache, or None without a cache."""
    variable = os.environ.get(VARIABLE)
    if variable == "off":
        return None
    if variable:
        return Path(variable)
    folder = platformdirs.user_cache_path("tubeplanner", appauthor=False)
    return folder if folder.is_absolute() else None  # of a user without a home, it begins with ~


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
    """Return shapes as arrays, with their faces, so that no hull is computed again."""
    no_faces = np.zeros((0, 3), dtype=np.int64)
    return {
        "vertices": np.concatenate([np.zeros((0, 3)), *(shape.vertices for shape in shapes)]),
        "counts": np.array([len(shape.vertices) for shape in shapes], dtype=np.int64),
        "faces": np.concatenate([no_faces, *(shape.faces for shape in shapes)]),
        "face_counts": np.array([len(shape.faces) for shape in shapes], dtype=np.int64),
        "radius": np.array([shape.radius for shape in shapes], dtype=np.float64),
    }


def unpacked(arrays: Mapping[str, np.ndarray]) -> list[ConvexShape]:
    """Return the shapes of arrays made by `packed`."""
    parts = (
        _parts(arrays["vertices"], arrays["counts"]),
        _parts(arrays["faces"], arrays["face_counts"]),
        arrays["radius"],
    )
    return [
        ConvexShape(read_only(vertices), float(radius), faces)
        for vertices, faces, radius in zip(*parts, strict=True)
    ]


def cached(kind: str, key: str | None, compute: Callable[[], Mapping[str, np.ndarray]]) -> Arrays:
    """Return arrays from the cache, or compute and store the arrays.

    Args:
        kind: Kind of the arrays: part of the entry's name.
        key: From `content_hash`, of all that they depend on; None: nothing is stored.
        compute: Computes the arrays.
    """
    folder = cache_folder()
    if folder is None or key is None:
        return dict(compute())
    path = folder / f"{kind}-{_FORMAT}-{key[:40]}"
    arrays = _read(path)
    if arrays is None:
        arrays = dict(compute())
        _write(path, arrays)
    return arrays


def _parts(rows: np.ndarray, counts: np.ndarray) -> list[np.ndarray]:
    return np.split(rows, np.cumsum(counts)[:-1]) if len(counts) else []


def _digest(path: Path, content: bytes) -> bytes:
    return hashlib.sha256(path.name.encode() + content).digest()


def _read(path: Path) -> Arrays | None:
    try:
        entry = path.read_bytes()
    except OSError:
        return None
    digest, content = entry[:_DIGEST_SIZE], entry[_DIGEST_SIZE:]
    if digest != _digest(path, content):
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def _write(path: Path, arrays: Arrays) -> None:
    """Write an entry whole or not at all."""
    content = io.BytesIO()
    np.savez(content, **arrays)  # type: ignore[arg-type]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with signals_held(), StagedFile(path) as file:
            file.write(_digest(path, content.getvalue()) + content.getvalue())
            file.put()
    except OSError:
        return
