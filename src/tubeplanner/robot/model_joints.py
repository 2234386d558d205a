"""The joints of a robot's model: the n that are planned, and those that follow one of them.

A follower is at `multiplier * q + offset`; what it takes goes to its master: `tau_master +=
multiplier * tau_follower`, by the principle of virtual work.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray, read_only
from tubeplanner.robot.urdf import Mimic, UrdfDescription


@dataclass(frozen=True, eq=False)
class ModelJoints:
    """M joints, in the order of the model; joint k moves body k + 1 and all that hangs from it.

    Attributes:
        planned: Which planned joint each is or follows, as group index, shape (M,).
        multiplier: How fast it follows, shape (M,); 1 for a planned joint.
        offset: Where it is when the planned joint is at 0, shape (M,) [rad or m].
        turns: Whether it turns (rather than slides), shape (M,).
        own: Which of the M joints each planned joint is, shape (n,).
    """

    planned: IntArray
    multiplier: FloatArray
    offset: FloatArray
    turns: BoolArray
    own: IntArray

    def positions(self, q: FloatArray) -> FloatArray:
        """Return the positions of all joints, shape (N, M), from those of the group (N, n)."""
        values = q if self._in_order else q[:, self.planned]
        if self._has_followers:
            values = values * self.multiplier + self.offset
        return np.ascontiguousarray(values, dtype=np.float64)

    def rates(self, v: FloatArray) -> FloatArray:
        """Return velocities or accelerations of all joints, (N, M), from the group's (N, n)."""
        values = v if self._in_order else v[:, self.planned]
        if self._has_followers:
            values = values * self.multiplier
        return np.ascontiguousarray(values, dtype=np.float64)

    def collected(self, columns: FloatArray) -> FloatArray:
        """Return what all joints do or take together (..., M) by planned joint, (..., n)."""
        return self._sums(columns, self.multiplier)

    def collected_bounds(self, columns: FloatArray) -> FloatArray:
        """Return bounds on absolute values (..., M) summed up by planned joint, (..., n)."""
        return self._sums(columns, abs(self.multiplier))

    def of_own(self, values: FloatArray) -> FloatArray:
        """Return values (n,) of the planned joints among those of all joints, (M,); others 0."""
        among = np.zeros(len(self.planned))
        among[self.own] = values
        return among

    def travel(self, lower: FloatArray, upper: FloatArray) -> FloatArray:
        """Return how far from zero the joints get within limits (n,), shape (M,) [rad or m]."""
        ends = self.positions(np.stack([lower, upper]))
        return abs(ends).max(axis=0)

    @cached_property
    def _has_followers(self) -> bool:
        return len(self.planned) > len(self.own)

    @cached_property
    def _in_order(self) -> bool:
        """Whether the M joints are the planned ones, in the same order."""
        return np.array_equal(self.planned, np.arange(len(self.own)))

    def _sums(self, columns: FloatArray, multiplier: FloatArray) -> FloatArray:
        if not self._has_followers:
            return columns if self._in_order else columns[..., self.own]
        sums = np.zeros((*columns.shape[:-1], len(self.own)))
        for joint, (planned, factor) in enumerate(zip(self.planned, multiplier, strict=True)):
            sums[..., planned] += factor * columns[..., joint]
        return sums


def model_joints(
    description: UrdfDescription,
    names: Sequence[str],
    group: Sequence[str],
    followers: Mapping[str, Mimic],
) -> ModelJoints:
    """Return the joints of a model.

    Args:
        description: The robot.
        names: Their names, in the order of the model.
        group: Those that are planned.
        followers: The rules of the others, by name.
    """
    rules = [followers.get(name, Mimic(name, 1.0, 0.0)) for name in names]
    return ModelJoints(
        planned=np.array([group.index(rule.master) for rule in rules], dtype=np.int64),
        multiplier=read_only([rule.multiplier for rule in rules]),
        offset=read_only([rule.offset for rule in rules]),
        turns=np.array([description.joints[name].type != "prismatic" for name in names]),
        own=np.array([list(names).index(name) for name in group], dtype=np.int64),
    )
