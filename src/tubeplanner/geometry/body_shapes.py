"""BodyShapes: convex shapes on a robot's bodies and their distances, native or FCL.

Native distances count where they are proved: where a lower bound, the gap along a direction, and
an upper bound agree to 1e-9 m: the distance of two points, or minus the radius of a ball that two
overlapping shapes' differences contain. Pairs without proof, which all but touch or overlap with
parallel faces and edges, are measured by FCL and Coal, as are all without the native library.
"""

import ctypes
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.convex_shapes import (
    BoundingBoxes,
    ClosestPoints,
    ConvexShape,
    bounding_boxes,
)
from tubeplanner.native.library import Bytes, Doubles, Integers, native_function
from tubeplanner.robot.model import RobotModel

if TYPE_CHECKING:
    from tubeplanner.geometry.distances import PlacedShapes

_SIZE, _ADDRESS = ctypes.c_int64, ctypes.c_void_p
_POSES = (_ADDRESS, _SIZE, Doubles, Doubles)  # of shapes: bodies, rotations, origins
_sphere_gaps = native_function(
    "tubeplanner_sphere_gaps", *_POSES, _SIZE, _SIZE, Integers, Doubles, Doubles
)
_box_gaps = native_function("tubeplanner_box_gaps", *_POSES, _SIZE, Integers, Integers, Doubles)
_gaps_along = native_function(
    "tubeplanner_gaps_along", *_POSES, _SIZE, Integers, Integers, *(Doubles,) * 3
)
_closest_points = native_function(
    "tubeplanner_closest_points", *_POSES, _SIZE, Integers, Integers, *(Doubles,) * 5, Bytes
)
_near_distances = native_function(
    "tubeplanner_near_distances", *_POSES, _SIZE, _SIZE, Integers, *(Doubles,) * 4, Bytes
)
IS_NATIVE = _sphere_gaps is not None
_MULTIPLE = 4  # numbers that a processor takes at once: shapes' points are padded to multiples
# Without the native library configurations are visited coarse to fine, with these strides: a
# neighbour visited before provides a direction that separates a pair.
_STRIDES = (64, 16, 4, 1)


@dataclass(frozen=True, eq=False)
class BodyShape:
    """One convex shape and its owner."""

    owner: str  # name of the link or obstacle
    body: int  # index of the robot's body that carries it; 0 is fixed
    shape: ConvexShape  # in the body's frame


class _ThreadShapes(threading.local):
    """Shapes that FCL moves to be measured; each thread has its own, from its first use on."""

    def __init__(self, shapes: Sequence[BodyShape]) -> None:
        self._body_shapes = shapes

    @cached_property
    def shapes(self) -> "PlacedShapes":
        from tubeplanner.geometry.distances import PlacedShapes

        return PlacedShapes([body_shape.shape for body_shape in self._body_shapes])


class NativeShapes(ctypes.Structure):
    """Shapes as the native functions take them, `struct Shapes` in convex_pairs.h."""

    _arrays: list[Any]  # of the addresses
    _fields_ = [
        ("count", ctypes.c_int64),
        *((name, _ADDRESS) for name in ("body", "begin", "size", "points", "radius")),
        *((name, _ADDRESS) for name in ("center", "reach", "axes", "middle", "half")),
    ]

    @classmethod
    def of(cls, shapes: "BodyShapes") -> "NativeShapes":
        """Return shapes with their bounding spheres and boxes."""
        blocks = []  # the vertices of each shape by coordinate, (3, V), padded by the first
        for each in shapes.shapes:
            vertices = each.shape.vertices
            padding = np.repeat(vertices[:1], -len(vertices) % _MULTIPLE, axis=0)
            blocks.append(np.concatenate([vertices, padding]).T)
        sizes = np.array([block.shape[1] for block in blocks], dtype=np.int64)
        points = np.concatenate([block.ravel() for block in blocks]) if blocks else np.zeros(0)
        radius, boxes = [each.shape.radius for each in shapes.shapes], shapes._boxes
        integers = [shapes._bodies, 3 * (np.cumsum(sizes) - sizes), sizes]
        doubles = [points, radius, *shapes._spheres, boxes.axes, boxes.center, boxes.half]
        arrays = [np.ascontiguousarray(array, dtype=np.int64) for array in integers]
        arrays += [np.ascontiguousarray(array, dtype=np.float64) for array in doubles]
        native = cls(len(blocks), *(array.ctypes.data for array in arrays))
        native._arrays = arrays
        return native

    def call(
        self,
        function: Callable[..., Any] | None,
        rotation: FloatArray,
        position: FloatArray,
        *arguments: object,
    ) -> None:
        """Call a native function with these shapes on bodies in N configurations."""
        assert function is not None
        placed = np.ascontiguousarray(rotation), np.ascontiguousarray(position)
        function(ctypes.addressof(self), rotation.shape[1], *placed, *arguments)


