"""The least distance of shapes beyond what is asked, for all t and not only at samples.

On a time interval the distance of a pair cannot fall below its value at the middle by more than
the joints' travel allows. Intervals that could still hold the minimum are halved until none is
left. The joints' travel is bounded by Bernstein coefficients. A direction that separates a pair
does so in the neighbourhood too, so that most intervals need no exact distance.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.trajectory.bernstein import bernstein_coefficients
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# The least margin is bracketed to this share of itself, or to this length [m] where it is next to
# nothing.
_RELATIVE_RESOLUTION = 0.02
_RESOLUTION = 5e-7
# Intervals this short [s] are not halved: their bound counts as it stands.
_MIN_INTERVAL = 1e-7
# After so many intervals, or so many times those it starts with, no more are halved: far beyond
# what any sensible trajectory needs. Their bounds count as they stand, so that the answer stays
# safe.
_MAX_INTERVALS = 3_000_000
_MAX_ROUNDS = 8
_BATCH = 64  # distances evaluated before intervals are judged anew

# What is asked of pairs over intervals of time: from begins, ends and pairs to distances.
AskedOver: TypeAlias = Callable[[FloatArray, FloatArray, IntArray], FloatArray]


@dataclass(frozen=True)
class ClosestApproach:
    """Where a set of pairs comes nearest.

    Attributes:
        lower_bound: No distance beyond what is asked falls below it at any time [m].
        margin: The least distance beyond what is asked that was found [m].
        time: When [s].
        pair: Indices of the two shapes.
        intervals: How many pairs and intervals were tested.
    """

    lower_bound: float
    margin: float
    time: float
    pair: tuple[int, int]
    intervals: int


def closest_approach(
    checker: CollisionChecker,
    trajectory: JointTrajectory,
    columns: IntArray,
    asked: AskedOver,
) -> ClosestApproach | None:
    """Return the closest approach of some pairs along a trajectory.

    Args:
        checker: The geometry.
        trajectory: In the group order of the checker's robot.
        columns: Which of the checker's pairs, shape (P,).
        asked: The most that is asked of pairs (R,) over intervals of time, from begins (R,) to ends
            (R,) [m]; the nearer distances come to it, the finer they are resolved.

    Returns:
        The closest approach, or None if there are no pairs.
    """
    if len(columns) == 0:
        return None
    search = _Search(checker, trajectory, columns, asked)
    search.halve_until_settled()
    first, second = (int(index) for index in checker.pairs[columns[search.pair]])
    return ClosestApproach(
        min(search.lower_bound, search.margin),
        search.margin,
        search.time,
        (first, second),
        search.intervals,
    )


@dataclass(frozen=True, eq=False)
class _Rows:
    """Pairs on intervals that are still in question, all halved equally often.

    Attributes:
        node: Which interval, as piece * 2^level + number within the piece, shape (R,).
        pair: Which pair, shape (R,).
        direction: Along which the pair was last found apart, shape (R, 3).
        level: How often the pieces have been halved.
    """

    node: IntArray
    pair: IntArray
    direction: FloatArray
    level: int

    def halves(self, split: BoolArray) -> "_Rows":
        """Return both halves of some rows."""
        node = np.repeat(2 * self.node[split], 2)
        node[1::2] += 1
        direction = np.repeat(self.direction[split], 2, axis=0)
        return _Rows(node, np.repeat(self.pair[split], 2), direction, self.level + 1)


class _Search:
    """The intervals still in question, and the least distance beyond what is asked yet."""

    def __init__(
        self,
        checker: CollisionChecker,
        trajectory: JointTrajectory,
        columns: IntArray,
        asked: AskedOver,
    ) -> None:
        self._checker, self._trajectory = checker, trajectory
        self._columns, self._pairs, self._asked = columns, checker.pairs[columns], asked
        self._weights = checker.motion_weights(self._pairs)
        self.margin, self.time, self.pair = np.inf, 0.0, 0
        self.lower_bound = np.inf
        self.intervals = 0

    def halve_until_settled(self) -> None:
        """Bound every pair on every piece, halve what may hold the minimum, and repeat."""
        rows = self._beginning()
        most = max(_MAX_INTERVALS, _MAX_ROUNDS * len(rows.node))
        while len(rows.node):
            self.intervals += len(rows.node)
            lower, direction = self._lower_bounds(rows)
            width = self._trajectory.widths[rows.node >> rows.level] / 2**rows.level
            undecided = lower < self._settled_above()
            final = undecided & ((width < _MIN_INTERVAL) | (self.intervals > most))
            settled = lower[~undecided | final]
            self.lower_bound = min(self.lower_bound, float(settled.min(initial=np.inf)))
            rows = replace(rows, direction=direction).halves(undecided & ~final)

    def _beginning(self) -> _Rows:
        """Return all pairs on all pieces, with the directions that separate them at the start."""
        rotation, position = self._checker.robot.body_poses(self._trajectory.position(np.zeros(1)))
        distance, direction = self._checker.separations(rotation[0], position[0], self._pairs)
        count, pieces = len(self._pairs), len(self._trajectory.widths)
        pair = np.tile(np.arange(count), pieces)
        self._remember(distance, np.zeros(count), np.arange(count))
        return _Rows(np.repeat(np.arange(pieces), count), pair, direction[pair], 0)

    def _settled_above(self) -> float:
        """Return the lower bound above which an interval cannot change the answer [m]."""
        return self.margin - max(_RESOLUTION, _RELATIVE_RESOLUTION * abs(self.margin))

    def _lower_bounds(self, rows: _Rows) -> tuple[FloatArray, FloatArray]:
        """Return lower bounds of the rows' margins [m], (R,), and separating directions, (R, 3).

        A margin is a distance less what is asked. From bounding spheres; where these do not settle
        it, along the known directions; where neither does, exactly, with new directions.
        """
        nodes, interval = np.unique(rows.node, return_inverse=True)
        middle, travel, time, half = self._middles(nodes, rows.level)
        begin, end = (time - half)[interval], (time + half)[interval]
        asked = self._asked(begin, end, self._columns[rows.pair])
        rotation, position = self._checker.robot.body_poses(middle)
        travelled = np.einsum("rn,rn->r", self._weights[rows.pair], travel[interval])
        spheres = self._checker.sphere_distances(rotation, position, self._pairs)
        less = travelled + asked
        lower = spheres[interval, rows.pair] - less
        near = np.flatnonzero(lower < self._settled_above())
        bound = self._checker.separations_along(
            rotation, position, self._pairs[rows.pair[near]], rows.direction[near], interval[near]
        )
        lower[near] = np.maximum(lower[near], bound - less[near])
        direction = rows.direction.copy()
        order = near[np.argsort(lower[near], kind="stable")]
        for first in range(0, len(order), _BATCH):
            batch = order[first : first + _BATCH]
            batch = batch[lower[batch] < self._settled_above()]
            if len(batch) == 0:
                break
            at = interval[batch]
            distance, direction[batch] = self._checker.separations_at(
                rotation, position, self._pairs[rows.pair[batch]], at
            )
            self._remember(distance, time[at], rows.pair[batch])
            lower[batch] = np.maximum(lower[batch], distance - less[batch])
        return lower, direction

    def _middles(self, node: IntArray, level: int) -> tuple[FloatArray, ...]:
        """Return mid-interval configurations, the farthest joints get from them, times, halves."""
        piece = node >> level
        width = self._trajectory.widths[piece] / 2**level
        start = (node - (piece << level)) * width
        hull = bernstein_coefficients(self._trajectory.coefficients[:, piece], start, width)
        time = self._trajectory.breakpoints[piece] + start + width / 2
        middle = self._trajectory.position(time)
        return middle, abs(hull - middle).max(axis=0), time, width / 2

    def _remember(self, distance: FloatArray, time: FloatArray, pair: IntArray) -> None:
        margin = distance - self._asked(time, time, self._columns[pair])
        least = int(margin.argmin())
        if margin[least] < self.margin:
            self.margin = float(margin[least])
            self.time, self.pair = float(time[least]), int(pair[least])
