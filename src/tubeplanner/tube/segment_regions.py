"""The convex regions about a tube's segments: which places they hold, and the planes about them.

A region reaches beyond the axis of its segment, from A to B, by some extent e along every unit
normal n: it lies behind the plane n.p = max(n.A, n.B) + e(n).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.native.regions import away_from_axes

_NO_LENGTH = 1e-9  # [m or rad]


class SegmentRegions(Protocol):
    """The regions of m segments."""

    @property
    def begin(self) -> FloatArray:
        """Where the axes begin, shape (m, 3) [m or rad]."""
        ...

    @property
    def end(self) -> FloatArray:
        """Where they end, shape (m, 3)."""
        ...

    @property
    def radius(self) -> FloatArray:
        """Of the largest capsules about the axes that are inside, shape (m,) [m or rad]."""
        ...

    def margin(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return how far inside regions points are [m or rad], a concave function of the point.

        Args:
            p: Shape (..., R, 3).
            segment: Whose region is meant, shape (R,).

        Returns:
            Shape (..., R); negative outside. It changes by no more than the point moves.
        """
        ...

    def share(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return how far out points (R, 3) are: 0 on the axis, 1 on the wall, shape (R,)."""
        ...

    def outward(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return unit normals where the share grows fastest, (R, 3); zero on the axis."""
        ...

    def faces(self, segment: IntArray) -> Sequence[FloatArray]:
        """Return normals of faces that do not depend on the point, each (R, 3); zero: none."""
        ...

    def extent(self, normal: FloatArray, segment: IntArray) -> FloatArray:
        """Return how far regions reach beyond their axes along unit normals (R, 3), shape (R,)."""
        ...

    def kinds(self, segment: int) -> tuple[str, ...]:
        """Return the names of the tolerances that a region has."""
        ...

    def kind(self, normal: FloatArray, segment: IntArray) -> IntArray:
        """Return which of these gives the extent along normals (R, 3), shape (R,)."""
        ...


@dataclass(frozen=True, eq=False)
class Capsules:
    """Capsules: what is within a radius of the axis; `SegmentRegions`.

    Attributes:
        begin: Where the axes begin, shape (m, 3) [m or rad].
        end: Where they end, shape (m, 3).
        radius: Shape (m,) [m or rad]; may be infinite.
    """

    begin: FloatArray
    end: FloatArray
    radius: FloatArray

    def margin(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return how far inside the capsules points are."""
        margin: FloatArray = self.radius[segment] - self._away(p, segment)[1]
        return margin

    def share(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return distances from the axes in radii."""
        share: FloatArray = self._away(p, segment)[1] / self.radius[segment]
        return share

    def outward(self, p: FloatArray, segment: IntArray) -> FloatArray:
        """Return the directions away from the axes."""
        away, distance = self._away(p, segment)
        distance = distance[..., None]
        return np.divide(away, distance, out=np.zeros_like(away), where=distance > _NO_LENGTH)

    def faces(self, segment: IntArray) -> Sequence[FloatArray]:
        """Return the normals at both caps: the axes' directions; zero for balls."""
        return self._direction[segment], -self._direction[segment]

    def extent(self, normal: FloatArray, segment: IntArray) -> FloatArray:
        """Return the radii."""
        return self.radius[segment]

    def kinds(self, segment: int) -> tuple[str, ...]:
        """Return that it is the radius."""
        return ("radius",)

    def kind(self, normal: FloatArray, segment: IntArray) -> IntArray:
        """Return that it is the radius."""
        return np.zeros(len(segment), dtype=np.int64)

    @cached_property
    def _direction(self) -> FloatArray:
        axis = self.end - self.begin
        length = np.linalg.norm(axis, axis=1, keepdims=True)
        return np.divide(axis, length, out=np.zeros_like(axis), where=length > _NO_LENGTH)

    def _away(self, p: FloatArray, segment: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return vectors from the nearest points of axes to points (..., R, 3), and lengths."""
        found = away_from_axes(p, (self.begin, self.end), segment, _NO_LENGTH)
        if found is not None:
            return found
        begin = self.begin[segment]
        axis = self.end[segment] - begin
        square = np.maximum(np.einsum("ri,ri->r", axis, axis), _NO_LENGTH**2)
        share = np.clip(np.einsum("...ri,ri->...r", p - begin, axis) / square, 0.0, 1.0)
        away = p - (begin + share[..., None] * axis)
        return away, np.linalg.norm(away, axis=-1)
