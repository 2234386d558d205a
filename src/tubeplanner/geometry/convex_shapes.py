"""Convex shapes, hulls, bounding boxes, evenly spread directions."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray, read_only
from tubeplanner.text import short_repr

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

# ---- Convex hulls by Qhull. scipy is imported for the first hull: never for cached covers.


def hull(points: FloatArray) -> "ConvexHull":
    """Return the hull of points (N, 3).

    Raises:
        QhullError: They lie in a plane, or nearly; it is a RuntimeError.
    """
    from scipy.spatial import ConvexHull

    return ConvexHull(points)


def hull_unless_flat(points: FloatArray) -> "ConvexHull | None":
    """Return the hull of points (N, 3), or None if they lie in a plane, or nearly."""
    from scipy.spatial import QhullError

    try:
        return hull(points)
    except QhullError:
        return None


# ---- Solids as unions of convex shapes, the representation for collision checking.
#
# A shape is a polytope grown by a radius (a sphere is one grown point, a capsule a grown edge), so
# that one bound on distance works for all of them. Every conversion covers the original solid.

# A cylinder becomes a circumscribed prism; 24 sides make it at most 0.9 % too wide.
_PRISM_SIDES = 24
_INSCRIBED_SIDES = 96  # of a prism that leaves out at most 0.05 % of the radius
# A flat point set has no hull with faces; its shape gets this half thickness [m].
_FLAT_HALF_THICKNESS = 1e-6
_NO_AREA, _NORMAL_DIGITS = 1e-16, 9  # of a face [m^2]; of a normal's coordinates
_MIN_CORNERS = 3  # of a polytope with faces; fewer are a ball or a capsule
MAX_THINNED_CORNERS = 64  # of a thinned shape
# Corners far along this many directions begin it: the more are chosen so, the larger its growth.
_FIRST_CORNERS = 8
_POINTS_AT_ONCE = 1000  # measured against all triangles of a hull
_SLIVER = 1e-6  # of a triangle's area to its sides' squares
# Two triangles of each side, for corners in the order of `_BOX_SIGNS`.
_BOX_SIGNS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
_BOX_FACES = np.array(
    [
        *([0, 1, 5], [0, 5, 4], [2, 6, 7], [2, 7, 3]),  # x
        *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6]),  # y
        *([0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]),  # z
    ]
)


class Thinning(NamedTuple):
    """Few corners of a shape whose hull, once it is grown, contains the whole shape."""

    corners: IntArray  # indices of vertices: all of them, or `MAX_THINNED_CORNERS` at most
    growth: float  # largest distance of any vertex from the hull of the corners [m]


@dataclass(frozen=True, eq=False)
class ConvexShape:
    """The convex hull of some points, grown by a radius."""

    vertices: FloatArray  # shape (V, 3) [m]
    radius: float = 0.0  # growth [m], >= 0
    known_faces: IntArray | None = None  # `faces`, if known; None: computed on first use
    known_thinning: Thinning | None = None  # `thinning`, likewise

    __repr__ = short_repr

    @cached_property
    def center(self) -> FloatArray:
        """Centre of the bounding sphere, shape (3,) [m]."""
        return (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2

    @cached_property
    def bounding_radius(self) -> float:
        """Radius of the bounding sphere about `center` [m]."""
        return self.reach(self.center)

    @cached_property
    def faces(self) -> IntArray:
        """Triangles as vertex indices, outward, shape (F, 3); none of a ball or a capsule."""
        if self.known_faces is not None:
            return self.known_faces
        if len(self.vertices) < _MIN_CORNERS:
            return np.zeros((0, 3), dtype=np.int64)
        qhull = hull(self.vertices)
        triangles = self.vertices[qhull.simplices]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        inward = np.einsum("fi,fi->f", normals, qhull.equations[:, :3]) < 0
        outward = np.where(inward[:, None], qhull.simplices[:, ::-1], qhull.simplices)
        return outward.astype(np.int64)

    @cached_property
    def normals(self) -> FloatArray:
        """Distinct outward unit normals of the polytope's faces, shape (F, 3); none of a ball."""
        triangles = self.vertices[self.faces]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        length = np.linalg.norm(normals, axis=1)
        sound = length > _NO_AREA
        return np.unique((normals[sound] / length[sound, None]).round(_NORMAL_DIGITS), axis=0)

    @cached_property
    def thinning(self) -> Thinning:
        """The corners of `thinned`, and its growth."""
        return self.known_thinning or _thinning(self.vertices)

    @cached_property
    def thinned(self) -> "ConvexShape":
        """The shape itself, or one of at most `MAX_THINNED_CORNERS` vertices that contains it.

        Its vertices are some of the shape's. Its radius is larger by the growth, which no point of
        the shape exceeds: the distance from a convex set is largest at a vertex.
        """
        corners, growth = self.thinning
        if len(corners) == len(self.vertices):
            return self
        return ConvexShape(read_only(self.vertices[corners]), self.radius + growth)

    def reach(self, point: FloatArray) -> float:
        """Return the largest distance from a point (3,) to the shape [m]."""
        return float(np.linalg.norm(self.vertices - point, axis=1).max()) + self.radius

    def transformed(self, placement: FloatArray) -> "ConvexShape":
        """Return the shape moved by a rotation and a translation, shape (4, 4)."""
        vertices = self.vertices @ placement[:3, :3].T + placement[:3, 3]
        return ConvexShape(read_only(vertices), self.radius, self.known_faces, self.known_thinning)


