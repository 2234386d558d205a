"""Signed distances of pairs of convex shapes, by FCL and, where they overlap, Coal.

FCL's distances can be too long by millimetres; the distances here are rigorous lower bounds, the
separations of two shapes along the directions that FCL finds, and exact nearly always. FCL ends the
process on some shapes that touch, so Coal measures the depth of an overlap. Where faces lie on each
other its direction is off by as much as 1e-4 rad; the normal of one of the faces is exact.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import coal
import fcl
import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.geometry.convex_shapes import (
    ClosestPoints,
    ConvexShape,
    convex_hull,
    frame_along,
    spread_directions,
)

# FCL needs a solid where a shape is a grown point or edge: a core of this thickness [m].
_CORE_THICKNESS = 1e-9
_NO_LENGTH = 1e-12  # [m]
# A bound this far below FCL's distance [m] is improved, in at most this many steps.
_LOOSE = 1e-5
_MAX_IMPROVEMENTS = 40
# Bounds of close shapes are improved from a smaller distance below on [m].
_CLOSE, _LOOSE_WHERE_CLOSE = 1e-3, 1e-7
_REQUEST = fcl.DistanceRequest(enable_nearest_points=True)
_SIGNED = coal.DistanceRequest()
_SIGNED.enable_signed_distance = True
# Coal refuses solids of which more edges than 255 meet at a corner.
_MAX_NEIGHBOURS = 250
_SETTLED = 1e-9  # [m]: a shorter vector between two hulls has no direction
# Corners of each hull that sort out directions at first, and directions measured together.
_FEW_CORNERS, _DIRECTIONS_AT_ONCE = 8, 16
_PAIRS_AT_ONCE = 256  # as many as keep their vertices in the processor's cache


class _Penetration(NamedTuple):
    """The overlap of two shapes' cores."""

    apart: float  # gap from the end of the first to the begin of the second along the direction [m]
    # from the first towards the second: moved along it by its depth, the second touches the first;
    # unit vector, shape (3,)
    direction: FloatArray
    first: FloatArray  # the deepest point of the first core, shape (3,) [m]
    second: FloatArray  # the deepest point of the second core, shape (3,) [m]


