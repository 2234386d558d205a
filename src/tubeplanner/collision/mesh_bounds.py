"""Bounds for mesh files, and for the files that they name: regular ones of some size.

Readers of meshes open whatever a mesh names, materials and textures, also what never ends.
"""

from pathlib import Path
from typing import TYPE_CHECKING

from tubeplanner.documents import read_bytes, require_regular

if TYPE_CHECKING:
    from trimesh.resolvers import FilePathResolver

_MAX_BYTES = 200_000_000  # four million triangles


def mesh_bytes(path: Path) -> bytes:
    """Return a mesh file's contents.

    Raises:
        DocumentError: It cannot be read, is no regular file, or is too large.
    """
    return read_bytes(path, _MAX_BYTES)


def files_beside(path: Path) -> "FilePathResolver":
    """Return what opens the files that a mesh file names, within bounds.

    Raises:
        DocumentError: The mesh file itself is not within bounds.
    """
    from trimesh.resolvers import FilePathResolver

    class Bounded(FilePathResolver):
        def absolute(self, name: str) -> Path:
            found: Path = super().absolute(name)
            if found.exists():
                require_regular(found, _MAX_BYTES)
            return found

    require_regular(path, _MAX_BYTES)
    return Bounded(str(path))