def _thinning(vertices: FloatArray) -> Thinning:
    """Return the thinning of vertices (V, 3): again and again the farthest outside is added."""
    chosen = np.unique((vertices @ spread_directions(_FIRST_CORNERS).T).argmax(axis=0))
    while len(vertices) > MAX_THINNED_CORNERS:
        qhull = hull_unless_flat(vertices[chosen])
        if qhull is None:
            break
        outside = (vertices @ qhull.equations[:, :3].T + qhull.equations[:, 3]).max(axis=1)
        farthest = int(outside.argmax())
        if len(chosen) < MAX_THINNED_CORNERS and farthest not in chosen:
            chosen = np.append(chosen, farthest)
            continue
        triangles, rest = vertices[chosen[qhull.simplices]], vertices[outside > 0]
        parts = np.split(rest, range(_POINTS_AT_ONCE, len(rest), _POINTS_AT_ONCE))
        growth = max(float(_distances(part, triangles).max(initial=0.0)) for part in parts)
        return Thinning(chosen, growth)
    return Thinning(np.arange(len(vertices)), 0.0)  # few, or Qhull finds no hull of some


def _distances(points: FloatArray, triangles: FloatArray) -> FloatArray:
    """Return the distances of points (N, 3) from the nearest of triangles (F, 3, 3), (N,) [m].

    Never too short: every distance is that of a point of a triangle, on an edge or between.
    """
    sides = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normals = np.cross(*sides)
    area = np.linalg.norm(normals, axis=1)
    # Of a triangle that is hardly more than an edge only the edges count: its normal is not exact.
    sound = area > _SLIVER * sum((side**2).sum(axis=1) for side in sides)
    normals[sound] /= area[sound, None]
    nearest, is_above = np.full(len(points), np.inf), np.tile(sound, (len(points), 1))
    for k in range(3):
        start = triangles[:, k]
        edge, away = triangles[:, (k + 1) % 3] - start, points[:, None] - start
        fraction = np.clip(np.einsum("nfi,fi->nf", away, edge) / (edge**2).sum(axis=1), 0.0, 1.0)
        to_edge = np.linalg.norm(away - fraction[:, :, None] * edge, axis=2)
        nearest = np.minimum(nearest, to_edge.min(axis=1))
        is_above &= np.einsum("nfi,fi->nf", away, np.cross(normals, edge)) >= 0
    height = np.where(is_above, abs(np.einsum("nfi,fi->nf", away, normals)), np.inf)
    return np.asarray(np.minimum(nearest, height.min(axis=1)))


def box(size: Iterable[float]) -> ConvexShape:
    """Return a centred box of full side lengths [m]."""
    corners = _BOX_SIGNS * np.array(list(size)) / 2
    return ConvexShape(read_only(corners), known_faces=_BOX_FACES)


def sphere(radius: float) -> ConvexShape:
    """Return a centred sphere of a radius [m]."""
    return ConvexShape(read_only(np.zeros((1, 3))), radius)


def capsule(radius: float, length: float) -> ConvexShape:
    """Return a centred capsule along z, in [m]; `length` lies between its caps' centres."""
    return ConvexShape(read_only([[0, 0, -length / 2], [0, 0, length / 2]]), radius)


def cylinder(radius: float, length: float) -> ConvexShape:
    """Return the prism around a centred cylinder along z, in [m]."""
    return _prism(radius / np.cos(np.pi / _PRISM_SIDES), length, _PRISM_SIDES)


def inscribed_cylinder(radius: float, length: float) -> ConvexShape:
    """Return a prism inside a centred cylinder along z, hardly smaller, in [m]."""
    return _prism(radius, length, _INSCRIBED_SIDES)


def simple_shape(kind: str, sizes: Sequence[float]) -> ConvexShape:
    """Return a centred "box", "sphere", "cylinder" or "capsule" of sizes [m], as above."""
    if kind == "box":
        return box(sizes)
    if kind == "sphere":
        return sphere(*sizes)
    return cylinder(*sizes) if kind == "cylinder" else capsule(*sizes)


