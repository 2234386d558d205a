"""Native distances of many pairs at many configurations: proved bounds, closest points.

The gap of a pair along a direction is a lower bound on its distance, the distance of two of its
points an upper bound. Proven distances have both within 1e-9 m of each other; distances of shapes
that overlap or all but touch are never proven.
"""

import ctypes
from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.native.library import Bytes, Doubles, Integers, native_function

_MULTIPLE = 4  # numbers that a processor takes at once: shapes' points are padded to multiples
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
_least_slack = native_function(
    "tubeplanner_least_room",
    *(*_POSES, _SIZE, _SIZE, Integers, Doubles, ctypes.c_double),
    *(Doubles, Doubles, Doubles, Integers, Bytes),
)
IS_NATIVE = _sphere_gaps is not None


class ShapeArrays(NamedTuple):
    """S convex shapes, each in the frame of the body that carries it.

    Attributes:
        body: Shape (S,).
        vertices: Of each shape, (V, 3) [m].
        radius: Growth of the shapes, (S,) [m].
        center: Of the bounding spheres, (S, 3) [m].
        reach: Radii of the bounding spheres, (S,) [m].
        axes: Of the bounding boxes, as rows, (S, 3, 3).
        middle: Centres of the boxes along their axes, (S, 3) [m].
        half: Half lengths of the boxes, (S, 3) [m].
    """

    body: IntArray
    vertices: list[FloatArray]
    radius: FloatArray
    center: FloatArray
    reach: FloatArray
    axes: FloatArray
    middle: FloatArray
    half: FloatArray


class FoundPoints(NamedTuple):
    """The closest points of P pairs.

    Attributes:
        distance: Lower bounds on the signed distances, (P,) [m].
        direction: Unit vectors from the first towards the second shape, in the frame of the second
            shape's body, along which the pairs are that far apart, (P, 3).
        along: The same vectors in the base frame, (P, 3).
        first: Nearest points of the first shapes' cores in the base frame, (P, 3) [m].
        second: Likewise, of the second shapes' cores.
        proven: True where the distance is surely exact, (P,).
    """

    distance: FloatArray
    direction: FloatArray
    along: FloatArray
    first: FloatArray
    second: FloatArray
    proven: BoolArray


class LeastSlack(NamedTuple):
    """The pair with the least slack beyond its required distance, in N configurations.

    Attributes:
        slack: The slack, (N,) [m]: exact if proven, `near` where no pair has less.
        pair: Index of the pair, (N,); -1: none has less than `near`.
        proven: True where the slack is proven, (N,); else the pair overlaps or all but touches.
    """

    slack: FloatArray
    pair: IntArray
    proven: BoolArray


class _Shapes(ctypes.Structure):
    """Shapes as the native functions take them, `struct Shapes` in convex_pairs.h."""

    _fields_ = [
        ("count", ctypes.c_int64),
        *((name, _ADDRESS) for name in ("body", "begin", "size", "points", "radius")),
        *((name, _ADDRESS) for name in ("center", "reach", "axes", "middle", "half")),
    ]


