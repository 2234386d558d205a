"""Closer covers of concave meshes: pieces cut in two until the cover error is small."""

import heapq
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import count, product
from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray, read_only
from tubeplanner.geometry.convex_shapes import (
    ConvexShape,
    flat_hull,
    hull,
    hull_unless_flat,
    spread_directions,
)
from tubeplanner.geometry.mesh_solids import MeshSolid

# ---- Cover errors: distances from covers to the solids that they cover.

_SAMPLES = 200  # points on each shape's surface
_SEED = 0
# Points this near another shape [m] are not on the surface of the cover, but where shapes meet.
_SAME_PLACE = 1e-6
_MIN_VERTICES = 4  # of a shape with a surface of its own; balls and capsules have no cover error


def cover_error(solid: MeshSolid, shapes: Sequence[ConvexShape]) -> float:
    """Return the largest distance found from the surface of a cover to its solid [m]."""
    rng = np.random.default_rng(_SEED)
    hulls = [hull(s.vertices) if len(s.vertices) >= _MIN_VERTICES else None for s in shapes]
    worst = 0.0
    for k, shape in enumerate(shapes):
        if hulls[k] is None or len(solid.faces) == 0:
            continue
        points = surface_samples(shape.vertices[shape.faces], _SAMPLES, rng)
        for other in hulls[:k] + hulls[k + 1 :]:
            if other is not None:
                outside = (points @ other.equations[:, :3].T + other.equations[:, 3]).max(axis=1)
                points = points[outside > _SAME_PLACE]
        # The farthest point counts that is not inside the solid.
        distance = solid.distance(points)
        for row in np.argsort(-distance):
            if not solid.contains(points[row : row + 1])[0]:
                worst = max(worst, float(distance[row]))
                break
    return worst


def surface_samples(triangles: FloatArray, count: int, rng: "np.random.Generator") -> FloatArray:
    """Return random points on triangles (T, 3, 3), evenly by area, shape (count, 3) [m]."""
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(sides, axis=1)
    if len(area) == 0 or not area.sum() > 0:
        return triangles.reshape(-1, 3)[:count]
    triangle = rng.choice(len(area), count, p=area / area.sum())
    return np.einsum("nk,nki->ni", rng.dirichlet(np.ones(3), count), triangles[triangle])


# ---- Parts of a solid inside boxes, and their convex hulls, of which finer covers consist.
#
# The hull of a solid inside a box is that of the surface inside the box and of the box's corners
# that are inside the solid: any other point has surface or solid around it, so that it is no corner
# of the hull.

# A piece may be cut at its deepest notches, at the coordinates that most of its corners have, and
# in its middle. A cut at a corner is preferred to a cut that is better by less than this fraction.
_MAX_NOTCHES = 3
_MAX_COORDINATES = 2
_CORNER_FRACTION = 0.05
_END = 5e-4  # [m]: a cut closer to an end of a piece leaves nothing to gain
# Of more points, the farthest in this many directions approximate the hull's corners to score cuts.
_MAX_SCORED_POINTS = 1000
_DIRECTIONS = spread_directions(300)
_FACETS = 60  # facets not made by cuts at which a hull's distance from the surface is measured
_ON_PLANE = 2e-7  # [m]: facets this near a cut lie on it; more than `_SNAP`
# Corners of triangles this near a cut lie on it [m]. Corners of boxes are tested this far inside
# of their box, away from the solid's own surface, on which they may lie.
_SNAP, _INWARD = 1e-7, 1e-6

Inside = Callable[[FloatArray], BoolArray]