class BodyShapes:
    """Shapes on the bodies of a robot.

    Several threads may use one object; it pickles by content, without any file.

    In all methods, N configurations have `rotation`, shape (N, bodies, 3, 3), and `position`, shape
    (N, bodies, 3) [m], of all bodies, as from `RobotModel.body_poses`; `pairs` are P pairs of
    indices of `shapes`, shape (P, 2); `row` is the configuration of each pair, shape (P,), None:
    each in its own.

    Attributes:
        robot: The arm.
        shapes: The shapes.
    """

    def __init__(self, robot: RobotModel, shapes: Sequence[BodyShape]) -> None:
        """Take shapes on the links of a robot."""
        self.robot = robot
        self.shapes = list(shapes)
        self._placed = _ThreadShapes(self.shapes)

    def _add(self, shapes: Sequence[BodyShape]) -> None:
        """Append shapes."""
        if shapes:
            self.shapes += shapes
            for derived in ("_bodies", "_boxes", "_native", "_spheres"):
                vars(self).pop(derived, None)
            self._placed = _ThreadShapes(self.shapes)

    def __getstate__(self) -> dict[str, Any]:
        addresses = ("_placed", "_native")
        return {name: value for name, value in vars(self).items() if name not in addresses}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._placed = _ThreadShapes(self.shapes)

    def distances(self, rotation: FloatArray, position: FloatArray, pairs: IntArray) -> FloatArray:
        """Return lower bounds on the signed distances of pairs at one configuration, (P,) [m].

        Negative where shapes overlap; never above the true distance, except by rounding. Poses of
        all bodies are of shape (bodies, 3, 3) and (bodies, 3) [m].

        Raises:
            ValueError: A pose is not finite.
        """
        return self.separations(rotation, position, pairs)[0]

    def separations(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return `distances` (P,) [m] and the unit vectors along which they are measured, (P, 3).

        From the first towards the second shape of each pair, in the frame of the second shape's
        body.
        """
        row = np.zeros(len(pairs), dtype=np.int64)
        return self.separations_at(rotation[None], position[None], pairs, row)

    def separations_at(
        self,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        row: IntArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return `separations` in several configurations."""
        closest, direction = self._measured(rotation, position, pairs, row)
        return closest.distance, direction

    def closest_points(
        self,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        row: IntArray | None = None,
    ) -> ClosestPoints:
        """Return the closest points of pairs in several configurations.

        Raises:
            ValueError: A pose is not finite.
        """
        return self._measured(rotation, position, pairs, row)[0]

    def _measured(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray, row: IntArray | None
    ) -> tuple[ClosestPoints, FloatArray]:
        """Return the closest points of pairs, and directions in the second shapes' frames."""
        row, count = _rows(pairs, row), len(pairs)
        distance, vectors, proven = np.empty(count), np.empty((3, count, 3)), np.zeros(count, bool)
        closest, local = ClosestPoints(distance, *vectors), np.zeros((count, 3))
        if self._native is not None:
            indices = count, _integers(row), _integers(pairs)
            self._native.call(
                _closest_points, rotation, position, *indices, local, distance, *vectors, proven
            )
        unproven = np.flatnonzero(~proven)
        if len(unproven):
            pairs, row = pairs[unproven], row[unproven]
            exact = self._by_fcl(rotation, position, pairs, row)
            for name, values in vars(exact).items():
                getattr(closest, name)[unproven] = values
            frames = rotation[row, self._bodies[pairs[:, 1]]]
            local[unproven] = np.einsum("pij,pi->pj", frames, exact.direction)
        return closest, local

    def _by_fcl(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray, row: IntArray
    ) -> ClosestPoints:
        bodies = self._bodies[pairs]
        placed = rotation[row[:, None], bodies], position[row[:, None], bodies]
        return self._placed.shapes.separations(pairs, *placed)

    def near_distances(
        self, q: FloatArray, pairs: IntArray, matters: FloatArray, known: FloatArray
    ) -> FloatArray:
        """Return distances of pairs in configurations q (N, n) that follow each other, (N, P) [m].

        Distances below `matters` (N, P) [m] are exact. Others are lower bounds: `known` ones (N, P)
        [m], from spheres, or along a direction that separates the pair.
        """
        rotation, position = poses = self.robot.body_poses(q)
        if self._native is None:
            return self._near_distances(rotation, position, pairs, matters, known)
        bound, unproven = np.array(known, order="C"), np.empty(known.shape, dtype=bool)
        self._native.call(
            _near_distances, *poses, len(q), len(pairs), _integers(pairs),
            np.ascontiguousarray(matters), self._workspace(), np.zeros((len(pairs), 3)),
            bound, unproven,
        )  # fmt: skip
        row, pair = np.nonzero(unproven)
        if len(row):
            bound[row, pair] = self._by_fcl(*poses, pairs[pair], row).distance
        return bound

    def _near_distances(
        self,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        matters: FloatArray,
        known: FloatArray,
    ) -> FloatArray:
        """Return `near_distances` without the native library."""
        bound = np.maximum(self.sphere_distances(rotation, position, pairs), known)
        near = bound < matters
        direction, is_measured = np.zeros((*bound.shape, 3)), np.zeros(bound.shape, dtype=bool)
        before = len(bound)
        for stride in _STRIDES:
            samples = np.arange(0, len(bound), stride)
            samples = samples[(samples % before != 0) | (before == len(bound))]
            row, pair = np.nonzero(near[samples])
            row = samples[row]
            last = row - row % before
            has_direction = np.flatnonzero(is_measured[last, pair])
            direction[row, pair] = direction[last, pair]
            is_measured[row, pair] = True
            at = (row[has_direction], pair[has_direction])
            along = self.separations_along(rotation, position, pairs[at[1]], direction[at], at[0])
            bound[at] = np.maximum(bound[at], along)
            close = bound[row, pair] < matters[row, pair]
            for i in np.unique(row[close]):
                columns = pair[close & (row == i)]
                bound[i, columns], direction[i, columns] = self.separations(
                    rotation[i], position[i], pairs[columns]
                )
            before = stride
        return bound

    def distance_gradient(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray, closest: ClosestPoints
    ) -> FloatArray:
        """Return the derivative of P distances by the joints, shape (P, n) [m/rad or 1].

        Each pair is in its own configuration; `closest` is the result of `closest_points` for
        these.
        """
        gradient = np.zeros((len(pairs), self.robot.joint_count))
        for sign, column, point in ((-1, 0, closest.first), (1, 1, closest.second)):
            body = self._bodies[pairs[:, column]]
            jacobian = self.robot.point_jacobian(rotation, position, body, point)
            gradient += sign * np.einsum("pi,pij->pj", closest.direction, jacobian)
        return gradient

    def any_overlap(self, rotation: FloatArray, position: FloatArray, pairs: IntArray) -> bool:
        """Return True if any of some pairs (P, 2) overlaps; arguments as of `distances`.

        FCL alone decides, quicker than `distances`: an overlap of some millimetres may be missed.
        """
        bodies = self._bodies[pairs]
        return self._placed.shapes.overlap(pairs, rotation[bodies], position[bodies])

    def separations_along(
        self,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        direction: FloatArray,
        row: IntArray | None = None,
    ) -> FloatArray:
        """Return the gaps of pairs along given directions, in several configurations, (P,) [m].

        A direction that separates a pair also separates it in neighbouring configurations, almost
        as far: a quick lower bound on the distance. `direction` is of unit vectors as from
        `separations`, shape (P, 3).
        """
        row = _rows(pairs, row)
        result = np.empty(len(pairs))
        if self._native is not None:
            indices = len(pairs), _integers(row), _integers(pairs)
            unit_vectors = np.ascontiguousarray(direction)
            self._native.call(_gaps_along, rotation, position, *indices, unit_vectors, None, result)
            return result
        order = np.lexsort(pairs.T)
        groups = np.flatnonzero(np.any(np.diff(pairs[order], axis=0) != 0, axis=1)) + 1
        for rows in np.split(order, groups) if len(order) else ():
            first, second = (self.shapes[index] for index in pairs[rows[0]])
            at, along = row[rows], direction[rows]
            world_direction = np.einsum("pij,pj->pi", rotation[at, second.body], along)
            local = np.einsum("pij,pi->pj", rotation[at, first.body], world_direction)
            farthest = (local @ first.shape.vertices.T).max(axis=1) + first.shape.radius
            nearest = (along @ second.shape.vertices.T).min(axis=1) - second.shape.radius
            offset = position[at, second.body] - position[at, first.body]
            result[rows] = nearest - farthest + np.einsum("pi,pi->p", world_direction, offset)
        return result

    def sphere_distances(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray
    ) -> FloatArray:
        """Return quick, loose lower bounds from bounding spheres, shape (N, P) [m]."""
        if self._native is None:
            return self.gaps_of_spheres(self.sphere_centers(rotation, position), pairs)
        gaps = np.empty((len(rotation), len(pairs)))
        indices = len(rotation), len(pairs), _integers(pairs)
        self._native.call(_sphere_gaps, rotation, position, *indices, self._workspace(), gaps)
        return gaps

    def sphere_centers(self, rotation: FloatArray, position: FloatArray) -> FloatArray:
        """Return the centres of the bounding spheres of all S shapes, shape (N, S, 3) [m]."""
        centers, _ = self._spheres
        rotated = np.einsum("nsij,sj->nsi", rotation[:, self._bodies], centers)
        placed: FloatArray = rotated + position[:, self._bodies]
        return placed

    def gaps_of_spheres(self, centers: FloatArray, pairs: IntArray) -> FloatArray:
        """Return `sphere_distances` (N, P) of pairs (P, 2) from `sphere_centers` (N, S, 3) [m]."""
        radii, (first, second) = self._spheres[1], pairs.T
        gap = np.linalg.norm(centers[:, first] - centers[:, second], axis=2)
        return gap - radii[first] - radii[second]

    def box_distances(
        self, rotation: FloatArray, position: FloatArray, row: IntArray, pairs: IntArray
    ) -> FloatArray:
        """Return lower bounds on distances, of each shape's sphere from the other's box, (P,) [m].

        Closer than `sphere_distances` where a shape is long or flat.
        """
        if self._native is not None:
            gaps = np.empty(len(pairs))
            indices = len(pairs), _integers(row), _integers(pairs)
            self._native.call(_box_gaps, rotation, position, *indices, gaps)
            return gaps
        centers, radii = self._spheres
        bodies, bounds = self._bodies[pairs], []
        rotations, positions = rotation[row[:, None], bodies], position[row[:, None], bodies]
        world = np.einsum("mkij,mkj->mki", rotations, centers[pairs]) + positions
        for ball, box in ((0, 1), (1, 0)):
            away = np.einsum("mij,mi->mj", rotations[:, box], world[:, ball] - positions[:, box])
            bounds.append(self._boxes.distance(pairs[:, box], away) - radii[pairs[:, ball]])
        return np.maximum(*bounds)

    def motion_weights(self, pairs: IntArray) -> FloatArray:
        """Return bounds on the speed at which joints approach pairs: (P, n) [m per rad or m].

        When the joints travel by `|dq|`, the distance of a pair changes by at most
        `weights @ |dq|`. A joint that moves both shapes of a pair as one does not count.
        """
        reach = np.array([shape.shape.reach(np.zeros(3)) for shape in self.shapes])
        first, second = pairs.T
        return self.robot.approach_rates(
            (self._bodies[first], self._bodies[second]), (reach[first], reach[second])
        )

    @cached_property
    def _bodies(self) -> IntArray:
        return np.array([shape.body for shape in self.shapes], dtype=np.int64)

    @cached_property
    def _boxes(self) -> BoundingBoxes:
        return bounding_boxes([shape.shape for shape in self.shapes])

    @cached_property
    def _native(self) -> NativeShapes | None:
        """The same shapes for the native library; None without the library."""
        return NativeShapes.of(self) if IS_NATIVE else None

    def _workspace(self) -> FloatArray:
        """Return memory for the centres of all spheres in a configuration."""
        return np.empty((len(self.shapes), 3))

    @cached_property
    def _spheres(self) -> tuple[FloatArray, FloatArray]:
        centers = np.array([shape.shape.center for shape in self.shapes]).reshape(-1, 3)
        return centers, np.array([shape.shape.bounding_radius for shape in self.shapes])


def _rows(pairs: IntArray, row: IntArray | None) -> IntArray:
    return np.arange(len(pairs)) if row is None else row


def _integers(array: IntArray) -> IntArray:
    return np.ascontiguousarray(array, dtype=np.int64)
