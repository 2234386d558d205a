"""The least distance of shapes along a whole trajectory, for all t and not only at samples.

On a time interval the distance of a pair cannot fall below its value at the middle by more than
the joints' travel allows. Intervals that could still hold the minimum are halved until none is
left. The joints' travel is bounded by Bernstein coefficients.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.bernstein import bernstein_coefficients
from tubeplanner.collision import CollisionChecker
from tubeplanner.trajectory import JointTrajectory

# The minimum is bracketed to this share of its distance from the required clearance, or to this
# length [m] where it nearly touches it.
_RELATIVE_RESOLUTION = 0.02
_RESOLUTION = 5e-7
# Intervals this short [s] are not halved: their bound counts as it stands.
_SHORTEST_INTERVAL = 1e-7
# After so many intervals, or so many times those it starts with, no more are halved: far beyond
# what any sensible motion needs. Their bounds count as they stand, so that the answer stays safe.
_MOST_INTERVALS = 3_000_000
_MOST_ROUNDS = 8
_BATCH = 64  # distances evaluated before intervals are judged anew


@dataclass(frozen=True)
class ClosestApproach:
    """Where a set of pairs comes nearest.

    Attributes:
        lower_bound: No distance falls below it at any time [m].
        distance: The least distance that was found [m].
        time: When [s].
        pair: Indices of the two shapes.
        intervals: How many pairs and intervals were looked at.
    """

    lower_bound: float
    distance: float
    time: float
    pair: tuple[int, int]
    intervals: int


def closest_approach(
    checker: CollisionChecker,
    trajectory: JointTrajectory,
    pairs: IntArray,
    required: float,
) -> ClosestApproach | None:
    """Return the closest approach of some pairs along a trajectory.

    Args:
        checker: The geometry.
        trajectory: In the group order of the checker's robot.
        pairs: Shape (P, 2), from the checker.
        required: Distance that must be kept [m]; the nearer the minimum is to it, the finer it is
            resolved.

    Returns:
        The closest approach, or None if there are no pairs.
    """
    if len(pairs) == 0:
        return None
    search = _Search(checker, trajectory, pairs, required)
    count = len(trajectory.widths)
    search.halve_until_settled(
        np.repeat(np.arange(count), len(pairs)),
        np.zeros(count * len(pairs)),
        np.repeat(trajectory.widths, len(pairs)),
        np.tile(np.arange(len(pairs)), count),
    )
    first, second = (int(index) for index in pairs[search.pair])
    return ClosestApproach(
        min(search.lower_bound, search.distance),
        search.distance,
        search.time,
        (first, second),
        search.intervals,
    )


class _Search:
    """Rows of (polynomial piece, local start, width, pair) still in question, and the best yet."""

    def __init__(
        self,
        checker: CollisionChecker,
        trajectory: JointTrajectory,
        pairs: IntArray,
        required: float,
    ) -> None:
        self._checker, self._trajectory, self._pairs = checker, trajectory, pairs
        self._required = required
        self._weights = checker.motion_weights(pairs)
        self.distance, self.time, self.pair = np.inf, 0.0, 0
        self.lower_bound = np.inf
        self.intervals = 0

    def halve_until_settled(
        self, piece: IntArray, start: FloatArray, width: FloatArray, pair: IntArray
    ) -> None:
        """Look at all rows, halve those that may hold the minimum, and so on."""
        most = max(_MOST_INTERVALS, _MOST_ROUNDS * len(piece))
        while len(piece):
            lower = self._lower_bounds(piece, start, width, pair)
            undecided = lower < self._settled_above()
            final = undecided & ((width < _SHORTEST_INTERVAL) | (self.intervals > most))
            self._settle(lower[~undecided | final])
            split = undecided & ~final
            piece, pair = np.repeat(piece[split], 2), np.repeat(pair[split], 2)
            width = np.repeat(width[split] / 2, 2)
            start = np.repeat(start[split], 2)
            start[1::2] += width[1::2]

    def _settle(self, lower: FloatArray) -> None:
        self.lower_bound = min(self.lower_bound, float(lower.min(initial=np.inf)))

    def _settled_above(self) -> float:
        """Return the lower bound above which an interval cannot change the answer [m]."""
        if np.isinf(self.distance):
            return np.inf
        gap = abs(self.distance - self._required)
        return self.distance - max(_RESOLUTION, _RELATIVE_RESOLUTION * gap)

    def _lower_bounds(
        self, piece: IntArray, start: FloatArray, width: FloatArray, pair: IntArray
    ) -> FloatArray:
        """Return lower bounds of the rows' distances on their intervals [m], shape (rows,)."""
        interval, row_of = _distinct(piece, start)
        middle, travel = self._middle_and_travel(piece[interval], start[interval], width[interval])
        rotation, position = self._checker.robot.body_poses(middle)
        motion = np.einsum("rn,rn->r", self._weights[pair], travel[row_of])
        spheres = self._checker.sphere_distances(rotation, position, self._pairs)
        lower = spheres[row_of, pair] - motion
        time = self._trajectory.breakpoints[piece] + start + width / 2
        order = np.argsort(lower, kind="stable")
        for first in range(0, len(order), _BATCH):
            batch = order[first : first + _BATCH]
            batch = batch[lower[batch] < self._settled_above()]
            if len(batch) == 0:
                break
            exact = self._exact(rotation, position, row_of[batch], pair[batch])
            self._remember(exact, time[batch], pair[batch])
            lower[batch] = np.maximum(lower[batch], exact - motion[batch])
        self.intervals += len(piece)
        return lower

    def _middle_and_travel(
        self, piece: IntArray, start: FloatArray, width: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return mid-interval configurations and the farthest joints get from them, (I, n)."""
        coefficients = self._trajectory.coefficients[:, piece]
        hull = bernstein_coefficients(coefficients, start, width)
        middle = self._trajectory.position(self._trajectory.breakpoints[piece] + start + width / 2)
        return middle, abs(hull - middle).max(axis=0)

    def _exact(
        self, rotation: FloatArray, position: FloatArray, interval: IntArray, pair: IntArray
    ) -> FloatArray:
        distance = np.empty(len(pair))
        for i in np.unique(interval):
            rows = np.flatnonzero(interval == i)
            distance[rows] = self._checker.distances(
                rotation[i], position[i], self._pairs[pair[rows]]
            )
        return distance

    def _remember(self, distance: FloatArray, time: FloatArray, pair: IntArray) -> None:
        least = int(distance.argmin())
        if distance[least] < self.distance:
            self.distance = float(distance[least])
            self.time, self.pair = float(time[least]), int(pair[least])


def _distinct(piece: IntArray, start: FloatArray) -> tuple[IntArray, IntArray]:
    """Return one row per distinct interval, and which of them each row has."""
    keys = np.column_stack([piece, start])
    _, rows, row_of = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return rows, row_of.ravel()
