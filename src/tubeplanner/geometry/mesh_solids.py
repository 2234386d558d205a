"""MeshSolid: a solid bounded by triangles; its inside, its openings, contact by FCL."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.convex_shapes import ConvexShape, frame_along, hull_unless_flat

# FCL is loaded for the first contact: never for cached covers.
#
# Slower than covers by convex shapes and blind to the depth of an overlap: repeated distances use
# covers, and these solids decide only where covers cannot.

_PROBE_RADIUS = 1e-9  # of the ball that represents a point in FCL [m]
# A point counts as inside from this winding number on: 1 inside and 0 outside of a closed surface,
# between them near the gaps of an open surface, of which only covers ask, see `filled`.
_INSIDE_WINDING = 0.3
_IN_ONE_SHELL = 1.5  # a winding number between that of one shell and of two
_CHUNK = 50_000  # point-triangle pairs looked at together
_MIN_CORNERS = 3  # of a polytope with faces; fewer are a ball or a capsule
_FLAT = 1e-9  # of a hull: its volume over its length cubed


@dataclass(frozen=True, eq=False)
class MeshSolid:
    """A solid bounded by triangles, or a rounded convex shape.

    Triangles are a closed shell if as many run along each edge one way as the other; equal vertices
    are one. Only closed shells have an inside for certain. Of open meshes nobody knows it: where a
    pair is left out, surfaces alone decide; links are covered as `filled`, others as `plugged`.
    """

    vertices: FloatArray  # shape (V, 3) [m]
    faces: IntArray  # vertex indices: int, shape (F, 3); none for balls and capsules
    radius: float = 0.0  # growth of the vertices if there are no faces [m]
    # rows of `faces` that are closed shells; empty: found by the edges
    shells: tuple[slice, ...] = ()

    @classmethod
    def of_shape(cls, shape: ConvexShape) -> "MeshSolid":
        """Return a convex shape as a solid."""
        if len(shape.vertices) < _MIN_CORNERS:
            return cls(shape.vertices, np.zeros((0, 3), dtype=np.int64), shape.radius)
        return cls(shape.vertices, shape.faces)

    @cached_property
    def triangles(self) -> FloatArray:
        """Corners of the triangles, shape (F, 3, 3) [m]."""
        return self.vertices[self.faces]

    def moved(self, placement: FloatArray) -> "MeshSolid":
        """Return the solid moved by a homogeneous transform, shape (4, 4)."""
        vertices = self.vertices @ placement[:3, :3].T + placement[:3, 3]
        return replace(self, vertices=vertices)

    def contains(self, points: FloatArray, most: float = np.inf) -> np.ndarray:
        """Return True for points (N, 3) inside the closed shells: bool, shape (N,).

        Points that the shells go round more often than `most` times do not count.
        """
        inside = np.zeros(len(points), dtype=bool)
        step = max(1, _CHUNK // max(len(self.faces), 1))
        for triangles in self._shells:
            for start in range(0, len(points), step):
                rows = slice(start, start + step)
                times = abs(_winding(triangles, points[rows]))
                inside[rows] |= (times > _INSIDE_WINDING) & (times < most)
        return inside

    @cached_property
    def open_edges(self) -> int:
        """Number of edges along which unequally many triangles run one way and the other."""
        return int((_sides(self._corners).surplus != 0).sum())

    @cached_property
    def filled(self) -> "MeshSolid":
        """The solid with its openings closed and its triangles wound alike: often itself.

        An opening is closed by a fan of triangles from its rim to the rim's middle. The solid is
        also where the winding number without these is large: behind gaps between patches of
        surface, where a fan only lies back on its patch.
        """
        return self._filled(plugged=False)

    @cached_property
    def plugged(self) -> "MeshSolid":
        """The solid as `filled`, its openings also filled by the hulls of their rims.

        It contains the solid that the mesh had before triangles were lost, if the triangles of each
        gap had all of their corners on one rim.
        """
        return self._filled(plugged=True)

    def _filled(self, *, plugged: bool) -> "MeshSolid":
        once = np.unique(np.sort(self._corners, axis=1), axis=0, return_index=True)[1]
        if len(once) == len(self.faces) and self.open_edges == 0:
            return self
        corners = _wound_alike(self._corners[np.sort(once)])
        sides = _sides(corners)
        rim = np.repeat(sides.ends, np.maximum(sides.surplus, 0), axis=0)
        back = np.repeat(sides.ends[:, ::-1], np.maximum(-sides.surplus, 0), axis=0)
        rim = np.concatenate([rim, back])
        used, ends = np.unique(rim, return_inverse=True)
        ends = ends.reshape(-1, 2)
        count, opening = _components(ends, len(used))
        middles = np.zeros((count, 3))
        np.add.at(middles, opening, self.vertices[used])
        middles /= np.bincount(opening, minlength=count)[:, None]
        lids = np.column_stack([rim[:, ::-1], len(self.vertices) + opening[ends[:, 0]]])
        vertices, faces = [self.vertices, middles], [corners, lids]
        total = len(self.vertices) + count
        for k in np.flatnonzero(np.bincount(opening) > _MIN_CORNERS) if plugged else ():
            points = self.vertices[used[opening == k]]
            qhull = hull_unless_flat(points)
            if qhull is not None and qhull.volume > _FLAT * np.ptp(points, axis=0).max() ** 3:
                shape = ConvexShape(points[qhull.vertices])
                vertices.append(shape.vertices)
                faces.append(shape.faces + total)
                total += len(shape.vertices)
        own, closed = len(corners), len(corners) + len(lids)
        shells = (slice(own), slice(closed), slice(closed, None)) if len(lids) else ()
        return MeshSolid(np.vstack(vertices), np.vstack(faces), shells=shells)

    @cached_property
    def _corners(self) -> IntArray:
        """The faces with the first of equal vertices in place of each, shape (F, 3)."""
        _, first, same = np.unique(
            self.vertices + 0.0, axis=0, return_index=True, return_inverse=True
        )
        corners: IntArray = first[same.reshape(-1)][self.faces]
        return corners

    @cached_property
    def _shells(self) -> list[FloatArray]:
        """Triangles (T, 3, 3) [m] of closed shells; a point inside of any is inside the solid.

        A closed shell near an open one does not count: the open one may bound a hollow in it.
        """
        if self.shells:
            return [self.triangles[rows] for rows in self.shells]
        if len(self.faces) == 0 or self.open_edges == 0:
            return [self.triangles]
        sides, faces = _sides(self._corners), np.arange(len(self.faces))
        links = np.column_stack([np.tile(faces, 3), len(faces) + sides.edge])
        count, shell = _components(links, len(faces) + len(sides.ends))
        is_open = np.zeros(count, dtype=bool)
        is_open[shell[len(faces) :][sides.surplus != 0]] = True
        shell = shell[: len(faces)]
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        np.minimum.at(low, shell, self.triangles.min(axis=1))
        np.maximum.at(high, shell, self.triangles.max(axis=1))
        counts = np.zeros(count, dtype=bool)
        for k in np.flatnonzero(~is_open):
            beside = (low[is_open] > high[k]) | (high[is_open] < low[k])
            counts[k] = beside.any(axis=1).all()
        return [self.triangles[counts[shell]]]

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (N, 3) from the surface, shape (N,) [m]."""
        import fcl

        probe = fcl.CollisionObject(fcl.Sphere(_PROBE_RADIUS))
        surface, request = self._placed(np.eye(3), np.zeros(3)), fcl.DistanceRequest()
        distance = np.empty(len(points))
        for k, point in enumerate(points):
            probe.setTranslation(point)
            distance[k] = fcl.distance(surface, probe, request, fcl.DistanceResult())
        return np.maximum(distance, 0.0)

    def touches(
        self,
        other: "MeshSolid",
        here: tuple[FloatArray, FloatArray],
        there: tuple[FloatArray, FloatArray],
    ) -> bool:
        """Return True if two placed solids touch, or either contains the other for certain.

        Poses are a rotation (3, 3) and a position (3,) [m]. Where two shells of a mesh are wound
        the same way, one may bound a hollow in the other.
        """
        import fcl

        request, result = fcl.CollisionRequest(), fcl.CollisionResult()
        if fcl.collide(self._placed(*here), other._placed(*there), request, result) > 0:
            return True
        for inner, outer, at, around in ((self, other, here, there), (other, self, there, here)):
            point = around[0].T @ (at[0] @ inner.vertices[0] + at[1] - around[1])
            if len(outer.faces) and outer.contains(point[None], _IN_ONE_SHELL)[0]:
                return True
        return False

    def _placed(self, rotation: FloatArray, position: FloatArray) -> Any:
        import fcl

        geometry, axes, origin = self._geometry
        transform = fcl.Transform(rotation @ axes, rotation @ origin + position)
        return fcl.CollisionObject(geometry, transform)

    @cached_property
    def _geometry(self) -> tuple[Any, FloatArray, FloatArray]:
        """FCL's geometry, and its rotation (3, 3) and position (3,) in the solid's frame."""
        import fcl

        if len(self.faces):
            model = fcl.BVHModel()
            model.beginModel(len(self.vertices), len(self.faces))
            model.addSubModel(np.asarray(self.vertices), np.asarray(self.faces))
            model.endModel()
            return model, np.eye(3), np.zeros(3)
        middle = self.vertices.mean(axis=0)
        if len(self.vertices) == 1:
            return fcl.Sphere(self.radius), np.eye(3), middle
        edge = self.vertices[1] - self.vertices[0]
        length = float(np.linalg.norm(edge))
        return fcl.Capsule(self.radius, length), frame_along(edge / length), middle


