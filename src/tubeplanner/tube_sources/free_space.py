"""Which configurations are free: links clear of obstacles and of each other, by a margin."""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.outcome import Place
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.required_distances import RequiredDistances

# Where an end of the trajectory has less clearance than the margin, this share of it is kept
# everywhere.
_SHARE_AT_ENDS = 0.9


class FreeSpace:
    """The configurations in which links are farther apart than a problem requires."""

    def __init__(self, problem: PlanningProblem, margin: float, ends: FloatArray) -> None:
        """Take the pairs of a problem.

        Args:
            problem: Its arm, obstacles and clearance count; its tube does not.
            margin: Required distance beyond the clearance [m].
            ends: Configurations (E, n), at least one, from start to goal: pairs of shapes that are
                nearer there need not be farther apart elsewhere.
        """
        checker = problem.collision
        self._robot, self._checker = problem.robot, checker
        self._pairs = checker.pairs
        self._asked = RequiredDistances(problem, ends[0], ends[-1])
        self._margin = np.zeros(len(self._pairs))
        if margin > 0:
            least = np.min([self._clearances(q) for q in ends], axis=0, initial=margin)
            self._margin = np.clip(_SHARE_AT_ENDS * least, 0.0, margin)

    def is_free(self, q: FloatArray) -> bool:
        """Return whether a configuration (n,) has the margin."""
        return self.lacking(q) is None

    def lacking(self, q: FloatArray) -> Place | None:
        """Return links too close at a configuration (n,), and where the tool is; or None."""
        rotation, position = self._robot.body_poses(q[None])
        wanted = self._required(q) + self._margin
        quick = self._checker.sphere_distances(rotation, position, self._pairs)[0] - wanted
        near = np.flatnonzero(quick < 0)
        alone = np.zeros(len(near), dtype=np.int64)
        boxes = self._checker.box_distances(rotation, position, alone, self._pairs[near])
        near = near[boxes < wanted[near]]
        distance = self._checker.distances(rotation[0], position[0], self._pairs[near])
        short = distance - wanted[near]
        if short.min(initial=0.0) >= 0:
            return None
        return self._place(q, self._pairs[near[short.argmin()]])

    def clearance(self, q: FloatArray) -> float:
        """Return the least distance beyond the clearance at a configuration (n,) [m]."""
        return float(self._clearances(q).min(initial=np.inf))

    def _clearances(self, q: FloatArray) -> FloatArray:
        rotation, position = self._robot.body_poses(q[None])
        return self._checker.distances(rotation[0], position[0], self._pairs) - self._required(q)

    def _required(self, q: FloatArray) -> FloatArray:
        return self._asked.anywhere(self._robot.tool_position(q[None]))[0]

    def _place(self, q: FloatArray, pair: IntArray) -> Place:
        links, obstacle = self._checker.owners(pair)
        return Place(links=links, obstacle=obstacle).at(self._robot.tool_position(q[None])[0])
