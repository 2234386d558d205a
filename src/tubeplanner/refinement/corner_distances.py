"""How far single corners of a shape are from a plane that bounds another one.

Of shapes that lie on each other many corners are equally near. The nearest points of both tell of
one of them alone: a step that turns a shape about it brings another corner nearer.
"""

from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.separation import ClosestPoints

CORNERS = 4  # of a shape that are looked at
# Corners that are farther than the nearest by more than this do not count [m].
_NEAR = 0.005


def of_corners(
    checker: CollisionChecker,
    poses: tuple[FloatArray, FloatArray],
    pairs: IntArray,
    closest: ClosestPoints,
    corner: IntArray,
) -> ClosestPoints:
    """Return where pairs are closest, some at a corner of the smaller shape.

    Args:
        checker: The shapes.
        poses: Of all bodies, rotation (E, bodies, 3, 3) and position (E, bodies, 3) [m].
        pairs: Shape (E, 2).
        closest: Where the pairs are closest.
        corner: Which of the nearest corners, in the order of the shape's vertices, from 0 to 3;
            -1: where the pair is closest.
    """
    found = [value.copy() for value in (closest.distance, closest.first, closest.second)]
    distance, first, second = found
    for row in np.flatnonzero(corner >= 0):
        shapes = [checker.shapes[index] for index in pairs[row]]
        smaller = int(np.argmin([each.shape.bounding_radius for each in shapes]))
        placed, body = shapes[smaller], shapes[smaller].body
        corners = placed.shape.vertices @ poses[0][row, body].T + poses[1][row, body]
        towards = closest.direction[row] if smaller == 1 else -closest.direction[row]
        height = corners @ towards
        nearest = np.sort(np.argsort(height, kind="stable")[:CORNERS])
        chosen = nearest[min(int(corner[row]), len(nearest) - 1)]
        more = float(height[chosen] - height.min())
        if more > _NEAR:
            continue
        distance[row] += more
        apart = distance[row] + sum(each.shape.radius for each in shapes)
        own, other = (second, first) if smaller == 1 else (first, second)
        own[row], other[row] = corners[chosen], corners[chosen] - apart * towards
    return replace(closest, distance=distance, first=first, second=second)
