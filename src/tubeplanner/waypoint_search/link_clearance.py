"""Which configurations near the reference path bring links too close to obstacles or each other.

Distances are known at the waypoints; elsewhere, the joints' travel from there bounds them from
below, and so does the direction that separates a pair there. Only pairs for which neither is enough
are measured.
"""

from collections.abc import Callable
from copy import copy

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import RequiredDistances

_MAX_DISTANCE = 0.3  # [m]: pairs that are never nearer at a waypoint are left out


class LinkClearance:
    """Links against obstacles and links, around M known configurations.

    Pairs that are far apart at all of them are assumed to stay apart. Of what segments and contacts
    ask the least counts: in which segment the tool is, is not known.

    Attributes:
        free_waypoints: Which of the known configurations are free: bool, shape (M,).
    """

    def __init__(
        self,
        problem: PlanningProblem,
        waypoints: FloatArray,
        checkpoint: Callable[[], None] = lambda: None,
    ) -> None:
        """Measure all distances at waypoints (M, n), of which the first is the start.

        The last is the goal. The checkpoint may raise to end that.
        """
        self._problem, self._checker = problem, problem.collision
        checker = problem.collision
        self._pairs, self._columns = checker.pairs, np.arange(len(checker.pairs))
        self._asked = RequiredDistances(problem, waypoints[0], waypoints[-1])
        self._waypoints = waypoints
        found = []
        for rotation, position in zip(*problem.robot.body_poses(waypoints), strict=True):
            checkpoint()
            found.append(checker.separations(rotation, position, self._pairs))
        distance = np.array([distance for distance, _ in found])
        direction = np.array([direction for _, direction in found])
        self.free_waypoints = np.all(distance >= self._required(waypoints), axis=1)
        near = distance.min(axis=0, initial=np.inf) < _MAX_DISTANCE
        self._pairs, self._columns = self._pairs[near], self._columns[near]
        self._weights = checker.motion_weights(self._pairs)
        self._distance, self._direction = distance[:, near], direction[:, near]

    def around(self, q: FloatArray, nearest: IntArray) -> "LinkClearance":
        """Return the clearance around other configurations, without measuring everything again.

        Args:
            q: Shape (P, n), each near a known one.
            nearest: Which one, shape (P,).
        """
        other = copy(self)
        travel = abs(q - self._waypoints[nearest])
        other._distance = self._distance[nearest] - travel @ self._weights.T
        other._direction = self._direction[nearest]
        other._waypoints = q
        other.free_waypoints = self.is_free(q, nearest)
        return other

    def is_free(self, q: FloatArray, waypoint: IntArray) -> BoolArray:
        """Return whether configurations are free: bool, shape (N,).

        Args:
            q: Shape (N, n).
            waypoint: For each, the index of a waypoint near it, shape (N,).
        """
        if len(self._pairs) == 0:
            return np.ones(len(q), dtype=bool)
        travel = abs(q - self._waypoints[waypoint])
        lower = self._distance[waypoint] - travel @ self._weights.T
        free, required = np.ones(len(q), dtype=bool), self._required(q)
        doubtful = np.flatnonzero((lower < required).any(axis=1))
        required = required[doubtful]
        rotation, position = self._problem.robot.body_poses(q[doubtful])
        spheres = self._checker.sphere_distances(rotation, position, self._pairs)
        row, pair = np.nonzero(np.maximum(lower[doubtful], spheres) < required)
        direction = self._direction[waypoint[doubtful[row]], pair]
        bound = self._checker.separations_along(
            rotation[row], position[row], self._pairs[pair], direction
        )
        undecided = bound < required[row, pair]
        row, pair = row[undecided], pair[undecided]
        for i in np.unique(row):
            pairs = pair[row == i]
            distance = self._checker.distances(rotation[i], position[i], self._pairs[pairs])
            free[doubtful[i]] = (distance >= required[i, pairs]).all()
        return free

    def _required(self, q: FloatArray) -> FloatArray:
        """Return what is required of the pairs in configurations (N, n), shape (N, P) [m]."""
        tool = self._problem.robot.tool_position(q)
        return self._asked.anywhere(tool)[:, self._columns] - MARGIN_TOLERANCE
