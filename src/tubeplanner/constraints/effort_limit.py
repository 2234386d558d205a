"""Effort limits of joints with Coulomb friction, or with other limits each way or by position."""

from collections.abc import Mapping

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.effort_refusal import effort_refusal
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.sided_effort import SidedEffort
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible
from tubeplanner.robot.joint_limits import JointLimits


class EffortLimit:
    """A `SpeedLimit` on the efforts of some joints, forwards and then backwards: 2 I quantities.

    Attributes:
        joints: Those that are limited, twice, shape (2 I,).
        limit: What they are shares of: the most each way anywhere, shape (2 I,) [N m or N].
    """

    kind = "effort"
    order = 2
    signs = (1.0,)

    def __init__(self, limits: JointLimits) -> None:
        """Take the joints that have a limit."""
        joints = np.flatnonzero(np.isfinite(limits.effort))
        self._effort = SidedEffort(joints)
        self.joints = self._effort.joints
        place = {int(joint): k for k, joint in enumerate(joints)}
        self._ranges = [
            (place[each.joint] + len(joints) * (way < 0), way, each)
            for each in limits.effort_ranges
            for way in (1.0, -1.0)
        ]
        self.limit = limits.effort[self.joints].copy()
        for column, way, each in self._ranges:
            self.limit[column] = each.side(way).max()
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the efforts, and what limits lack, as shares of the most."""
        allowed = np.ones((len(at), len(self.joints)))
        for column, way, each in self._ranges:
            allowed[:, column] = each.allowed(at.position[:, each.joint], way) / self.limit[column]
        terms = {k: term / self.limit for k, term in self._effort.terms(at).items()}
        terms[0] += 1 - allowed
        return SpeedPolynomial(terms, allowed)

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the shares change with the path."""
        change = {k: by / self.limit[:, None] for k, by in self._effort.by_path(at, speed).items()}
        for column, way, each in self._ranges:
            slope = each.slope(at.position[:, each.joint], way)
            change[0][:, column, each.joint] -= slope / self.limit[column]
        return change

    def key_of(self, at: PathSamples) -> IntArray:
        """Return one key per joint."""
        return np.tile(np.arange(len(self.keys)), 2)[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return which joint gravity and friction are too strong for."""
        used = self.used(at)
        sample, column = np.unravel_index(int(used.terms[0].argmax()), used.shape)
        allowed = 1.0 if used.allowed is None else float(used.allowed[sample, column])
        needed = (used.terms[0][sample, column] - 1 + allowed) * self.limit[column]
        return effort_refusal(
            at, int(sample), int(self.joints[column]), float(needed), allowed * self.limit[column]
        )
