"""The signed distance of two convex shapes, by FCL.

FCL's distances can be too long by millimetres; what is returned here is a rigorous lower bound,
the separation of the two shapes along the direction that FCL finds, and exact nearly always.
"""

import math
from operator import itemgetter
from typing import NamedTuple

import fcl
import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import ConvexShape, frame_along
from tubeplanner.collision.gilbert import separating_directions

# FCL needs a solid where a shape is a grown point or edge: a core this thin [m].
_CORE_THICKNESS = 1e-9
_NO_LENGTH = 1e-12  # [m]
# A bound this far below FCL's distance [m] is improved, in at most so many steps.
_LOOSE = 1e-5
_MAX_IMPROVEMENTS = 40
_REQUEST = fcl.DistanceRequest(enable_nearest_points=True, enable_signed_distance=True)


class PlacedShape:
    """A convex shape of a body, and where that body is.

    Attributes:
        radius: By which the shape's vertices are grown [m].
    """

    def __init__(self, shape: ConvexShape) -> None:
        """Take a shape in its body's frame; it must be placed before it is measured."""
        geometry, self._core = _fcl_geometry(shape)
        self._object = fcl.CollisionObject(geometry)
        self._vertices = shape.vertices
        self._center = shape.center
        self.radius = shape.radius

    def move(self, rotation: FloatArray, position: FloatArray) -> None:
        """Place the shape by its body's rotation (3, 3) and origin (3,) [m].

        Raises:
            ValueError: The pose is not finite: FCL would end the process.
        """
        if not (np.isfinite(rotation).all() and np.isfinite(position).all()):
            raise ValueError("poses must be finite")
        self._rotation, self._position = rotation, position
        core_rotation = self._rotation @ self._core[:3, :3]
        core_position = self._rotation @ self._core[:3, 3] + self._position
        self._object.setTransform(fcl.Transform(core_rotation, core_position))

    def extremes(self, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the core's vertices farthest back and farthest ahead along a direction, (3,)."""
        along = self._vertices @ (self._rotation.T @ direction)
        ends = self._vertices[[along.argmin(), along.argmax()]]
        back, ahead = ends @ self._rotation.T + self._position
        return back, ahead

    def nearest_points(self, other: "PlacedShape") -> tuple[FloatArray, FloatArray, bool]:
        """Return FCL's nearest points of both cores, (3,), and whether the cores overlap."""
        result = fcl.DistanceResult()
        distance = fcl.distance(self._object, other._object, _REQUEST, result)
        near, far = result.nearest_points
        return near, far, distance <= 0

    def overlaps(self, other: "PlacedShape") -> bool:
        """Return whether both shapes overlap, as FCL has it."""
        distance = fcl.distance(self._object, other._object, _REQUEST, fcl.DistanceResult())
        return bool(distance <= self.radius + other.radius)

    def center_to(self, other: "PlacedShape") -> FloatArray:
        """Return the vector from the middle of this shape to that of another, (3,)."""
        return other._world_center() - self._world_center()

    def separated(self, other: "PlacedShape", gap: FloatArray) -> tuple[float, FloatArray]:
        """Return how far apart both cores are [m], along which direction (3,): found from a gap."""
        back = other._rotation.T
        distance, direction = separating_directions(
            self._vertices,
            other._vertices,
            (back @ self._rotation)[None],
            (back @ (self._position - other._position))[None],
            (back @ gap)[None],
            max_steps=_MAX_IMPROVEMENTS,
            loose=_LOOSE,
        )
        return float(distance[0]), other._rotation @ direction[0]

    def _world_center(self) -> FloatArray:
        return self._rotation @ self._center + self._position


class Separation(NamedTuple):
    """How far two shapes are apart.

    Attributes:
        distance: Lower bound on the signed distance [m].
        direction: Unit vector from the first towards the second, base frame, shape (3,).
        first: FCL's nearest point of the first shape's core, base frame, shape (3,) [m].
        second: Likewise, of the second shape's core.
    """

    distance: float
    direction: FloatArray
    first: FloatArray
    second: FloatArray


def separation(first: PlacedShape, second: PlacedShape) -> Separation:
    """Return how far two shapes are apart.

    Any direction gives a bound: how far the second begins beyond the end of the first. FCL's
    nearest points give the best direction nearly always. Where they do not, it is improved.
    """
    near, far, overlap = first.nearest_points(second)
    gap = far - near
    length = _length(gap)
    if length <= _NO_LENGTH:
        gap = first.center_to(second)
        length = _length(gap)
    if length <= _NO_LENGTH:
        gap, length = np.eye(3)[0], 1.0
    best, along = _apart(first, second, gap / length)
    if not overlap and best <= length - _LOOSE:
        best, along = max((best, along), first.separated(second, gap), key=itemgetter(0))
    return Separation(best - first.radius - second.radius, along, near, far)


def _apart(
    first: PlacedShape, second: PlacedShape, direction: FloatArray
) -> tuple[float, FloatArray]:
    """Return how far apart two cores are along a line [m], and which way the second lies."""
    back_1, ahead_1 = first.extremes(direction)
    back_2, ahead_2 = second.extremes(direction)
    ahead, behind = float(direction @ (back_2 - ahead_1)), float(direction @ (ahead_2 - back_1))
    return (ahead, direction) if ahead >= -behind else (-behind, -direction)


def _length(vector: FloatArray) -> float:
    return math.sqrt(vector @ vector)


def _fcl_geometry(shape: ConvexShape) -> tuple[object, FloatArray]:
    """Return the core of a shape as FCL has it, and its pose in the body's frame, (4, 4)."""
    core = np.eye(4)
    if len(shape.vertices) > 2:
        triangles = shape.faces
        faces = np.hstack([np.full((len(triangles), 1), 3), triangles]).ravel()
        return fcl.Convex(shape.vertices, len(triangles), faces), core
    core[:3, 3] = shape.center
    if len(shape.vertices) == 1:
        return fcl.Sphere(_CORE_THICKNESS), core
    edge = shape.vertices[1] - shape.vertices[0]
    length = float(np.linalg.norm(edge))
    core[:3, :3] = frame_along(edge / length)
    return fcl.Box(_CORE_THICKNESS, _CORE_THICKNESS, length), core
