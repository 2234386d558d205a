"""Boxes around convex shapes: quick lower bounds where a shape is long or flat."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.convex_shape import ConvexShape


@dataclass(frozen=True, eq=False)
class BoundingBoxes:
    """The boxes around S shapes, each in its body's frame.

    Attributes:
        axes: Unit vectors as rows, shape (S, 3, 3).
        center: Along these, shape (S, 3) [m].
        half: Half lengths, shape (S, 3) [m].
    """

    axes: FloatArray
    center: FloatArray
    half: FloatArray

    def distance(self, shape: IntArray, point: FloatArray) -> FloatArray:
        """Return how far points are from the boxes of shapes.

        Args:
            shape: Indices, shape (M,).
            point: In the frames of the shapes' bodies, shape (M, 3) [m].

        Returns:
            Shape (M,) [m]; 0 inside.
        """
        along = np.einsum("mij,mj->mi", self.axes[shape], point) - self.center[shape]
        beyond = np.maximum(abs(along) - self.half[shape], 0.0)
        return np.sqrt(np.einsum("mi,mi->m", beyond, beyond))


def bounding_boxes(shapes: Sequence[ConvexShape]) -> BoundingBoxes:
    """Return boxes around shapes: along their principal or their body's axes, what is smaller."""
    boxes = [min(_box(s, np.eye(3)), _box(s, _principal_axes(s)), key=_volume) for s in shapes]
    axes, center, half = (np.array([box[k] for box in boxes]) for k in range(3))
    return BoundingBoxes(axes.reshape(-1, 3, 3), center.reshape(-1, 3), half.reshape(-1, 3))


def _box(shape: ConvexShape, axes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    along = shape.vertices @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    return axes, (low + high) / 2, (high - low) / 2 + shape.radius


def _volume(box: tuple[FloatArray, FloatArray, FloatArray]) -> float:
    return float(np.prod(box[2]))


def _principal_axes(shape: ConvexShape) -> FloatArray:
    spread = shape.vertices - shape.vertices.mean(axis=0)
    return np.asarray(np.linalg.eigh(spread.T @ spread)[1].T)
