"""Whether one solid begins wholly inside another one's triangles."""

from typing import Any

import coal
import numpy as np

from outside.arm import Solid

Placed = tuple[Solid, np.ndarray, np.ndarray]  # solid, rotation (3, 3), position (3,) [m]


def is_inside(first: Placed, second: Placed) -> bool:
    """Return whether a point of either solid is inside the other one's triangles."""
    return any(
        is_mesh(outer[0].geometry) and _winding(outer, _point(inner)) > 0.5
        for inner, outer in ((first, second), (second, first))
        if np.linalg.norm(_point(inner) - _middle(outer)) < outer[0].radius
    )


def is_mesh(geometry: Any) -> bool:
    """Return whether a geometry is triangles rather than a solid."""
    return isinstance(geometry, coal.BVHModelBase)


def _middle(placed: Placed) -> np.ndarray:
    solid, rotation, position = placed
    return position + rotation @ np.array(solid.geometry.aabb_center)


def _point(placed: Placed) -> np.ndarray:
    """Return a point of a solid: its centre, or a corner of its triangles."""
    solid, rotation, position = placed
    if is_mesh(solid.geometry):
        return position + rotation @ np.array(solid.geometry.vertex(0))
    return position


def _winding(placed: Placed, point: np.ndarray) -> float:
    """Return how often triangles wind round a point: 1 inside, 0 outside of closed ones.

    Van Oosterom and Strackee, "The solid angle of a plane triangle", 1983.
    """
    solid, rotation, position = placed
    local = rotation.T @ (point - position)
    corners = np.array(solid.geometry.vertices()) - local
    rows = [solid.geometry.tri_indices(k) for k in range(solid.geometry.num_tris)]
    a, b, c = (corners[[row[k] for row in rows]] for k in range(3))
    lengths = [np.linalg.norm(side, axis=1) for side in (a, b, c)]
    above = np.einsum("ni,ni->n", a, np.cross(b, c))
    below = np.prod(lengths, axis=0) + sum(
        np.einsum("ni,ni->n", x, y) * z
        for x, y, z in ((a, b, lengths[2]), (b, c, lengths[0]), (c, a, lengths[1]))
    )
    return abs(float(np.arctan2(above, below).sum() / (2 * np.pi)))