def _winding(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """Return the winding number of triangles around points (N, 3), shape (N,).

    A. Van Oosterom and J. Strackee (1983), "The solid angle of a plane triangle", IEEE Transactions
    on Biomedical Engineering 30.
    """
    # Each coordinate in an array of its own: far faster than small vectors side by side.
    corners = np.ascontiguousarray(triangles.transpose(1, 2, 0))
    a, b, c = corners[:, :, None] - points.T[None, :, :, None]
    la, lb, lc = (np.sqrt(_dot(v, v)) for v in (a, b, c))
    volume = (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )
    beside = la * lb * lc + _dot(a, b) * lc + _dot(b, c) * la + _dot(c, a) * lb
    winding: FloatArray = np.arctan2(volume, beside).sum(axis=1) / (2 * np.pi)
    return winding


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    products: FloatArray = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return products


# ---- The edges of triangles, which tell closed shells from open ones.


@dataclass(frozen=True, eq=False)
class _Sides:
    """The sides of F triangles: first sides, second sides, third sides."""

    edge: IntArray  # index of the edge on which each side lies, shape (3F,)
    direction: IntArray  # 1 along the edge, -1 against it, shape (3F,)
    ends: IntArray  # vertices of the E edges, shape (E, 2)
    surplus: IntArray  # sides along each edge less sides against it, shape (E,)


def _sides(corners: IntArray) -> _Sides:
    """Return the sides of triangles, given by their vertices (F, 3)."""
    sides = np.concatenate([corners[:, [k, (k + 1) % 3]] for k in range(3)])
    count = int(corners.max(initial=0)) + 1
    ends, edge = np.unique(sides.min(axis=1) * count + sides.max(axis=1), return_inverse=True)
    edge, direction = edge.reshape(-1), np.sign(sides[:, 1] - sides[:, 0])
    surplus = np.bincount(edge, weights=direction, minlength=len(ends)).astype(np.int64)
    return _Sides(edge, direction, np.column_stack(np.divmod(ends, count)), surplus)


def _wound_alike(corners: IntArray) -> IntArray:
    """Return triangles (F, 3), some turned round, so that neighbours are wound alike.

    Every triangle is there twice, as it is and turned round; what is wound alike is connected.
    """
    sides, count = _sides(corners), len(corners)
    order = np.argsort(sides.edge, kind="stable")
    starts = np.flatnonzero(np.diff(sides.edge[order], prepend=-1))
    two = starts[np.diff(starts, append=len(order)) == 2]
    first, second = order[two], order[two + 1]
    across = np.where(sides.direction[first] == sides.direction[second], count, 0)
    first, second = first % count, second % count
    alike = np.column_stack([first, second + across])
    swapped = np.column_stack([first + count, second + count - across])
    _, side = _components(np.concatenate([alike, swapped]), 2 * count)
    is_reversed = side[:count] > side[count:]  # the first of connected triangles stays as it is
    return np.where(is_reversed[:, None], corners[:, ::-1], corners)


def _components(links: IntArray, count: int) -> tuple[int, IntArray]:
    """Return the number of connected components of a graph, and that of each of its nodes."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(links), dtype=bool), tuple(links.T)), shape=(count, count))
    components, of_node = connected_components(graph, directed=False)
    return int(components), of_node
