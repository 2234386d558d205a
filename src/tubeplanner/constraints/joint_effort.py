"""Limits on the joints' efforts: gravity at any speed, inertia with its square."""

from collections.abc import Mapping

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible, Place, PlanStatus


class JointEffort:
    """A `SpeedLimit` on the efforts of some joints.

    Attributes:
        joints: Those that are limited, I of them.
        limit: Their limits, shape (I,) [N m or N].
    """

    kind = "effort"
    order = 2
    signs = (1.0, -1.0)

    def __init__(self, limit: FloatArray) -> None:
        """Take the finite ones of n joints' limits, (n,) [N m or N]."""
        self.joints = np.flatnonzero(np.isfinite(limit))
        self.limit = limit[self.joints]
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in self.joints.tolist())

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the efforts as shares of their limits."""
        effort, gravity = at.effort[:, self.joints], at.gravity[:, self.joints]
        return SpeedPolynomial({0: gravity / self.limit, 2: (effort - gravity) / self.limit})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the shares change with the path."""
        blocks = enumerate(at.effort_derivatives(speed))
        return {k: by[:, self.joints] * (speed**k / self.limit[:, None]) for k, by in blocks}

    def key_of(self, at: PathSamples) -> IntArray:
        """Return one key per joint."""
        return np.arange(len(self.joints))[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return which joint gravity is too strong for."""
        robot = at.problem.robot
        held = abs(at.gravity[:, self.joints]) - self.limit
        sample, column = np.unravel_index(int(held.argmax()), held.shape)
        joint = int(self.joints[column])
        unit = "N m" if robot.revolute[joint] else "N"
        return Infeasible(
            PlanStatus.GRAVITY_EXCEEDS_EFFORT,
            f"joint '{robot.joint_names[joint]}' needs {abs(at.gravity[sample, joint]):.2f} {unit} "
            f"against gravity alone, its effort limit is {self.limit[column]:.2f}; lighten the "
            "payload, choose another configuration or a stronger motor",
            Place(joint=robot.joint_names[joint]).at(at.tool_pose[1][sample]),
        )
