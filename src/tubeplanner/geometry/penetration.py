"""Separating directions of two convex shapes; depth of an overlap, by Coal."""

from typing import Any, NamedTuple

import coal
import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.geometry.convex_shapes import ConvexShape, convex_hull, spread_directions

# ---- Directions that separate two convex shapes, in many configurations at once.

_NO_LENGTH = 1e-9  # [m]


def separating_directions(
    first: FloatArray,
    second: FloatArray,
    turned: FloatArray,
    moved: FloatArray,
    gap: FloatArray,
    *,
    max_steps: int,
    enough: float = np.inf,
    loose: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return how far apart the hulls of two sets of points are, and along which directions.

    Gilbert's iteration ("An iterative procedure for computing the minimum of a quadratic form on a
    convex set", 1966) towards the shortest vector between both hulls, on all configurations
    together; each ends as soon as it has enough.

    Args:
        first: Points of the first set, shape (V, 3) [m].
        second: Points of the second set, in its frame, shape (W, 3) [m].
        turned: Rotations of the first set into the frame of the second, shape (N, 3, 3).
        moved: Where the origin of the first set then is, shape (N, 3) [m].
        gap: From any point of the first hull to any of the second, to begin with, (N, 3) [m].
        max_steps: Of the iteration.
        enough: A distance beyond which it does not matter [m].
        loose: By how much distances may fall short of what they could be [m].

    Returns:
        Distances (N,) [m], never above the true ones, except by rounding, and unit vectors (N, 3)
        from the first towards the second hull, in the frame of the second. Where hulls overlap a
        distance is negative, and says nothing about the depth.
    """
    bound, found = np.full(len(gap), -np.inf), np.zeros_like(gap)
    live, known = np.arange(len(gap)), np.full(len(gap), np.inf)
    for _ in range(max_steps):
        length = np.linalg.norm(gap, axis=1)
        unsettled = (length > _NO_LENGTH) & (bound[live] < np.minimum(enough, known - loose))
        live, gap, length = live[unsettled], gap[unsettled], length[unsettled]
        known = length
        if len(live) == 0:
            break
        direction = gap / length[:, None]
        local = np.einsum("nij,ni->nj", turned[live], direction)
        support = first[(local @ first.T).argmax(axis=1)]
        behind = second[(direction @ second.T).argmin(axis=1)]
        end = behind - moved[live] - np.einsum("nij,nj->ni", turned[live], support)
        apart = np.sum(direction * end, axis=1)
        better = apart > bound[live]
        bound[live[better]], found[live[better]] = apart[better], direction[better]
        gap = _nearest_to_origin(gap, end)
    return bound, found


def _nearest_to_origin(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the points of straight lines between points (N, 3) that are nearest to the origin."""
    edge = end - start
    squared = np.maximum(np.sum(edge**2, axis=1), _NO_LENGTH**2)
    share = np.clip(-np.sum(start * edge, axis=1) / squared, 0.0, 1.0)
    return start + share[:, None] * edge


# ---- How deep two convex shapes overlap, along which direction, and between which points.
#
# FCL ends the process on some shapes that touch, so it is never asked how deep: Coal is. Where
# faces lie on each other its direction is off by as much as 1e-4 rad; the normal of one of them is
# exact.

# Coal refuses solids of which more edges than 255 meet at a corner.
_MOST_NEIGHBOURS = 250
_REQUEST = coal.DistanceRequest()
_REQUEST.enable_signed_distance = True


class Penetration(NamedTuple):
    """How two shapes' cores overlap.

    Attributes:
        apart: How far the second begins beyond the end of the first along the direction [m].
        direction: From the first towards the second: moved that way by its depth, the second
            touches the first; unit vector, shape (3,).
        first: The first one's deepest point, shape (3,) [m].
        second: The second one's, shape (3,) [m].
    """

    apart: float
    direction: FloatArray
    first: FloatArray
    second: FloatArray


class PlacedSolid(NamedTuple):
    """A shape's core where it is.

    Attributes:
        shape: In its body's frame.
        solid: Its core, for Coal.
        rotation: Of the body, shape (3, 3).
        position: Of its origin, shape (3,) [m].
        core: Pose of the core, rotation and position.
    """

    shape: ConvexShape
    solid: Any
    rotation: FloatArray
    position: FloatArray
    core: tuple[FloatArray, FloatArray]


def penetration(one: PlacedSolid, other: PlacedSolid) -> Penetration:
    """Return how two cores that overlap, or touch, do so."""
    first, second = _corners(one), _corners(other)
    found = [_found_by_coal(one, other, first, second)]
    for placed, sign in ((one, 1.0), (other, -1.0)):
        normals = sign * placed.shape.normals @ placed.rotation.T
        if len(normals):
            apart = _apart(first, second, normals)
            best = int(apart.argmax())
            is_first = placed is one
            found.append(_across(first, second, normals[best], float(apart[best]), is_first))
    return max(found, key=lambda each: each.apart)


def _found_by_coal(
    one: PlacedSolid, other: PlacedSolid, first: FloatArray, second: FloatArray
) -> Penetration:
    """Return what Coal finds; corners (V, 3) [m] tell how far that is apart."""
    result, places = coal.DistanceResult(), [coal.Transform3s(*each.core) for each in (one, other)]
    coal.distance(one.solid, places[0], other.solid, places[1], _REQUEST, result)
    normal = np.array(result.normal)
    points = result.getNearestPoint1(), result.getNearestPoint2()
    apart = _apart(first, second, normal[None])[0] if np.isfinite(normal).all() else -np.inf
    return Penetration(float(apart), normal, *points)


def coal_solid(shape: ConvexShape, thickness: float) -> Any:
    """Return a shape's core for Coal; a ball or an edge along z has a thickness [m]."""
    if len(shape.vertices) == 1:
        return coal.Sphere(thickness)
    if len(shape.vertices) == 2:  # an edge
        length = float(np.linalg.norm(shape.vertices[1] - shape.vertices[0]))
        return coal.Box(thickness, thickness, length)
    shape = _with_few_neighbours(shape)
    corners, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in shape.vertices:
        corners.append(corner)
    for face in shape.faces.tolist():
        triangles.append(coal.Triangle(*face))
    return coal.Convex(corners, triangles)


def _with_few_neighbours(shape: ConvexShape) -> ConvexShape:
    """Return a shape, or one of its outermost corners where edges of too many meet at one.

    Only a direction is asked of Coal: how far apart shapes are along it is measured with all
    corners.
    """
    if np.bincount(shape.faces.ravel()).max() <= _MOST_NEIGHBOURS:
        return shape
    ways = spread_directions(_MOST_NEIGHBOURS)
    outermost = np.unique((shape.vertices @ ways.T).argmax(axis=0))
    return convex_hull(shape.vertices[outermost])


def _corners(placed: PlacedSolid) -> FloatArray:
    corners: FloatArray = placed.shape.vertices @ placed.rotation.T + placed.position
    return corners


def _apart(first: FloatArray, second: FloatArray, along: FloatArray) -> FloatArray:
    """Return how far the second's corners begin beyond the first's along directions, (F,) [m]."""
    apart: FloatArray = (second @ along.T).min(axis=0) - (first @ along.T).max(axis=0)
    return apart


def _across(
    first: FloatArray, second: FloatArray, normal: FloatArray, apart: float, is_first: bool
) -> Penetration:
    """Return the deepest corner of one shape and the point across from it on the other's face.

    The normal is of the first's face, or else of the second's, inwards.
    """
    if is_first:
        corner = second[(second @ normal).argmin()]
        return Penetration(apart, normal, corner - apart * normal, corner)
    corner = first[(first @ normal).argmax()]
    return Penetration(apart, normal, corner, corner + apart * normal)
