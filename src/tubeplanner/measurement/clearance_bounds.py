"""Lower bounds on the clearances of many pairs of convex shapes in many configurations at once."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.body_shapes import BodyShape, BodyShapes
from tubeplanner.collision.bounding_box import bounding_boxes
from tubeplanner.collision.gilbert import separating_directions
from tubeplanner.native.clearance_bounds import native_clearance_bounds
from tubeplanner.native.library import LIBRARY

# Steps towards the shortest vector between the shapes; two of them separate most pairs.
_MAX_STEPS = 12
_LOOSE = 2e-3  # [m]: by how much distances may fall short of what they could be
_NO_LENGTH = 1e-9  # [m]


class ClearanceBounds:
    """How far pairs of shapes are apart at least, beyond what is required."""

    def __init__(self, shapes: BodyShapes, pairs: IntArray, required: FloatArray) -> None:
        """Take P pairs (P, 2) of shapes, and the least distance of each, (P,) [m]."""
        self._shapes, self._pairs, self._required = shapes, pairs, required
        self._table = None if LIBRARY.functions is None else _table(shapes.shapes)

    def at(
        self, rotation: FloatArray, position: FloatArray, near: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return bounds on clearances [m] in N configurations.

        Where bounding spheres and boxes do not tell, the shapes are apart along a direction that is
        searched for.

        Args:
            rotation: Of all bodies, shape (N, bodies, 3, 3), from `RobotModel.body_poses`.
            position: Likewise, shape (N, bodies, 3) [m].
            near: From where on clearances do not matter [m].

        Returns:
            Bounds (N, P), infinite from `near` on, and the least of each configuration, (N,). Never
            above the clearance, except by rounding. Where shapes overlap they are negative, and say
            nothing about the depth.
        """
        if self._table is None:
            bound = self._bounds(rotation, position, near)
            return bound, bound.min(axis=1, initial=np.inf)
        settings = np.array([_MAX_STEPS, _LOOSE, _NO_LENGTH])
        pairs = np.ascontiguousarray(self._pairs)
        poses = rotation, position
        return native_clearance_bounds(self._table, pairs, self._required, settings, poses, near)

    def _bounds(self, rotation: FloatArray, position: FloatArray, near: float) -> FloatArray:
        shapes, pairs, required = self._shapes, self._pairs, self._required
        bound = shapes.sphere_distances(rotation, position, pairs) - required
        row, pair = np.nonzero(bound < near)
        boxes = shapes.box_distances(rotation, position, row, pairs[pair])
        bound[row, pair] = np.maximum(bound[row, pair], boxes - required[pair])
        for k in np.flatnonzero((bound < near).any(axis=0)):
            rows = np.flatnonzero(bound[:, k] < near)
            first, second = (shapes.shapes[index] for index in pairs[k])
            apart = _separations(first, second, rotation[rows], position[rows], near + required[k])
            bound[rows, k] = apart - required[k]
        bound[bound >= near] = np.inf
        return bound


def _separations(
    first: BodyShape,
    second: BodyShape,
    rotation: FloatArray,
    position: FloatArray,
    enough: float,
) -> FloatArray:
    """Return how far two shapes are apart along a direction that is searched for, (N,) [m].

    Args:
        first: One shape.
        second: The other one.
        rotation: As for `ClearanceBounds.at`.
        position: Likewise.
        enough: A distance beyond which it does not matter [m].
    """
    # Points of the first shape in the frame of the second one's body: turned @ x + moved.
    back = rotation[:, second.body].transpose(0, 2, 1)
    turned = back @ rotation[:, first.body]
    moved = np.einsum("nij,nj->ni", back, position[:, first.body] - position[:, second.body])
    gap = second.shape.center - moved - turned @ first.shape.center
    grown = first.shape.radius + second.shape.radius
    apart, _ = separating_directions(
        first.shape.vertices,
        second.shape.vertices,
        turned,
        moved,
        gap,
        max_steps=_MAX_STEPS,
        enough=enough + grown,
        loose=_LOOSE,
    )
    return apart - grown


def _table(shapes: list[BodyShape]) -> tuple[FloatArray, FloatArray]:
    """Return shapes as `native_clearance_bounds` takes them."""
    vertices = np.concatenate([np.zeros((0, 3)), *(each.shape.vertices for each in shapes)])
    count = np.array([len(each.shape.vertices) for each in shapes])
    boxes = bounding_boxes([each.shape for each in shapes])
    columns = (
        np.array([each.body for each in shapes]),
        np.cumsum(count) - count,
        count,
        np.array([each.shape.radius for each in shapes]),
        np.array([each.shape.bounding_radius for each in shapes]),
        np.array([each.shape.center for each in shapes]),
        boxes.axes.reshape(-1, 9),
        boxes.center,
        boxes.half,
    )
    table = np.hstack([column.reshape(len(shapes), -1 if shapes else 0) for column in columns])
    return np.ascontiguousarray(table, dtype=float), np.ascontiguousarray(vertices.T)