def _prism(radius: float, length: float, sides: int) -> ConvexShape:
    angles = np.arange(sides) * 2 * np.pi / sides
    ring = radius * np.array([np.cos(angles), np.sin(angles)]).T
    ends = [np.column_stack([ring, np.full(sides, z)]) for z in (-length / 2, length / 2)]
    # The triangles of a prism whose bottom comes first, both ends counterclockwise.
    here = np.arange(sides)
    following = np.roll(here, -1)
    fan = np.column_stack([np.zeros(sides - 2, dtype=np.int64), here[1:-1], here[2:]])
    sloping = (
        np.column_stack([here, following, following + sides]),
        np.column_stack([here, following + sides, here + sides]),
    )
    faces = np.concatenate([fan[:, ::-1], fan + sides, *sloping])
    return ConvexShape(read_only(np.vstack(ends)), known_faces=faces)


def convex_hull(points: FloatArray) -> ConvexShape:
    """Return the convex hull of points (N, 3); a flat set becomes its thickened bounding box."""
    qhull = hull_unless_flat(points)
    if qhull is not None:
        return ConvexShape(read_only(points[qhull.vertices]))
    low = points.min(axis=0) - _FLAT_HALF_THICKNESS
    high = points.max(axis=0) + _FLAT_HALF_THICKNESS
    corners = box(high - low).vertices + (low + high) / 2
    return ConvexShape(read_only(corners), known_faces=_BOX_FACES)


def flat_hull(points: FloatArray) -> ConvexShape:
    """Return a convex shape around points (N, 3) that lie in a plane, or nearly."""
    middle = points.mean(axis=0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2]
    if len(axes) < 3:
        return convex_hull(points)
    along = (points - middle) @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    size = high - low + 2 * _FLAT_HALF_THICKNESS
    return ConvexShape(read_only((box(size).vertices + (low + high) / 2) @ axes + middle))


def frame_along(z: FloatArray) -> FloatArray:
    """Return a rotation (3, 3) whose third column is the unit vector z."""
    x = np.cross(np.eye(3)[int(np.argmin(abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


@dataclass(frozen=True, eq=False)
class ClosestPoints:
    """The closest points of P pairs of shapes, in the base frame."""

    # lower bounds on the signed distances, exact nearly always, shape (P,) [m]
    distance: FloatArray
    direction: FloatArray  # unit vectors from the first towards the second shape, shape (P, 3)
    first: FloatArray  # FCL's nearest points of the first shapes' cores, shape (P, 3) [m]
    second: FloatArray  # likewise, of the second shapes' cores


# ---- Boxes around convex shapes: quick lower bounds where a shape is long or flat.


@dataclass(frozen=True, eq=False)
class BoundingBoxes:
    """The boxes around S shapes, each in its body's frame."""

    axes: FloatArray  # unit vectors as rows, shape (S, 3, 3)
    center: FloatArray  # along the axes, shape (S, 3) [m]
    half: FloatArray  # half lengths along the axes, shape (S, 3) [m]

    def distance(self, shape: IntArray, point: FloatArray) -> FloatArray:
        """Return the distances of points (M, 3) from boxes of shapes (M,), (M,) [m]; 0 inside."""
        along = np.einsum("mij,mj->mi", self.axes[shape], point) - self.center[shape]
        beyond = np.maximum(abs(along) - self.half[shape], 0.0)
        return np.sqrt(np.einsum("mi,mi->m", beyond, beyond))


def bounding_boxes(shapes: Sequence[ConvexShape]) -> BoundingBoxes:
    """Return the smaller box around each shape, along its principal axes or its body's axes."""
    boxes = []
    for shape in shapes:
        spread = shape.vertices - shape.vertices.mean(axis=0)
        principal_axes = np.asarray(np.linalg.eigh(spread.T @ spread)[1].T)
        candidates = _box(shape, np.eye(3)), _box(shape, principal_axes)
        boxes.append(min(candidates, key=lambda box: float(np.prod(box[2]))))
    axes, center, half = (np.array([box[k] for box in boxes]) for k in range(3))
    return BoundingBoxes(axes.reshape(-1, 3, 3), center.reshape(-1, 3), half.reshape(-1, 3))


def _box(shape: ConvexShape, axes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    along = shape.vertices @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    return axes, (low + high) / 2, (high - low) / 2 + shape.radius


def extent_of(shapes: Iterable[ConvexShape]) -> FloatArray:
    """Return the least and the largest coordinates of some shapes, shape (2, 3) [m]."""
    each = [(s.vertices.min(axis=0) - s.radius, s.vertices.max(axis=0) + s.radius) for s in shapes]
    lows, highs = zip(*each, strict=True)
    return np.array([np.min(lows, axis=0), np.max(highs, axis=0)])


def spread_directions(count: int) -> FloatArray:
    """Return evenly spread unit vectors along a spiral by the golden angle, shape (count, 3)."""
    z = 1 - (2 * np.arange(count) + 1) / count
    azimuth = np.arange(count) * np.pi * (3 - np.sqrt(5))
    wide = np.sqrt(1 - z * z)
    return np.column_stack([wide * np.cos(azimuth), wide * np.sin(azimuth), z])
