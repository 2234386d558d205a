"""Limits on how fast the joints' efforts change: inside pieces, where the motion is smooth."""

from collections.abc import Mapping

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.robot.effort_rate import effort_rate_derivatives


class EffortRate:
    """A `SpeedLimit` on the rates of some joints' efforts.

    Those of gravity grow with s, those of viscous friction with s^2, the rest with s^3. Coulomb
    friction, which jumps, does not count.

    Attributes:
        joints: Those that are limited, I of them.
        limit: Their limits, shape (I,) [N m/s or N/s].
    """

    kind = "effort_rate"
    order = 3
    signs = (1.0, -1.0)

    def __init__(self, limit: FloatArray) -> None:
        """Take the finite ones of n joints' limits, (n,) [N m/s or N/s]."""
        self.joints = np.flatnonzero(np.isfinite(limit))
        self.limit = limit[self.joints]
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in self.joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the rates as shares of their limits."""
        rate, gravity = at.effort_rate[:, self.joints], at.gravity_rate[:, self.joints]
        motors = at.problem.robot.motors
        if not motors.has_viscous_friction:
            return SpeedPolynomial({1: gravity / self.limit, 3: (rate - gravity) / self.limit})
        viscous = (motors.viscous_friction * at.by_path[2])[:, self.joints]
        terms = {1: gravity, 2: viscous, 3: rate - gravity - viscous}
        return SpeedPolynomial({power: term / self.limit for power, term in terms.items()})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the shares change with the path."""
        state = (at.position, at.rate(1, speed), at.rate(2, speed), at.rate(3, speed))
        blocks = enumerate(effort_rate_derivatives(at.problem.robot, *state))
        return {k: by[:, self.joints] * (speed**k / self.limit[:, None]) for k, by in blocks}

    def key_of(self, at: PathSamples) -> IntArray:
        """Return one key per joint."""
        return np.arange(len(self.joints))[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return that there is none: a path can be run as slowly as one likes."""
        return Infeasible(PlanStatus.NO_TRAJECTORY, f"{self.kind} allows no motion", Place())
