"""The joints' efforts in limits that are the same both ways."""

from collections.abc import Mapping

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.effort_refusal import effort_refusal
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible
from tubeplanner.trajectory.directed_stretches import STILL_SHARE


class JointEffort:
    """A `SpeedLimit` on the efforts of some joints.

    Attributes:
        joints: Those that are limited, I of them.
        limit: Their limits, shape (I,) [N m or N].
    """

    kind = "effort"
    order = 2
    signs = (1.0, -1.0)

    def __init__(self, limit: FloatArray, *, with_coulomb_friction: bool = False) -> None:
        """Take the finite ones of n joints' limits, (n,) [N m or N].

        Args:
            limit: The limits.
            with_coulomb_friction: Whether it counts, by the signs of velocities. Its jumps have no
                derivatives: for what is summed up over a motion.
        """
        self._with_coulomb_friction = with_coulomb_friction
        self.joints = np.flatnonzero(np.isfinite(limit))
        self.limit = limit[self.joints]
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in self.joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the efforts as shares of their limits."""
        motors, own = at.problem.robot.motors, self.joints
        terms = {0: at.gravity[:, own], 2: (at.effort - at.gravity)[:, own]}
        if motors.has_viscous_friction:
            terms[1] = at.viscous_effort[:, own]
            terms[2] = terms[2] - terms[1]
        if self._with_coulomb_friction:
            terms[0] = terms[0] + motors.coulomb_effort(_moved(at.by_path[1]))[:, own]
        return SpeedPolynomial({power: term / self.limit for power, term in terms.items()})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the shares change with the path."""
        blocks = enumerate(at.effort_derivatives(speed))
        return {k: by[:, self.joints] * (speed**k / self.limit[:, None]) for k, by in blocks}

    def key_of(self, at: PathSamples) -> IntArray:
        """Return one key per joint."""
        return np.arange(len(self.joints))[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return which joint gravity is too strong for."""
        held = abs(at.gravity[:, self.joints])
        sample, column = np.unravel_index(int((held - self.limit).argmax()), held.shape)
        needed, limit = float(held[sample, column]), float(self.limit[column])
        return effort_refusal(at, int(sample), int(self.joints[column]), needed, limit)


def _moved(rate: FloatArray) -> FloatArray:
    """Return velocities without what rounding makes of those at rest: it has no direction."""
    return np.where(abs(rate) > STILL_SHARE * abs(rate).max(), rate, 0.0)
