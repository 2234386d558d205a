"""The links' clearance beyond the required one at many configurations, and its derivative."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.measurement.clearance_bounds import ClearanceBounds
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import in_contact, required_everywhere


@dataclass(frozen=True, eq=False)
class LeastClearance:
    """The pair of shapes with the least clearance, in N configurations.

    Attributes:
        clearance: Its distance beyond the required one, negative where it is too close, shape (N,)
            [m]; infinite where no pair is near.
        pair: Its index, shape (N,).
    """

    clearance: FloatArray
    pair: IntArray


class PairClearance:
    """The pairs of shapes that must stay apart, and how much farther apart they are.

    Attributes:
        pairs: As indices of the checker's shapes, shape (P, 2).
        required: Least distance of each pair, shape (P,) [m]: the most that a segment asks. Pairs
            in contact at start or goal may be anywhere: -inf.
    """

    def __init__(self, problem: PlanningProblem, extra: float) -> None:
        """Take the pairs of a problem; `extra` [m] is required beyond the problem's clearance."""
        checker = problem.collision
        self._checker, self._robot = checker, problem.robot
        self.pairs = checker.pairs
        required = required_everywhere(problem) + extra
        self.required = np.where(in_contact(problem), -np.inf, required)
        self._bounds = ClearanceBounds(checker, self.pairs, self.required)

    def least(self, q: FloatArray, near: float) -> LeastClearance:
        """Return the least clearance in configurations (N, n), where it is below `near` [m].

        A positive clearance may be given as less than it is; a negative one is exact for the pair
        that is named, and others may have even less.
        """
        if len(self.pairs) == 0:
            return LeastClearance(np.full(len(q), np.inf), np.zeros(len(q), dtype=np.int64))
        rotation, position = self._robot.body_poses(q)
        bound, least = self._bounds.at(rotation, position, near)
        self._settle_overlaps(bound, np.flatnonzero(least < 0), rotation, position)
        pair = bound.argmin(axis=1)
        return LeastClearance(bound[np.arange(len(q)), pair], pair)

    def _settle_overlaps(
        self, bound: FloatArray, live: IntArray, rotation: FloatArray, position: FloatArray
    ) -> None:
        """Replace negative bounds (N, P) by clearances, until one of a row is negative itself.

        The other entries of such a row become infinite. Negative bounds are in the rows `live`.
        """
        while len(live):
            pair = bound[live].argmin(axis=1)
            closest = self._checker.closest_points(rotation[live], position[live], self.pairs[pair])
            clearance = closest.distance - self.required[pair]
            hit = live[clearance < 0]
            bound[hit] = np.inf
            bound[live, pair] = clearance
            live = live[(clearance >= 0) & (bound[live] < 0).any(axis=1)]

    def of_pairs(self, q: FloatArray, pair: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return the clearance of one pair in each of N configurations, and its derivative.

        Args:
            q: Shape (N, n).
            pair: Which pair, shape (N,).

        Returns:
            Clearance (N,) [m] and its derivative by the joints (N, n) [m/rad or 1].
        """
        rotation, position = self._robot.body_poses(q)
        pairs = self.pairs[pair]
        closest = self._checker.closest_points(rotation, position, pairs)
        gradient = self._checker.distance_gradient(rotation, position, pairs, closest)
        return closest.distance - self.required[pair], gradient