@dataclass(frozen=True, eq=False)
class MeshPiece:
    """A solid's surface inside a box."""

    triangles: FloatArray  # shape (T, 3, 3) [m]
    low: FloatArray  # lower corner of the box, shape (3,) [m]; minus infinity where it is open
    high: FloatArray  # upper corner, likewise
    inside: Inside  # returns True for points (N, 3) inside the whole solid: bool, shape (N,)

    @cached_property
    def hull(self) -> ConvexShape:
        """The hull of the solid inside the box, as exact as rounding allows."""
        points = self._all_points
        qhull = hull_unless_flat(points)
        return flat_hull(points) if qhull is None else ConvexShape(points[qhull.vertices])

    def shape(self) -> ConvexShape:
        """Return the hull, grown to contain all of the solid despite rounding."""
        outside = self.outside(self._all_points).max()
        return ConvexShape(read_only(self.hull.vertices), max(0.0, float(outside)))

    def outside(self, points: FloatArray) -> FloatArray:
        """Return lower bounds on distances of points (N, 3) outside the hull, shape (N,) [m]."""
        vertices = self.hull.vertices
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        outside: FloatArray = np.maximum(low - points, points - high).max(axis=1)
        inside = outside <= 0
        planes = hull(vertices).equations
        beyond = points[inside] @ planes[:, :3].T + planes[:, 3]
        outside[inside] = np.maximum(outside[inside], beyond.max(axis=1))
        return outside

    def cut(self) -> "tuple[MeshPiece, MeshPiece] | None":
        """Return both parts of the cut with the smallest hulls; None if there is none."""
        cuts = list(self._positions())
        if not cuts:
            return None
        best = min(
            (self._hull_volume(axis, height) * worse, axis, height) for axis, height, worse in cuts
        )
        parts = [self.part(*best[1:], below=below) for below in (True, False)]
        return None if any(part.is_empty for part in parts) else (parts[0], parts[1])

    def part(self, axis: int, height: float, *, below: bool) -> "MeshPiece":
        """Return the part below or above a plane across an axis at a coordinate [m]."""
        low, high = self.low.copy(), self.high.copy()
        if below:
            high[axis] = min(high[axis], height)
        else:
            low[axis] = max(low[axis], height)
        triangles = clipped(self.triangles, axis, height, below=below)
        return MeshPiece(triangles, low, high, self.inside)

    def hull_samples(self, rng: "np.random.Generator", count: int) -> FloatArray:
        """Return points on the hull outside the solid (N, 3) [m]; `count` tries on cuts."""
        facets, on_cut = self._facets
        # Where it was cut, a piece is nearly always inside the solid; elsewhere, never.
        cut = surface_samples(facets[on_cut], count, rng)
        # Of the longest other triangles, and of their edges, the middles.
        triangles = facets[~on_cut]
        following = np.roll(triangles, 1, axis=1)
        length = np.linalg.norm(following - triangles, axis=2).max(axis=1)
        longest = np.argsort(-length, kind="stable")[:_FACETS]
        edges = (triangles[longest] + following[longest]) / 2
        middles = np.vstack([triangles[longest].mean(axis=1), edges.reshape(-1, 3)])
        return np.vstack([middles, cut[~self.inside(cut)]])

    @cached_property
    def _facets(self) -> tuple[FloatArray, BoolArray]:
        """The hull's triangles, shape (F, 3, 3) [m], and True for cut triangles, shape (F,)."""
        facets: FloatArray = self.hull.vertices[self.hull.faces]
        on_cut = np.zeros(len(facets), dtype=bool)
        for bound in (self.low, self.high):
            on_cut |= np.any(np.all(abs(facets - bound) < _ON_PLANE, axis=1), axis=1)
        return facets, on_cut

    @property
    def is_empty(self) -> bool:
        """True if the box contains nothing of the solid."""
        return len(self._all_points) == 0

    @property
    def _all_points(self) -> FloatArray:
        return np.vstack([self._points, self._corners])

    @cached_property
    def _points(self) -> FloatArray:
        return np.unique(self.triangles.reshape(-1, 3), axis=0)

    @cached_property
    def _corners(self) -> FloatArray:
        """The corners of the box inside the solid, shape (C, 3); open sides have none."""
        corners = np.array(list(product(*zip(self.low, self.high, strict=True))))
        inward = np.array(list(product((1, -1), repeat=3))) * _INWARD
        is_corner = np.isfinite(corners).all(axis=1)
        corners, inward = corners[is_corner], inward[is_corner]
        return corners[self.inside(corners + inward)]

    def _positions(self) -> Iterator[tuple[int, float, float]]:
        """Yield possible cuts: axis, coordinate, and weight of the volume."""
        low, high = self._all_points.min(axis=0), self._all_points.max(axis=0)
        notches = self._notches()
        for axis in range(3):
            values, counts = _distinct(self._points[:, axis])
            commonest = values[np.argsort(-counts, kind="stable")[:_MAX_COORDINATES]]
            heights = np.concatenate([notches[:, axis], commonest])
            for height in _distinct(heights)[0]:
                if low[axis] + _END < height < high[axis] - _END:
                    yield axis, float(height), 1.0
            if high[axis] - low[axis] > 2 * _END:
                yield axis, float(low[axis] + high[axis]) / 2, 1 + _CORNER_FRACTION

    def _notches(self) -> FloatArray:
        """Return the points of the surface that are deepest in the hull, shape (N, 3) [m].

        J.-M. Lien and N. M. Amato (2008), "Approximate convex decomposition of polyhedra and its
        applications", Computer Aided Geometric Design 25: a cut at the deepest notch resolves it.
        """
        facets, on_cut = self._facets
        a, b, c = facets[~on_cut].transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1)
        normals, start = (normals / length[:, None])[length > 0], a[length > 0]
        below = np.einsum("fi,fi->f", normals, start) - self._points @ normals.T
        depth = below.min(axis=1, initial=np.inf)
        return self._points[np.argsort(-depth, kind="stable")[:_MAX_NOTCHES]]

    def _hull_volume(self, axis: int, height: float) -> float:
        """Return the approximate volume of the hulls of both sides of a cut [m^3]."""
        corners = self._corners
        between = corners.copy()  # cuts of the box's edges inside the solid, or of some of them
        between[:, axis] = height
        low, high = self._spans[:, axis].T
        cut = self.triangles[(low < height + _SNAP) & (high > height - _SNAP)]
        volume = 0.0
        for below in (True, False):
            side = corners[(corners[:, axis] < height) == below]
            beyond = (self._points[:, axis] - height) * (-1.0 if below else 1.0) > _SNAP
            edge = clipped(cut, axis, height, below=below).reshape(-1, 3)
            points = np.vstack([self._points[beyond], edge, side, between])
            if len(points) > _MAX_SCORED_POINTS:  # the farthest: about the corners of the hull
                points = points[np.unique((points @ _DIRECTIONS.T).argmax(axis=0))]
            try:
                qhull = hull_unless_flat(points)
            except ValueError:  # too few
                continue
            volume += 0.0 if qhull is None else float(qhull.volume)
        return volume

    @cached_property
    def _spans(self) -> FloatArray:
        """Lowest and highest coordinates of the triangles, shape (T, 3, 2) [m]."""
        return np.stack([self.triangles.min(axis=1), self.triangles.max(axis=1)], axis=2)