class NativeShapes:
    """Shapes whose pairs are measured natively; only if `IS_NATIVE`.

    Rotations (N, bodies, 3, 3) and positions (N, bodies, 3) [m] are of all bodies in N
    configurations; `row` is the configuration of each of P pairs (P, 2), shape (P,). Directions are
    unit vectors in the frame of the second shape's body.
    """

    def __init__(self, shapes: ShapeArrays) -> None:
        """Take shapes."""
        blocks = []  # the vertices of each shape by coordinate, (3, V), padded by the first
        for vertices in shapes.vertices:
            padding = np.repeat(vertices[:1], -len(vertices) % _MULTIPLE, axis=0)
            blocks.append(np.concatenate([vertices, padding]).T)
        sizes = np.array([block.shape[1] for block in blocks], dtype=np.int64)
        points = np.concatenate([block.ravel() for block in blocks]) if blocks else np.zeros(0)
        integers = [shapes.body, 3 * (np.cumsum(sizes) - sizes), sizes]
        doubles = (points, shapes.radius, *shapes[3:])
        # The native struct has only the addresses: these references keep the arrays alive.
        self._arrays = [np.ascontiguousarray(array, dtype=np.int64) for array in integers]
        self._arrays += [np.ascontiguousarray(array, dtype=np.float64) for array in doubles]
        self._shapes = _Shapes(len(blocks), *(array.ctypes.data for array in self._arrays))
        self._address = ctypes.addressof(self._shapes)
        self._count = len(blocks)

    def sphere_gaps(
        self, rotation: FloatArray, position: FloatArray, pairs: IntArray
    ) -> FloatArray:
        """Return lower bounds on distances from bounding spheres, (N, P) [m]."""
        gaps = np.empty((len(rotation), len(pairs)))
        assert _sphere_gaps is not None
        _sphere_gaps(
            *self._poses(rotation, position), len(rotation), len(pairs), _integers(pairs),
            self._centers(), gaps,
        )  # fmt: skip
        return gaps

    def box_gaps(
        self, rotation: FloatArray, position: FloatArray, row: IntArray, pairs: IntArray
    ) -> FloatArray:
        """Return lower bounds on distances from each shape's sphere and the other's box, (P,)."""
        gaps = np.empty(len(pairs))
        assert _box_gaps is not None
        poses = self._poses(rotation, position)
        _box_gaps(*poses, len(pairs), _integers(row), _integers(pairs), gaps)
        return gaps

    def gaps_along(
        self,
        rotation: FloatArray,
        position: FloatArray,
        row: IntArray,
        pairs: IntArray,
        direction: FloatArray,
        enough: FloatArray | None = None,
    ) -> FloatArray:
        """Return the gaps of pairs along directions (P, 3), shape (P,) [m].

        Pairs whose bounding spheres are at least `enough`, shape (P,) [m], apart are not looked at
        any closer; of the others the larger bound is returned.
        """
        gaps = np.empty(len(pairs))
        assert _gaps_along is not None
        _gaps_along(
            *self._poses(rotation, position), len(pairs), _integers(row), _integers(pairs),
            np.ascontiguousarray(direction), enough, gaps,
        )  # fmt: skip
        return gaps

    def closest_points(
        self,
        rotation: FloatArray,
        position: FloatArray,
        row: IntArray,
        pairs: IntArray,
        direction: FloatArray | None = None,
    ) -> FoundPoints:
        """Return the closest points of pairs; directions (P, 3), or zeros, begin the search."""
        count = len(pairs)
        local = np.zeros((count, 3)) if direction is None else np.array(direction, order="C")
        distance, vectors, proven = np.empty(count), np.empty((3, count, 3)), np.empty(count, bool)
        assert _closest_points is not None
        _closest_points(
            *self._poses(rotation, position), count, _integers(row), _integers(pairs),
            local, distance, *vectors, proven,
        )  # fmt: skip
        return FoundPoints(distance, local, vectors[0], vectors[1], vectors[2], proven)

    def near_distances(
        self,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        matters: FloatArray,
        known: FloatArray,
    ) -> tuple[FloatArray, BoolArray]:
        """Return `BodyShapes.near_distances`, and True where a distance that matters is not proven.

        Both of shape (N, P).
        """
        bound, unproven = np.array(known, order="C"), np.empty(known.shape, dtype=bool)
        assert _near_distances is not None
        _near_distances(
            *self._poses(rotation, position), len(rotation), len(pairs), _integers(pairs),
            np.ascontiguousarray(matters), self._centers(), np.zeros((len(pairs), 3)),
            bound, unproven,
        )  # fmt: skip
        return bound, unproven

    def least_slack(
        self,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        required: FloatArray,
        near: float,
    ) -> LeastSlack:
        """Return `BodyShapes.least_slack`; a pair that is not proven ends the search."""
        count = len(rotation)
        slack, pair, unproven = np.empty(count), np.empty(count, np.int64), np.empty(count, bool)
        assert _least_slack is not None
        _least_slack(
            *self._poses(rotation, position), count, len(pairs), _integers(pairs),
            np.ascontiguousarray(required, dtype=np.float64), near, self._centers(),
            np.zeros((len(pairs), 3)), slack, pair, unproven,
        )  # fmt: skip
        return LeastSlack(slack, pair, ~unproven)

    def _poses(
        self, rotation: FloatArray, position: FloatArray
    ) -> tuple[int, int, FloatArray, FloatArray]:
        placed = np.ascontiguousarray(rotation), np.ascontiguousarray(position)
        return self._address, rotation.shape[1], *placed

    def _centers(self) -> FloatArray:
        return np.empty((self._count, 3))


def _integers(array: IntArray) -> IntArray:
    return np.ascontiguousarray(array, dtype=np.int64)
