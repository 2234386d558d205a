"""Separating directions of two convex shapes; depth of an overlap, by Coal."""

from typing import Any, NamedTuple

import coal
import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.geometry.convex_shapes import ConvexShape, convex_hull, spread_directions

_NO_LENGTH = 1e-9  # [m]


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
    """Return the gaps between the hulls of two sets of points, and their unit vectors.

    Gilbert's iteration ("An iterative procedure for computing the minimum of a quadratic form on a
    convex set", 1966) towards the shortest vector between both hulls, on all configurations
    together; each ends as soon as it has enough.

    Args:
        first: Points of the first set, shape (V, 3) [m].
        second: Points of the second set, in its frame, shape (W, 3) [m].
        rotation: Rotations of the first set into the frame of the second, shape (N, 3, 3).
        moved: Origin of the first set in the frame of the second, shape (N, 3) [m].
        gap: From any point of the first hull to any of the second, to begin with, (N, 3) [m].
        max_steps: Of the iteration.
        enough: A distance beyond which it does not matter [m].
        loose: Accepted shortfall of the distances [m].

    Returns:
        Distances (N,) [m], never above the true distances, except by rounding, and unit vectors (N,
        3) from the first towards the second hull, in the frame of the second. Where hulls overlap a
        distance is negative, and says nothing about the depth.
    """
    bound, normal = np.full(len(gap), -np.inf), np.zeros_like(gap)
    live, upper = np.arange(len(gap)), np.full(len(gap), np.inf)
    for _ in range(max_steps):
        length = np.linalg.norm(gap, axis=1)
        unsettled = (length > _NO_LENGTH) & (bound[live] < np.minimum(enough, upper - loose))
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
        squared = np.maximum(np.sum(edge**2, axis=1), _NO_LENGTH**2)
        fraction = np.clip(-np.sum(gap * edge, axis=1) / squared, 0.0, 1.0)
        gap = gap + fraction[:, None] * edge
    return bound, normal


# ---- Depth and direction of an overlap of two convex shapes.
#
# FCL ends the process on some shapes that touch, so Coal measures the depth. Where faces lie on
# each other its direction is off by as much as 1e-4 rad; the normal of one of the faces is exact.

# Coal refuses solids of which more edges than 255 meet at a corner.
_MAX_NEIGHBOURS = 250
_REQUEST = coal.DistanceRequest()
_REQUEST.enable_signed_distance = True


class Penetration(NamedTuple):
    """The overlap of two shapes' cores.

    Attributes:
        apart: Gap from the end of the first to the begin of the second along the direction [m].
        direction: From the first towards the second: moved along it by its depth, the second
            touches the first; unit vector, shape (3,).
        first: The deepest point of the first core, shape (3,) [m].
        second: The deepest point of the second core, shape (3,) [m].
    """

    apart: float
    direction: FloatArray
    first: FloatArray
    second: FloatArray


class PlacedSolid(NamedTuple):
    """A shape's core in a pose.

    Attributes:
        shape: In its body's frame.
        solid: Its core, for Coal.
        rotation: Of the body, shape (3, 3).
        position: Of the body's origin, shape (3,) [m].
        core: Pose of the core, rotation and position.
    """

    shape: ConvexShape
    solid: Any
    rotation: FloatArray
    position: FloatArray
    core: tuple[FloatArray, FloatArray]


def penetration(one: PlacedSolid, other: PlacedSolid) -> Penetration:
    """Return the overlap of two cores that overlap or touch.

    The best of Coal's direction and of the normals of both shapes' faces.
    """
    first, second = _corners(one), _corners(other)
    result, poses = coal.DistanceResult(), [coal.Transform3s(*each.core) for each in (one, other)]
    coal.distance(one.solid, poses[0], other.solid, poses[1], _REQUEST, result)
    normal, apart = np.array(result.normal), -np.inf
    if np.isfinite(normal).all():
        apart = float(_apart(first, second, normal[None])[0])
    points = result.getNearestPoint1(), result.getNearestPoint2()
    candidates = [Penetration(apart, normal, *points)]
    for placed, sign in ((one, 1.0), (other, -1.0)):
        normals = sign * placed.shape.normals @ placed.rotation.T
        if len(normals) == 0:
            continue
        gaps = _apart(first, second, normals)
        best = int(gaps.argmax())
        normal, apart = normals[best], float(gaps[best])
        # The deepest corner of one shape, and the point across from it on the other's face.
        if placed is one:
            corner = second[(second @ normal).argmin()]
            points = corner - apart * normal, corner
        else:
            corner = first[(first @ normal).argmax()]
            points = corner, corner + apart * normal
        candidates.append(Penetration(apart, normal, *points))
    return max(candidates, key=lambda each: each.apart)


def coal_solid(shape: ConvexShape, thickness: float) -> Any:
    """Return a shape's core for Coal; a ball or an edge along z has a thickness [m].

    A shape with too many edges at a corner is replaced by its outermost corners: Coal gives only a
    direction, and gaps along it are measured with all corners.
    """
    if len(shape.vertices) == 1:
        return coal.Sphere(thickness)
    if len(shape.vertices) == 2:  # an edge
        length = float(np.linalg.norm(shape.vertices[1] - shape.vertices[0]))
        return coal.Box(thickness, thickness, length)
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


def _corners(placed: PlacedSolid) -> FloatArray:
    corners: FloatArray = placed.shape.vertices @ placed.rotation.T + placed.position
    return corners


def _apart(first: FloatArray, second: FloatArray, along: FloatArray) -> FloatArray:
    """Return the gaps from the first corners to the second along directions, (F,) [m]."""
    apart: FloatArray = (second @ along.T).min(axis=0) - (first @ along.T).max(axis=0)
    return apart
