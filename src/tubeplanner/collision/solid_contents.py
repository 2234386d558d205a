"""What a solid was made from, whatever convex shapes cover it: the same for every cover."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tubeplanner.arrays import FloatArray, read_only


@dataclass(frozen=True, eq=False)
class SolidContents:
    """One solid as it was given. It pickles by content, without any file.

    Attributes:
        kind: "box", "sphere", "cylinder", "capsule" or "mesh".
        sizes: Side lengths, radius, or radius and length [m]; of a mesh its scale along each axis.
        placement: Where it is in the frame it was given in, shape (4, 4).
        mesh_hash: Of the bytes of its mesh file; empty for other kinds.
        path: The mesh file, which need not exist any more; None for other kinds.
    """

    kind: str
    sizes: tuple[float, ...]
    placement: FloatArray
    mesh_hash: str = ""
    path: Path | None = None


def simple_contents(kind: str, sizes: Iterable[float], placement: FloatArray) -> SolidContents:
    """Return the contents of a solid of a simple kind, its sizes [m] in a placement (4, 4)."""
    return SolidContents(kind, tuple(float(size) for size in sizes), read_only(placement))


def mesh_contents(path: Path, scale: Iterable[float], placement: FloatArray) -> SolidContents:
    """Return the contents of a mesh file, scaled along each axis, in a placement (4, 4).

    Raises:
        OSError: The file cannot be read.
    """
    mesh_hash = hashlib.sha256(path.read_bytes()).hexdigest()
    factors = tuple(float(factor) for factor in scale)
    return SolidContents("mesh", factors, read_only(placement), mesh_hash, path)
