"""A view of space from far away: where points are on the page, and how near they are."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray

_UPRIGHT = 0.999  # of a direction's height: from above, x points right and y up


@dataclass(frozen=True, eq=False)
class SpaceView:
    """A view along a direction, lines that are parallel in space parallel on the page.

    Attributes:
        direction: From the scene towards the viewer, unit vector (3,).
    """

    direction: FloatArray

    @property
    def is_from_above(self) -> bool:
        """Whether the page is the plane of x and y."""
        return bool(self.direction[2] > _UPRIGHT)

    @property
    def axes(self) -> FloatArray:
        """Unit vectors to the right and upwards on the page, shape (2, 3)."""
        if self.is_from_above:
            return np.eye(3)[:2]
        right = np.cross([0.0, 0.0, 1.0], self.direction)
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(self.direction, right)])

    def on_page(self, points: FloatArray) -> FloatArray:
        """Return where points (..., 3) are on the page, shape (..., 2) [m]."""
        placed: FloatArray = points @ self.axes.T
        return placed

    def nearness(self, points: FloatArray) -> FloatArray:
        """Return how near to the viewer points (..., 3) are, shape (...) [m]."""
        near: FloatArray = points @ self.direction
        return near
