"""Solids as they are: triangles, and the primitives of URDF. FCL judges whether two touch.

Slower than covers by convex shapes and blind to how far solids overlap: what asks for distances
all the time uses covers, and these decide only what covers cannot.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import fcl
import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.convex_shape import ConvexShape, frame_along

_PROBE_RADIUS = 1e-9  # of the ball that stands for a point in FCL [m]
# A point counts as inside from this winding number on: 1 inside and 0 outside of a closed surface,
# between them near the gaps of an open one.
_INSIDE_WINDING = 0.3
_CHUNK = 50_000  # point-triangle pairs looked at together
_MIN_CORNERS = 3  # of a polytope with faces; fewer are a ball or a capsule


@dataclass(frozen=True, eq=False)
class MeshSolid:
    """A solid bounded by triangles, or a rounded convex shape.

    Attributes:
        vertices: Shape (V, 3) [m].
        faces: Vertex indices: int, shape (F, 3); none for balls and capsules.
        radius: By which the vertices are grown if there are no faces [m].
    """

    vertices: FloatArray
    faces: IntArray
    radius: float = 0.0

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
        return MeshSolid(vertices, self.faces, self.radius)

    def contains(self, points: FloatArray) -> np.ndarray:
        """Return whether points (N, 3) are inside the triangles: bool, shape (N,)."""
        step = max(1, _CHUNK // max(len(self.faces), 1))
        parts = [points[start : start + step] for start in range(0, len(points), step)]
        winding = [_winding(self.triangles, part) for part in parts]
        return abs(np.concatenate([*winding, np.zeros(0)])) > _INSIDE_WINDING

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (N, 3) from the surface, shape (N,) [m]."""
        probe = fcl.CollisionObject(fcl.Sphere(_PROBE_RADIUS))
        surface, request = self._placed(np.eye(3), np.zeros(3)), fcl.DistanceRequest()
        found = np.empty(len(points))
        for k, point in enumerate(points):
            probe.setTranslation(point)
            found[k] = fcl.distance(surface, probe, request, fcl.DistanceResult())
        return np.maximum(found, 0.0)

    def touches(
        self,
        other: "MeshSolid",
        here: tuple[FloatArray, FloatArray],
        there: tuple[FloatArray, FloatArray],
    ) -> bool:
        """Return whether two placed solids touch, or one is inside the other.

        Args:
            other: The other solid.
            here: Rotation (3, 3) and position (3,) [m] of this one.
            there: Likewise, of the other.
        """
        request, result = fcl.CollisionRequest(), fcl.CollisionResult()
        crossing = fcl.collide(self._placed(*here), other._placed(*there), request, result) > 0
        return crossing or _is_inside(self, other, here, there)

    def _placed(self, rotation: FloatArray, position: FloatArray) -> fcl.CollisionObject:
        turned = rotation @ self._geometry[1]
        middle = rotation @ self._geometry[2] + position
        return fcl.CollisionObject(self._geometry[0], fcl.Transform(turned, middle))

    @cached_property
    def _geometry(self) -> tuple[fcl.CollisionGeometry, FloatArray, FloatArray]:
        """FCL's geometry, and its rotation (3, 3) and position (3,) in the solid's frame."""
        if len(self.faces) == 0:
            return _rounded(self.vertices, self.radius)
        model = fcl.BVHModel()
        model.beginModel(len(self.vertices), len(self.faces))
        model.addSubModel(np.asarray(self.vertices), np.asarray(self.faces))
        model.endModel()
        return model, np.eye(3), np.zeros(3)


def touch(
    first: Sequence[MeshSolid],
    second: Sequence[MeshSolid],
    here: tuple[FloatArray, FloatArray],
    there: tuple[FloatArray, FloatArray],
) -> bool:
    """Return whether any of the first solids touches any of the second; see `touches`."""
    return any(one.touches(other, here, there) for one in first for other in second)


def _is_inside(
    one: MeshSolid,
    other: MeshSolid,
    here: tuple[FloatArray, FloatArray],
    there: tuple[FloatArray, FloatArray],
) -> bool:
    """Return whether a point of one solid is inside the other, or the other way round."""
    for inner, outer, at, around in ((one, other, here, there), (other, one, there, here)):
        point = around[0].T @ (at[0] @ inner.vertices[0] + at[1] - around[1])
        if len(outer.faces) and outer.contains(point[None])[0]:
            return True
    return False


def _rounded(
    vertices: FloatArray, radius: float
) -> tuple[fcl.CollisionGeometry, FloatArray, FloatArray]:
    """Return the ball around one vertex or the capsule around two, with its pose."""
    middle = vertices.mean(axis=0)
    if len(vertices) == 1:
        return fcl.Sphere(radius), np.eye(3), middle
    edge = vertices[1] - vertices[0]
    length = float(np.linalg.norm(edge))
    return fcl.Capsule(radius, length), frame_along(edge / length), middle


def _winding(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """Return the winding number of triangles around points (N, 3), shape (N,).

    A. Van Oosterom and J. Strackee (1983), "The solid angle of a plane triangle", IEEE Transactions
    on Biomedical Engineering 30.
    """
    # Coordinates apart: far faster than small vectors side by side.
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
