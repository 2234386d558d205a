"""Distances of pairs of shapes in neighbouring configurations, exact where they matter."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.collision.body_shapes import BodyShapes

# Without the native library configurations are visited coarse to fine, with this stride first; one
# near by then provides a direction that separates a pair.
_STRIDES = (64, 16, 4, 1)


def near_distances(
    checker: BodyShapes, q: FloatArray, pairs: IntArray, matters: FloatArray, known: FloatArray
) -> FloatArray:
    """Return distances of all pairs in configurations that follow each other, shape (N, P) [m].

    Those beyond what matters are lower bounds: known ones, from spheres, or along a direction that
    separates the pair.

    Args:
        checker: The shapes.
        q: Configurations, shape (N, n).
        pairs: Shape (P, 2).
        matters: Below which distances are exact, shape (N, P) [m].
        known: Lower bounds that are known, shape (N, P) [m].
    """
    poses = checker.robot.body_poses(q)
    found = checker.near_distances(*poses, pairs, matters, known)
    if found is not None:
        return found
    distances = _Distances(checker, poses, pairs, matters, known)
    before = len(q)
    for stride in _STRIDES:
        samples = np.arange(0, len(q), stride)
        distances.measure(samples[(samples % before != 0) | (before == len(q))], before)
        before = stride
    return distances.found


class _Distances:
    """Distances of P pairs at N configurations along a spline, as exact as they are near.

    Attributes:
        found: Lower bounds, exact below what matters, (N, P) as both [m].
    """

    def __init__(
        self,
        checker: BodyShapes,
        poses: tuple[FloatArray, FloatArray],
        pairs: IntArray,
        matters: FloatArray,
        known: FloatArray,
    ) -> None:
        self._checker, self._pairs, self._matters = checker, pairs, matters
        self._rotation, self._position = poses
        spheres = checker.sphere_distances(self._rotation, self._position, pairs)
        self.found = np.maximum(spheres, known)
        self._near = self.found < matters
        self._direction = np.zeros((*self.found.shape, 3))
        self._is_known = np.zeros(self.found.shape, dtype=bool)

    def measure(self, samples: IntArray, stride: int) -> None:
        """Visit some samples, after those that are multiples of a stride."""
        row, pair = np.nonzero(self._near[samples])
        row = samples[row]
        last = row - row % stride
        known = np.flatnonzero(self._is_known[last, pair])
        self._direction[row, pair] = self._direction[last, pair]
        self._is_known[row, pair] = True
        at = (row[known], pair[known])
        bound = self._checker.separations_along(
            self._rotation, self._position, self._pairs[at[1]], self._direction[at], at[0]
        )
        self.found[at] = np.maximum(self.found[at], bound)
        close = self.found[row, pair] < self._matters[row, pair]
        for i in np.unique(row[close]):
            pairs = pair[close & (row == i)]
            self.found[i, pairs], self._direction[i, pairs] = self._checker.separations(
                self._rotation[i], self._position[i], self._pairs[pairs]
            )
