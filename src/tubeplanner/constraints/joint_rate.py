"""Limits on the size of the joints' velocities, accelerations and jerks."""

from collections.abc import Mapping

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible, Place, PlanStatus

RATES: Mapping[str, int] = {"velocity": 1, "acceleration": 2, "jerk": 3}


class JointRate:
    """A `SpeedLimit` on one derivative of some joints' positions.

    Attributes:
        joints: Those that are limited, I of them.
        limit: Their limits, shape (I,) [rad or m, per s, s^2 or s^3].
    """

    signs = (1.0, -1.0)

    def __init__(self, kind: str, limit: FloatArray) -> None:
        """Take the finite ones of n joints' limits, (n,)."""
        self.kind, self.order = kind, RATES[kind]
        self.joints = np.flatnonzero(np.isfinite(limit))
        self.limit = limit[self.joints]
        self.keys = tuple(LimitKey(kind, joint=j) for j in self.joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the rates as shares of their limits."""
        return SpeedPolynomial({self.order: at.by_path[self.order][:, self.joints] / self.limit})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the shares change with the path: with one derivative alone."""
        count, n = at.position.shape
        change = np.zeros((len(self.joints), n))
        change[np.arange(len(self.joints)), self.joints] = speed**self.order / self.limit
        return {self.order: np.broadcast_to(change, (count, *change.shape))}

    def key_of(self, at: PathSamples) -> IntArray:
        """Return one key per joint."""
        return np.arange(len(self.joints))[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return that there is none: a path can be run as slowly as one likes."""
        return Infeasible(PlanStatus.NO_TRAJECTORY, f"{self.kind} allows no motion", Place())