class PlacedShapes:
    """Convex shapes of bodies, which FCL moves to be measured."""

    def __init__(self, shapes: Sequence[ConvexShape]) -> None:
        """Take S shapes in their bodies' frames."""
        # Of shapes that were measured: few are where the native library measures the others.
        self._objects: dict[int, fcl.CollisionObject] = {}
        self._solids: dict[int, Any] = {}
        self._cores = np.empty((len(shapes), 4, 4))
        self._shapes = list(shapes)
        self._centers = np.array([shape.center for shape in shapes]).reshape(-1, 3)
        self._radii = np.array([shape.radius for shape in shapes])

    @cached_property
    def _vertices(self) -> FloatArray:
        """Vertices of all shapes, padded by the first of each, (S, V, 3) [m]."""
        most = max((len(shape.vertices) for shape in self._shapes), default=1)
        vertices = np.empty((len(self._shapes), most, 3))
        for index, shape in enumerate(self._shapes):
            vertices[index] = shape.vertices[0]
            vertices[index, : len(shape.vertices)] = shape.vertices
        return vertices

    def separations(
        self, pairs: IntArray, rotation: FloatArray, position: FloatArray
    ) -> ClosestPoints:
        """Return the closest points and distances of pairs (P, 2) of shapes.

        Any direction gives a bound: the gap from the end of the first to the begin of the second.
        FCL's nearest points give the best direction nearly always; elsewhere it is improved. Coal
        gives the direction of shapes that overlap. Poses of the bodies of both are rotations
        (P, 2, 3, 3) and positions (P, 2, 3) [m].

        Raises:
            ValueError: A pose is not finite: FCL would end the process.
        """
        near, far, overlap = self._nearest_points(pairs, rotation, position)
        gap, length = self._gaps(pairs, rotation, position, far - near)
        for row in np.flatnonzero(overlap):
            depth = self._penetration(pairs[row], rotation[row], position[row])
            _, gap[row], near[row], far[row] = depth
            length[row] = 1.0
        best, along = self._apart(pairs, rotation, position, gap / length[:, None])
        for row in np.flatnonzero(~overlap & (best <= length - _LOOSE)):
            apart, direction = self._improved(pairs[row], rotation[row], position[row], gap[row])
            if apart > best[row]:
                best[row], along[row] = apart, direction
        # The vector between nearest points of shapes that all but touch may point anywhere.
        allowed = np.where(length < _CLOSE, _LOOSE_WHERE_CLOSE, _LOOSE)
        for row in np.flatnonzero(~overlap & (best <= length - allowed)):
            depth = self._penetration(pairs[row], rotation[row], position[row])
            if depth.apart > best[row]:
                best[row], along[row], near[row], far[row] = depth
        return ClosestPoints(best - self._radii[pairs].sum(axis=1), along, near, far)

    def overlap(self, pairs: IntArray, rotation: FloatArray, position: FloatArray) -> bool:
        """Return True if any pair overlaps, by FCL; arguments as of `separations`."""
        rotations, positions = self._core_poses(pairs, rotation, position)
        for (i, j), axes, origins in zip(pairs.tolist(), rotations, positions, strict=True):
            first, second = self._moved(i, axes[0], origins[0]), self._moved(j, axes[1], origins[1])
            if fcl.distance(first, second, _REQUEST, fcl.DistanceResult()) <= (
                self._radii[i] + self._radii[j]
            ):
                return True
        return False

    def _nearest_points(
        self, pairs: IntArray, rotation: FloatArray, position: FloatArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return FCL's nearest points of both cores, (P, 3), and True where the cores overlap."""
        points, overlap = np.empty((2, len(pairs), 3)), np.empty(len(pairs), dtype=bool)
        rotations, positions = self._core_poses(pairs, rotation, position)
        for row, (i, j) in enumerate(pairs.tolist()):
            result = fcl.DistanceResult()
            first = self._moved(i, rotations[row, 0], positions[row, 0])
            second = self._moved(j, rotations[row, 1], positions[row, 1])
            overlap[row] = fcl.distance(first, second, _REQUEST, result) <= 0
            points[0, row], points[1, row] = result.nearest_points
        return points[0], points[1], overlap

    def _core_poses(
        self, pairs: IntArray, rotation: FloatArray, position: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return rotations and positions of the shapes' cores in the base frame."""
        if not (np.isfinite(rotation).all() and np.isfinite(position).all()):
            raise ValueError("poses must be finite")
        for index in {*pairs.ravel().tolist()} - {*self._objects}:
            geometry, self._cores[index] = _fcl_geometry(self._shapes[index])
            self._objects[index] = fcl.CollisionObject(geometry)
        core = self._cores[pairs]
        placed = np.einsum("pkij,pkj->pki", rotation, core[:, :, :3, 3]) + position
        return rotation @ core[:, :, :3, :3], placed

    def _moved(self, index: int, rotation: FloatArray, position: FloatArray) -> fcl.CollisionObject:
        placed = self._objects[index]
        placed.setTransform(fcl.Transform(rotation, position))
        return placed

    def _gaps(
        self, pairs: IntArray, rotation: FloatArray, position: FloatArray, gap: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return gaps (P, 3), replaced where they have no length, and their lengths (P,) [m]."""
        length = np.linalg.norm(gap, axis=1)
        for row in np.flatnonzero(length <= _NO_LENGTH):
            centers = np.einsum("kij,kj->ki", rotation[row], self._centers[pairs[row]])
            gap[row] = np.subtract(*(centers + position[row])[::-1])
            length[row] = np.linalg.norm(gap[row])
            if length[row] <= _NO_LENGTH:
                gap[row], length[row] = np.eye(3)[0], 1.0
        return gap, length

    def _apart(
        self, pairs: IntArray, rotation: FloatArray, position: FloatArray, direction: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the gaps of cores along lines [m], and unit vectors towards the second core."""
        low, high = np.empty((2, *pairs.shape))
        local = np.einsum("pkij,pi->pkj", rotation, direction)
        for begin in range(0, len(pairs), _PAIRS_AT_ONCE):
            rows = slice(begin, begin + _PAIRS_AT_ONCE)
            along = (self._vertices[pairs[rows]] @ local[rows, :, :, None])[..., 0]
            low[rows], high[rows] = along.min(axis=2), along.max(axis=2)
        offset = np.einsum("pki,pi->pk", position, direction)
        low, high = low + offset, high + offset
        ahead, behind = low[:, 1] - high[:, 0], low[:, 0] - high[:, 1]
        return np.maximum(ahead, behind), np.where(
            (ahead >= behind)[:, None], direction, -direction
        )

    def _penetration(
        self, pair: IntArray, rotation: FloatArray, position: FloatArray
    ) -> _Penetration:
        """Return the overlap of a pair of cores that overlap or touch; poses (2, 3, 3), (2, 3).

        The best of Coal's direction and of the normals of both shapes' faces.
        """
        cores = self._core_poses(pair[None], rotation[None], position[None])
        solids = []
        for index, *pose in zip(pair.tolist(), *(poses[0] for poses in cores), strict=True):
            if index not in self._solids:
                self._solids[index] = _coal_solid(self._shapes[index])
            solids += [self._solids[index], coal.Transform3s(*pose)]
        result = coal.DistanceResult()
        coal.distance(*solids, _SIGNED, result)
        shapes = [self._shapes[index] for index in pair]
        first, second = (
            shape.vertices @ axes.T + origin
            for shape, axes, origin in zip(shapes, rotation, position, strict=True)
        )
        normal, apart = np.array(result.normal), -np.inf
        if np.isfinite(normal).all():
            apart = float(_gaps(first, second, normal[None])[0])
        points = result.getNearestPoint1(), result.getNearestPoint2()
        candidates = [_Penetration(apart, normal, *points)]
        thinned = [shape.thinning.corners for shape in shapes]
        for k, (shape, sign) in enumerate(zip(shapes, (1.0, -1.0), strict=True)):
            normals = sign * shape.normals @ rotation[k].T
            above = max(each.apart for each in candidates)
            best = _largest_gap(first, second, normals, thinned, above)
            if best is None:
                continue
            apart, normal = best
            # The deepest corner of one shape, and the point across from it on the other's face.
            if k == 0:
                corner = second[(second @ normal).argmin()]
                points = corner - apart * normal, corner
            else:
                corner = first[(first @ normal).argmax()]
                points = corner, corner + apart * normal
            candidates.append(_Penetration(apart, normal, *points))
        return max(candidates, key=lambda each: each.apart)

    def _improved(
        self, pair: IntArray, rotation: FloatArray, position: FloatArray, gap: FloatArray
    ) -> tuple[float, FloatArray]:
        """Return an improved gap of two cores [m] and its unit vector (3,), starting from a gap."""
        first, second = (self._shapes[index].vertices for index in pair)
        back = rotation[1].T
        distance, direction = separating_directions(
            first,
            second,
            (back @ rotation[0])[None],
            (back @ (position[0] - position[1]))[None],
            (back @ gap)[None],
            max_steps=_MAX_IMPROVEMENTS,
            loose=_LOOSE,
        )
        return float(distance[0]), rotation[1] @ direction[0]


def _fcl_geometry(shape: ConvexShape) -> tuple[object, FloatArray]:
    """Return the core of a shape for FCL, and its pose in the body's frame, (4, 4)."""
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


def _coal_solid(shape: ConvexShape) -> Any:
    """Return a shape's core for Coal; balls and edges along z have a thickness.

    A shape with too many edges at a corner is replaced by its outermost corners: Coal gives only a
    direction, and gaps along it are measured with all corners.
    """
    if len(shape.vertices) == 1:
        return coal.Sphere(_CORE_THICKNESS)
    if len(shape.vertices) == 2:  # an edge
        length = float(np.linalg.norm(shape.vertices[1] - shape.vertices[0]))
        return coal.Box(_CORE_THICKNESS, _CORE_THICKNESS, length)
    if np.bincount(shape.faces.ravel()).max() > _MAX_NEIGHBOURS:
        directions = spread_directions(_MAX_NEIGHBOURS)
        outermost = np.unique((shape.vertices @ directions.T).argmax(axis=0))
        shape = convex_hull(shape.vertices[outermost])
    corners, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in shape.vertices:
        corners.append(corner)
    for face in shape.faces.tolist():
        triangles.append(coal.Triangle(*face))
    return coal.Convex(corners, triangles)


def _gaps(first: FloatArray, second: FloatArray, along: FloatArray) -> FloatArray:
    """Return the gaps from the first corners to the second along directions, (F,) [m]."""
    gaps: FloatArray = (second @ along.T).min(axis=0) - (first @ along.T).max(axis=0)
    return gaps


def _largest_gap(
    first: FloatArray,
    second: FloatArray,
    along: FloatArray,
    thinned: Sequence[IntArray],
    above: float,
) -> tuple[float, FloatArray] | None:
    """Return the largest gap above a value [m] along directions (F, 3), and its direction.

    None if no gap is. The gap of some corners, as of those of thinned hulls, given by their rows,
    is never below the gap of all: few corners show of nearly all directions that they are no use.
    """
    for count in (_FEW_CORNERS, None):
        bounds = _gaps(first[thinned[0][:count]], second[thinned[1][:count]], along)
        along, bounds = along[bounds > above], bounds[bounds > above]
    best, order = None, np.argsort(-bounds, kind="stable")
    for begin in range(0, len(order), _DIRECTIONS_AT_ONCE):
        rows = order[begin : begin + _DIRECTIONS_AT_ONCE]
        if bounds[rows[0]] <= above:
            break
        gaps = _gaps(first, second, along[rows])
        k = int(gaps.argmax())
        if gaps[k] > above:
            above, best = float(gaps[k]), along[rows[k]]
    return None if best is None else (above, best)


def separating_directions(
    first: FloatArray,
    second: FloatArray,
    rotation: FloatArray,
    moved: FloatArray,
    gap: FloatArray,
    *,
    max_steps: int,
    enough: float = np.inf,
    loose: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the gaps between two hulls in N poses (N,) [m], and their unit vectors (N, 3).

    Gilbert's iteration ("An iterative procedure for computing the minimum of a quadratic form on a
    convex set", 1966) towards the shortest vector between both hulls, on all poses together; each
    ends as soon as its gap is `enough`, or at most `loose` short of the distance [m]. Gaps are
    never above the distances, except by rounding. Vectors point from the first towards the second
    hull, in the frame of the second. Where hulls overlap a gap is negative, and says nothing about
    the depth. The first set (V, 3) has rotations (N, 3, 3) and origins (N, 3) in the frame of the
    second (W, 3); iterations begin with gaps (N, 3) from any point of the first hull to any of the
    second [m].
    """
    bound, normal = np.full(len(gap), -np.inf), np.zeros_like(gap)
    live, upper = np.arange(len(gap)), np.full(len(gap), np.inf)
    for _ in range(max_steps):
        length = np.linalg.norm(gap, axis=1)
        unsettled = (length > _SETTLED) & (bound[live] < np.minimum(enough, upper - loose))
        live, gap, length = live[unsettled], gap[unsettled], length[unsettled]
        upper = length
        if len(live) == 0:
            break
        direction = gap / length[:, None]
        local = np.einsum("nij,ni->nj", rotation[live], direction)
        support = first[(local @ first.T).argmax(axis=1)]
        behind = second[(direction @ second.T).argmin(axis=1)]
        end = behind - moved[live] - np.einsum("nij,nj->ni", rotation[live], support)
        apart = np.sum(direction * end, axis=1)
        better = apart > bound[live]
        bound[live[better]], normal[live[better]] = apart[better], direction[better]
        edge = end - gap  # whose nearest point to the origin is next
        squared = np.maximum(np.sum(edge**2, axis=1), _SETTLED**2)
        fraction = np.clip(-np.sum(gap * edge, axis=1) / squared, 0.0, 1.0)
        gap = gap + fraction[:, None] * edge
    return bound, normal
