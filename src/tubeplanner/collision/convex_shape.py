"""Solids as unions of convex shapes, the representation for collision checking.

A shape is a polytope grown by a radius (a sphere is one grown point, a capsule a grown edge), so
that one bound on distance works for all of them. Every conversion covers the original solid.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from tubeplanner.arrays import FloatArray, read_only

# A cylinder becomes a circumscribed prism; 24 sides make it at most 0.9 % too wide.
_PRISM_SIDES = 24
_INSCRIBED_SIDES = 96  # of a prism that leaves out at most 0.05 % of the radius
# A flat point set has no hull with faces; it is given this half thickness [m].
_FLAT_HALF_THICKNESS = 1e-6


@dataclass(frozen=True, eq=False)
class ConvexShape:
    """The convex hull of some points, grown by a radius.

    Attributes:
        vertices: Shape (V, 3) [m].
        radius: Growth [m], >= 0.
    """

    vertices: FloatArray
    radius: float = 0.0

    @cached_property
    def center(self) -> FloatArray:
        """Centre of the bounding sphere, shape (3,) [m]."""
        return (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2

    @cached_property
    def bounding_radius(self) -> float:
        """Radius of the bounding sphere about `center` [m]."""
        return self.reach(self.center)

    @cached_property
    def faces(self) -> np.ndarray:
        """Triangles of the polytope as vertex indices, outward: int, shape (F, 3)."""
        hull = ConvexHull(self.vertices)
        triangles = self.vertices[hull.simplices]
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        inward = np.einsum("fi,fi->f", normals, hull.equations[:, :3]) < 0
        return np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)

    def reach(self, point: FloatArray) -> float:
        """Return the largest distance from a point (3,) to the shape [m]."""
        return float(np.linalg.norm(self.vertices - point, axis=1).max()) + self.radius

    def transformed(self, placement: FloatArray) -> "ConvexShape":
        """Return the shape moved by a homogeneous transform, shape (4, 4)."""
        moved = self.vertices @ placement[:3, :3].T + placement[:3, 3]
        return ConvexShape(read_only(moved), self.radius)


def box(size: Iterable[float]) -> ConvexShape:
    """Return a centred box of full side lengths [m]."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    return ConvexShape(read_only(signs * np.array(list(size)) / 2))


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
    """Return a prism inside a centred cylinder along z, hardly smaller than it, in [m]."""
    return _prism(radius, length, _INSCRIBED_SIDES)


def _prism(radius: float, length: float, sides: int) -> ConvexShape:
    angles = np.arange(sides) * 2 * np.pi / sides
    ring = radius * np.array([np.cos(angles), np.sin(angles)]).T
    ends = [np.column_stack([ring, np.full(sides, z)]) for z in (-length / 2, length / 2)]
    return ConvexShape(read_only(np.vstack(ends)))


def convex_hull(points: FloatArray) -> ConvexShape:
    """Return the convex hull of points (N, 3); a flat set becomes its thickened bounding box."""
    try:
        return ConvexShape(read_only(points[ConvexHull(points).vertices]))
    except QhullError:
        low = points.min(axis=0) - _FLAT_HALF_THICKNESS
        high = points.max(axis=0) + _FLAT_HALF_THICKNESS
        corners = box(high - low).vertices + (low + high) / 2
        return ConvexShape(read_only(corners))


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
