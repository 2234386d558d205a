"""The links' clearance beyond the required one at many configurations, and its derivative."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.measurement.separation_bounds import separation_bounds
from tubeplanner.problem.problem import PlanningProblem


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
        required: Least distance of each pair, shape (P,) [m].
    """

    def __init__(self, problem: PlanningProblem, extra: float) -> None:
        """Take the pairs of a problem; `extra` [m] is required beyond the problem's clearance."""
        checker = problem.collision
        self._checker, self._robot = checker, problem.robot
        self.pairs = checker.pairs
        self.required = checker.required(problem.clearance) + extra

    def least(self, q: FloatArray, near: float) -> LeastClearance:
        """Return the least clearance in configurations (N, n), where it is below `near` [m].

        A positive clearance may be given as less than it is; a negative one is exact for the pair
        that is named, and others may have even less.
        """
        if len(self.pairs) == 0:
            return LeastClearance(np.full(len(q), np.inf), np.zeros(len(q), dtype=np.int64))
        rotation, position = self._robot.body_poses(q)
        bound = self._checker.sphere_distances(rotation, position, self.pairs) - self.required
        for k in np.flatnonzero((bound < near).any(axis=0)):
            rows = np.flatnonzero(bound[:, k] < near)
            first, second = (self._checker.shapes[index] for index in self.pairs[k])
            enough = near + self.required[k]
            apart = separation_bounds(first, second, rotation[rows], position[rows], enough)
            bound[rows, k] = apart - self.required[k]
        bound[bound >= near] = np.inf
        for row in np.flatnonzero((bound < 0).any(axis=1)):
            for k in bound[row].argsort():
                if bound[row, k] >= 0:
                    break
                pairs = self.pairs[k][None]
                distance = self._checker.distances(rotation[row], position[row], pairs)[0]
                bound[row, k] = distance - self.required[k]
                if bound[row, k] < 0:
                    bound[row, np.arange(len(self.pairs)) != k] = np.inf
                    break
        pair = bound.argmin(axis=1)
        return LeastClearance(bound[np.arange(len(q)), pair], pair)

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