def clipped(triangles: FloatArray, axis: int, height: float, *, below: bool) -> FloatArray:
    """Return triangles (T, 3, 3) [m] cut to the side of a plane across an axis at a height [m].

    Triangles in the plane go to the side of the solid that they bound. Triangles that only touch
    the plane do not count: else they would span a hull over nothing.
    """
    side = (triangles[:, :, axis] - height) * (-1.0 if below else 1.0)
    side[abs(side) < _SNAP] = 0.0
    in_plane = (side == 0).all(axis=1)
    here = np.asarray((side > 0).any(axis=1))
    a, b, c = triangles[in_plane].transpose(1, 0, 2)
    here[in_plane] = (np.cross(b - a, c - a)[:, axis] > 0) == below
    triangles, side = triangles[here], side[here]
    is_inside = side >= 0
    count = is_inside.sum(axis=1)
    parts = [triangles[count == 3]]
    for corners_inside in (1, 2):
        rows = np.flatnonzero(count == corners_inside)
        # The corner that is alone on its side comes first.
        alone = is_inside[rows] if corners_inside == 1 else ~is_inside[rows]
        order = (alone.argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = triangles[rows[:, None], order].transpose(1, 0, 2)
        heights = side[rows[:, None], order]
        ab, ac = (_crossing(a, end, heights, k, axis, height) for k, end in ((1, b), (2, c)))
        if corners_inside == 1:
            parts.append(np.stack([a, ab, ac], axis=1))
        else:
            parts += [np.stack([ab, b, c], axis=1), np.stack([ab, c, ac], axis=1)]
    return np.concatenate(parts)


def _crossing(
    start: FloatArray, end: FloatArray, heights: FloatArray, k: int, axis: int, height: float
) -> FloatArray:
    fraction = heights[:, 0] / (heights[:, 0] - heights[:, k])
    point = start + fraction[:, None] * (end - start)
    point[:, axis] = height
    return point


def _distinct(coordinates: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return coordinates that differ to six digits, and the number of equals of each."""
    _, first, counts = np.unique(coordinates.round(6), return_index=True, return_counts=True)
    return coordinates[first], counts


# ---- Closer covers of concave meshes: pieces are cut in two until none is off the surface.

OUTER_ERROR = 2e-3  # [m]: accepted distance of a cover from its mesh where it matters
MAX_PIECES = 64
# A piece matters if probes are in it, or this near [m]: by the deepest probe's depth below that.
_NEAR = 5e-3
_MAX_PROBES = 1500  # stored of the probes near a piece
# Points on its cuts at which a piece's distance from the surface is measured: at first, and before
# the piece is accepted.
_FEW_SAMPLES, _MANY_SAMPLES = 12, 100


@dataclass(frozen=True, eq=False)
class Cover:
    """Convex shapes that together contain a solid."""

    shapes: tuple[ConvexShape, ...]  # in the solid's frame
    # the largest distance found from their surface to the solid's, where it matters [m]
    outer_error: float


class _Piece(NamedTuple):
    """A piece on a heap: the piece with the largest distance from the surface comes first."""

    rank: float  # minus the distance from the surface, where that matters [m]
    number: int  # in the order in which pieces were cut
    piece: MeshPiece
    probes: FloatArray | None  # probes near it, shape (N, 3) [m]
    matters: float  # upper bound on the part of its distance that matters [m]


def fine_cover(
    solid: MeshSolid,
    probes: FloatArray | None = None,
    *,
    cuts: Sequence[tuple[int, float]] = (),
    outer_error: float = OUTER_ERROR,
    max_pieces: int = MAX_PIECES,
) -> Cover:
    """Return a cover of a solid by at most `max_pieces` shapes, cut where it is not close [m].

    The solid's triangles are closed, see `MeshSolid.filled`. The cover should leave out probes
    (N, 3) outside of it [m]: only pieces with probes in or near them are cut; without probes all
    matter. Cuts, each an axis and a coordinate [m], are made in any case.
    """
    rng, numbers = np.random.default_rng(_SEED), count()
    waiting: list[_Piece] = []
    done: list[_Piece] = []

    def standoff(piece: MeshPiece, matters: float, samples: int) -> float:
        """Return a piece's distance from the surface, where that matters [m]."""
        if matters <= 0:
            return 0.0
        distance = solid.distance(piece.hull_samples(rng, samples))
        return min(matters, float(distance.max(initial=0.0)))

    def add(piece: MeshPiece, probes: FloatArray | None) -> None:
        """Add a piece, with the probes in or near the piece."""
        matters = np.inf
        if probes is not None:
            outside = piece.outside(probes)
            matters = _NEAR - float(outside.min(initial=_NEAR))
            probes = probes[outside < _NEAR]
            if len(probes) > _MAX_PROBES:
                probes = rng.choice(probes, _MAX_PROBES, replace=False)
        rank = -standoff(piece, matters, _FEW_SAMPLES)
        heapq.heappush(waiting, _Piece(rank, next(numbers), piece, probes, matters))

    everywhere = np.full(3, np.inf)
    pieces = [MeshPiece(solid.triangles, -everywhere, everywhere, solid.contains)]
    for axis, height in cuts:
        parts = (
            piece.part(axis, height, below=below) for piece in pieces for below in (True, False)
        )
        pieces = [part for part in parts if not part.is_empty]
    for piece in pieces:
        add(piece, probes)
    while waiting and len(waiting) + len(done) < max_pieces:
        worst = heapq.heappop(waiting)
        if -worst.rank <= outer_error:
            closer_look = standoff(worst.piece, worst.matters, _MANY_SAMPLES)
            worst = worst._replace(rank=min(worst.rank, -closer_look))
        halves = worst.piece.cut() if -worst.rank > outer_error else None
        if halves is None:
            done.append(worst)
        for half in halves or ():
            add(half, worst.probes)
    result = [*done, *waiting]
    shapes = tuple(each.piece.shape() for each in result)
    return Cover(shapes, max(-each.rank for each in result))
