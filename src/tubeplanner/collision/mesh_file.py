"""Mesh files as solids and as covers; what covers cost is paid once, see `cover_cache`."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.collision.cover_cache import cached, content_hash, packed, unpacked
from tubeplanner.collision.cover_error import cover_error
from tubeplanner.collision.fine_cover import OUTER_ERROR, Cover, fine_cover
from tubeplanner.collision.mesh_bounds import mesh_bytes
from tubeplanner.collision.mesh_cover import cover_mesh, load_mesh, slab_cuts
from tubeplanner.collision.mesh_solid import MeshSolid
from tubeplanner.documents import DocumentError

# Each shape of one link is checked against each of another: fewer than for obstacles. Both links of
# a pair have a cover: each may stand off half as much [m].
_LINK_PIECES = 32
_LINK_ERROR = OUTER_ERROR / 2
# Formats whose files hold all of the mesh: only these are cached.
_SELF_CONTAINED = {".stl", ".obj", ".dae", ".ply", ".off", ".glb", ".3mf"}


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh file that belongs to a link or an obstacle.

    Attributes:
        owner: What messages call whom it belongs to.
        path: STL, OBJ, DAE or another format that trimesh reads.
        scale: One factor, or one per axis; None: 1.

    Everything raises RobotError if the file is no readable mesh.
    """

    owner: str
    path: Path
    scale: float | Sequence[float] | None = None

    @cached_property
    def key(self) -> str | None:
        """A hash of the file's content and the scale; None if that is not all of the mesh."""
        if self.path.suffix.lower() not in _SELF_CONTAINED:
            return None
        try:
            content = mesh_bytes(self.path)
        except DocumentError:
            return None  # reading the mesh says what is wrong
        scale = np.array([1.0 if self.scale is None else self.scale], dtype=np.float64)
        return content_hash([content, self.path.suffix.lower(), scale])

    @cached_property
    def solid(self) -> MeshSolid:
        """The triangles, scaled."""
        faces = np.asarray(self._mesh.faces, dtype=np.int64)
        return MeshSolid(np.asarray(self._mesh.vertices), faces)

    def cover(self) -> list[ConvexShape]:
        """Return few shapes that cover the mesh, for where nothing comes near."""
        return unpacked(cached("cover", self.key, lambda: packed(cover_mesh(self._mesh))))

    def outer_error(self) -> float:
        """Return the largest distance found from the surface of `cover` to the mesh [m]."""

        def measured() -> dict[str, np.ndarray]:
            return {"error": np.array(cover_error(self.solid, self.cover()))}

        return float(cached("error", self.key, measured)["error"])

    def close_cover(self) -> list[ConvexShape]:
        """Return shapes that stand off the mesh by 2 mm, or as little as 64 shapes allow."""
        return unpacked(cached("close", self.key, lambda: packed(self._close_cover())))

    def fine_cover(self, probes: FloatArray) -> Cover:
        """Return shapes that cover the mesh closely where probes, shape (N, 3) [m], come near."""
        return fine_cover(
            self.solid,
            probes,
            cuts=slab_cuts(self._mesh),
            outer_error=_LINK_ERROR,
            max_pieces=_LINK_PIECES,
        )

    def _close_cover(self) -> Sequence[ConvexShape]:
        cover = cover_mesh(self._mesh)
        error = cover_error(self.solid, cover)
        if error <= OUTER_ERROR:
            return cover
        finer = fine_cover(self.solid)
        return finer.shapes if finer.outer_error < error else cover

    @cached_property
    def _mesh(self) -> Any:
        return load_mesh(self.owner, self.path, self.scale)
