"""Native distances of many pairs at many configurations: proved bounds, closest points.

How far a pair is apart along a direction is a lower bound on its distance, the distance of two of
its points an upper one. What is called proven has both within 1e-9 m of each other; of shapes
that overlap or all but touch nothing is proven.
"""

import ctypes
from typing import NamedTuple

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.native.library import Bytes, Doubles, Integers, native_function

_MULTIPLE = 4  # numbers that a processor takes at once: shapes' points are filled up to such
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
_least_room = native_function(
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
        radius: By which they are grown, (S,) [m].
        center: Of the bounding spheres, (S, 3) [m].
        reach: Their radii, (S,) [m].
        axes: Of the bounding boxes, as rows, (S, 3, 3).
        middle: Their centres along these, (S, 3) [m].
        half: Their half lengths, (S, 3) [m].
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
    """Where P pairs are closest.

    Attributes:
        distance: Lower bounds on the signed distances, (P,) [m].
        direction: Unit vectors from the first towards the second, in the frame of the second
            one's body, along which the pairs are that far apart, (P, 3).
        along: These in the base frame, (P, 3).
        first: In the base frame, nearest points of the first shapes' cores, (P, 3) [m].
        second: Likewise, of the second shapes' cores.
        proven: Whether the distance is surely exact, (P,).
    """

    distance: FloatArray
    direction: FloatArray
    along: FloatArray
    first: FloatArray
    second: FloatArray
    proven: BoolArray


class LeastRoom(NamedTuple):
    """The pair with the least distance beyond its required one, in N configurations.

    Attributes:
        room: What is left, (N,) [m]: exact if it is proven, `near` where no pair has less.
        pair: Which pair, (N,); -1: none has less than `near`.
        proven: Whether it is, (N,); if not, the pair overlaps or all but touches.
    """

    room: FloatArray
    pair: IntArray
    proven: BoolArray


class _Shapes(ctypes.Structure):
    """What the native functions know of shapes, as `struct Shapes` in convex_pairs.h."""

    _fields_ = [
        ("count", ctypes.c_int64),
        *((name, _ADDRESS) for name in ("body", "begin", "size", "points", "radius")),
        *((name, _ADDRESS) for name in ("center", "reach", "axes", "middle", "half")),
    ]


class NativeShapes:
    """Shapes whose pairs are measured natively; only if `IS_NATIVE`.

    Rotations (N, bodies, 3, 3) and positions (N, bodies, 3) [m] are of all bodies in N
    configurations; `row` tells in which of them each of P pairs (P, 2) is, shape (P,). Directions
    are unit vectors in the frame of the second shape's body.
    """

    def __init__(self, shapes: ShapeArrays) -> None:
        """Take shapes."""
        blocks = [_filled_up(vertices) for vertices in shapes.vertices]
        sizes = np.array([block.shape[1] for block in blocks], dtype=np.int64)
        points = np.concatenate([block.ravel() for block in blocks]) if blocks else np.zeros(0)
        kept = [shapes.body, 3 * (np.cumsum(sizes) - sizes), sizes]
        doubles = (points, shapes.radius, *shapes[3:])
        self._kept = [np.ascontiguousarray(array, dtype=np.int64) for array in kept]
        self._kept += [np.ascontiguousarray(array, dtype=np.float64) for array in doubles]
        self._shapes = _Shapes(len(blocks), *(array.ctypes.data for array in self._kept))
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
        """Return how far apart pairs are along directions (P, 3), shape (P,) [m].

        Args:
            rotation: Shape (N, bodies, 3, 3).
            position: Shape (N, bodies, 3) [m].
            row: Shape (P,).
            pairs: Shape (P, 2).
            direction: Shape (P, 3).
            enough: Shape (P,) [m]: pairs whose bounding spheres are that far apart are not looked
                at any closer, and of the others the larger bound is returned.
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
        """Return where pairs are closest; directions (P, 3), or zeros, begin the search."""
        count = len(pairs)
        found = np.zeros((count, 3)) if direction is None else np.array(direction, order="C")
        distance, vectors, proven = np.empty(count), np.empty((3, count, 3)), np.empty(count, bool)
        assert _closest_points is not None
        _closest_points(
            *self._poses(rotation, position), count, _integers(row), _integers(pairs),
            found, distance, *vectors, proven,
        )  # fmt: skip
        return FoundPoints(distance, found, vectors[0], vectors[1], vectors[2], proven)

    def near_distances(
        self,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        matters: FloatArray,
        known: FloatArray,
    ) -> tuple[FloatArray, BoolArray]:
        """Return distances of all pairs in all configurations, exact where they matter.

        Args:
            rotation: Shape (N, bodies, 3, 3), neighbours best one after the other.
            position: Shape (N, bodies, 3) [m].
            pairs: Shape (P, 2).
            matters: Below which distances are exact, shape (N, P) [m]; elsewhere lower bounds.
            known: Lower bounds that are known, shape (N, P) [m].

        Returns:
            Distances (N, P) [m], and where one that matters is not proven, (N, P).
        """
        bound, unproven = np.array(known, order="C"), np.empty(known.shape, dtype=bool)
        assert _near_distances is not None
        _near_distances(
            *self._poses(rotation, position), len(rotation), len(pairs), _integers(pairs),
            np.ascontiguousarray(matters), self._centers(), np.zeros((len(pairs), 3)),
            bound, unproven,
        )  # fmt: skip
        return bound, unproven

    def least_room(
        self,
        rotation: FloatArray,
        position: FloatArray,
        pairs: IntArray,
        required: FloatArray,
        near: float,
    ) -> LeastRoom:
        """Return which pair has the least distance beyond its required one in each configuration.

        Args:
            rotation: Shape (N, bodies, 3, 3), neighbours best one after the other.
            position: Shape (N, bodies, 3) [m].
            pairs: Shape (P, 2).
            required: Shape (P,) [m]; -inf: a pair that does not count.
            near: Pairs that have more do not matter [m].

        Returns:
            The pairs; the first one of a configuration that is not proven ends the search there.
        """
        count = len(rotation)
        room, pair, unproven = np.empty(count), np.empty(count, np.int64), np.empty(count, bool)
        assert _least_room is not None
        _least_room(
            *self._poses(rotation, position), count, len(pairs), _integers(pairs),
            np.ascontiguousarray(required, dtype=np.float64), near, self._centers(),
            np.zeros((len(pairs), 3)), room, pair, unproven,
        )  # fmt: skip
        return LeastRoom(room, pair, ~unproven)

    def _poses(
        self, rotation: FloatArray, position: FloatArray
    ) -> tuple[int, int, FloatArray, FloatArray]:
        placed = np.ascontiguousarray(rotation), np.ascontiguousarray(position)
        return self._address, rotation.shape[1], *placed

    def _centers(self) -> FloatArray:
        return np.empty((self._count, 3))


def _integers(array: IntArray) -> IntArray:
    return np.ascontiguousarray(array, dtype=np.int64)


def _filled_up(vertices: FloatArray) -> FloatArray:
    """Return vertices by coordinate, shape (3, V), the first one repeated at the end."""
    missing = -len(vertices) % _MULTIPLE
    return np.concatenate([vertices, np.repeat(vertices[:1], missing, axis=0)]).T
