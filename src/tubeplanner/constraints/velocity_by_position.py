"""Velocity limits that fall towards the ends of the joints' ranges, each way of its own.

Towards an end at the distance g, a joint may move at L = max(0, sqrt(2 d g) - o): d is the
deceleration that would stop it there, o an offset. Away from it, this limit asks nothing. Where
g <= o^2 / (2 d), no motion towards the end is allowed: a joint may rest there or leave. A joint
that is not there cannot come there, as L falls to zero in proportion to what is left.
"""

from collections.abc import Mapping

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limit import LimitKey
from tubeplanner.constraints.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.robot.joint_limits import JointLimits

# A joint at rest moves at this rate by rounding [rad or m per unit of x].
_STILL = 1e-9
# The slope of sqrt(2 d g) is infinite at the end: from this share of the largest velocity down, it
# is taken as there.
_LEAST_ROOT = 1e-3


class VelocityByPositionLimit:
    """A `SpeedLimit` on the velocities of I joints, upwards and then downwards: 2 I quantities.

    Attributes:
        joints: Those that are limited, twice, shape (2 I,).
        largest: Their velocity limits or, where there are none, those from which they would stop
            over the whole range, shape (2 I,) [rad/s or m/s].
    """

    kind = "velocity_by_position"
    signs = (1.0,)

    def __init__(self, limits: JointLimits) -> None:
        """Take the laws of an arm's joints."""
        laws = limits.velocity_by_position
        joints = np.array([law.joint for law in laws], dtype=np.int64)
        self.joints = np.tile(joints, 2)
        self._way = np.repeat([1.0, -1.0], len(laws))
        self._deceleration = np.tile([law.deceleration for law in laws], 2)
        self._offset = np.tile([law.offset for law in laws], 2)
        lower, upper = (np.array([getattr(law, end) for law in laws]) for end in ("lower", "upper"))
        self._end = np.append(upper, -lower)
        most = np.sqrt(2 * self._deceleration * np.tile(upper - lower, 2))
        own = limits.velocity[self.joints]
        self.largest = np.where(np.isfinite(own), own, most)
        self.keys = tuple(LimitKey(self.kind, joint=j) for j in joints.tolist())

    def allowed(self, q: FloatArray) -> FloatArray:
        """Return how fast joints may move towards their ends at configurations (N, n), (N, 2 I)."""
        return np.maximum(self._root(q) - self._offset, 0.0)

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return velocities, and what the laws take off the largest, as shares of that."""
        allowed = self.allowed(at.position)
        rate = self._way * at.by_path[1][:, self.joints]
        rate = np.where((allowed == 0) & (rate < _STILL), np.minimum(rate, 0.0), rate)
        return SpeedPolynomial({0: 1 - allowed / self.largest, 1: rate / self.largest})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the shares change with the path."""
        root = self._root(at.position)
        slope = self._deceleration / np.maximum(root, _LEAST_ROOT * self.largest)
        slope = np.where(root > self._offset, slope, 0.0)
        count, n = at.position.shape
        change = np.zeros((2, count, len(self.joints), n))
        every = np.arange(len(self.joints))
        change[0][:, every, self.joints] = self._way * slope / self.largest
        change[1][:, every, self.joints] = self._way * speed / self.largest
        return dict(enumerate(change))

    def key_of(self, at: PathSamples) -> IntArray:
        """Return one key per joint."""
        return np.tile(np.arange(len(self.keys)), 2)[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return which joint moves towards its end where it must not."""
        used = self.used(at)
        blocked = (used.terms[0] >= 1) & (used.terms[1] > 0)
        sample, column = np.argwhere(blocked)[0].tolist()
        robot, joint = at.problem.robot, int(self.joints[column])
        name, way = robot.joint_names[joint], "up" if self._way[column] > 0 else "down"
        reach = self._end[column] - self._offset[column] ** 2 / (2 * self._deceleration[column])
        edge = f"{'beyond' if self._way[column] > 0 else 'below'} {self._way[column] * reach:.4f}"
        return Infeasible(
            PlanStatus.NO_TRAJECTORY,
            f"joint '{name}' moves {way} at {at.position[sample, joint]:.4f}, and "
            f"limits.{self.kind} allows that nowhere {edge}; keep start, goal and tube away "
            "from the end of its range",
            Place(joint=name).at(at.tool_pose[1][sample]),
        )

    def _root(self, q: FloatArray) -> FloatArray:
        """Return sqrt(2 d g) at configurations (N, n), shape (N, 2 I)."""
        left = np.maximum(self._end - self._way * q[:, self.joints], 0.0)
        root: FloatArray = np.sqrt(2 * self._deceleration * left)
        return root
