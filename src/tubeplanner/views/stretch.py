"""A part of a motion that is judged under one problem: all of it, or a leg of a cycle."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.closest_pairs import ClosestPairs, closest_pairs
from tubeplanner.constraints.limit_use import LimitUses, limit_uses
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of a motion under one problem.

    Attributes:
        problem: The problem.
        trajectory: Of its joints, in their order, from time zero.
        begin: When it begins in the whole motion [s].
    """

    problem: PlanningProblem
    trajectory: JointTrajectory
    begin: float = 0.0

    @cached_property
    def uses(self) -> LimitUses:
        """How much of its limits it uses."""
        return limit_uses(self.problem, self.trajectory)

    @cached_property
    def closest(self) -> list[ClosestPairs]:
        """Its closest pairs at the times of `uses`."""
        return closest_pairs(self.problem, self.trajectory, self.uses.samples.time)

    def inside(self, time: FloatArray) -> IntArray:
        """Return which of the times (K,) [s] of the whole motion are in it."""
        late = time > self.begin + self.trajectory.duration * (1 + 1e-12)
        return np.flatnonzero((time >= self.begin) & ~late)

    def nearest(self, time: FloatArray) -> IntArray:
        """Return the samples of `uses` nearest to times (K,) of its own [s]."""
        own = self.uses.samples.time
        later = np.clip(np.searchsorted(own, time), 1, len(own) - 1)
        return later - (time - own[later - 1] < own[later] - time)
