"""Closer covers of concave meshes: pieces are cut in two until none stands off the surface."""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.collision.mesh_piece import MeshPiece
from tubeplanner.collision.mesh_solid import MeshSolid

OUTER_ERROR = 2e-3  # [m] that a cover may stand off its mesh where it matters
MAX_PIECES = 64
# A piece matters if what must stay clear of it is in it, or this near [m]: as much as it is farther
# in than that.
_NEAR = 5e-3
_MAX_PROBES = 1500  # kept of those near a piece
# Points on its cuts at which a piece's distance from the surface is measured: at first, and before
# it is taken to be close.
_FEW_SAMPLES, _MANY_SAMPLES = 12, 100
_SEED = 0


@dataclass(frozen=True, eq=False)
class Cover:
    """Convex shapes that together contain a solid.

    Attributes:
        shapes: In the solid's frame.
        outer_error: The largest distance found from their surface to the solid's, where it matters
            [m].
    """

    shapes: tuple[ConvexShape, ...]
    outer_error: float


@dataclass(order=True)
class _Piece:
    """A piece and what it is worth to cut it: the piece that stands off most comes first.

    Attributes:
        rank: Minus the distance that it stands off, where that matters [m], and a running number.
        piece: The piece.
        probes: Those near it, shape (N, 3) [m].
        matters: At most so much of its distance matters [m].
    """

    rank: tuple[float, int]
    piece: MeshPiece = field(compare=False)
    probes: FloatArray | None = field(compare=False)
    matters: float = field(compare=False)

    @property
    def error(self) -> float:
        return -self.rank[0]


def fine_cover(
    solid: MeshSolid,
    probes: FloatArray | None = None,
    *,
    cuts: Sequence[tuple[int, float]] = (),
    outer_error: float = OUTER_ERROR,
    max_pieces: int = MAX_PIECES,
) -> Cover:
    """Return a close cover of a solid.

    Args:
        solid: With triangles.
        probes: Points that the cover should leave out, outside of the solid, shape (N, 3) [m]; only
            pieces with some of them in or near them are cut. None: all pieces matter.
        cuts: Made in any case: axis and coordinate [m].
        outer_error: Pieces that stand off less are not cut [m].
        max_pieces: At most so many shapes.
    """
    search = _Search(solid)
    for piece in search.beginning(cuts):
        search.add(piece, probes)
    while search.waiting and search.count < max_pieces:
        worst = heapq.heappop(search.waiting)
        if worst.error <= outer_error:
            worst = search.looked_at_closely(worst)
        parts = worst.piece.cut() if worst.error > outer_error else None
        if parts is None:
            search.done.append(worst)
            continue
        for part in parts:
            search.add(part, worst.probes)
    return search.cover()


class _Search:
    """The pieces so far: those that may be cut, the worst first, and those that are done."""

    def __init__(self, solid: MeshSolid) -> None:
        self._solid, self._rng = solid, np.random.default_rng(_SEED)
        self._made = 0
        self.waiting: list[_Piece] = []
        self.done: list[_Piece] = []

    @property
    def count(self) -> int:
        return len(self.waiting) + len(self.done)

    def beginning(self, cuts: Sequence[tuple[int, float]]) -> list[MeshPiece]:
        """Return the solid in pieces, cut at planes."""
        everywhere = np.full(3, np.inf)
        whole = MeshPiece(self._solid.triangles, -everywhere, everywhere, self._solid.contains)
        pieces = [whole]
        for axis, height in cuts:
            parts = [
                piece.part(axis, height, below=below) for piece in pieces for below in (True, False)
            ]
            pieces = [part for part in parts if not part.is_empty]
        return pieces

    def add(self, piece: MeshPiece, probes: FloatArray | None) -> None:
        """Add a piece; of the probes, those in or near it matter."""
        matters = np.inf
        if probes is not None:
            outside = piece.outside(probes)
            matters = _NEAR - float(outside.min(initial=_NEAR))
            probes = probes[outside < _NEAR]
            if len(probes) > _MAX_PROBES:
                probes = self._rng.choice(probes, _MAX_PROBES, replace=False)
        error = self._standoff(piece, matters, _FEW_SAMPLES)
        heapq.heappush(self.waiting, _Piece((-error, self._made), piece, probes, matters))
        self._made += 1

    def looked_at_closely(self, found: _Piece) -> _Piece:
        """Return a piece with the distance that it stands off measured at more points."""
        error = max(found.error, self._standoff(found.piece, found.matters, _MANY_SAMPLES))
        return replace(found, rank=(-error, found.rank[1]))

    def _standoff(self, piece: MeshPiece, matters: float, count: int) -> float:
        """Return how far a piece stands off, where that matters, see `_Piece` [m]."""
        if matters <= 0:
            return 0.0
        samples = piece.hull_samples(self._rng, count)
        return min(matters, float(self._solid.distance(samples).max(initial=0.0)))

    def cover(self) -> Cover:
        """Return the cover by all pieces."""
        pieces = [*self.done, *self.waiting]
        shapes = tuple(each.piece.shape() for each in pieces)
        return Cover(shapes, max(each.error for each in pieces))
