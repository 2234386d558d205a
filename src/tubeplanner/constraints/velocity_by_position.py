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
from tubeplanner.robot.robot_model import RobotModel

# A joint at rest moves at this rate by rounding [rad or m per unit of x].
_STILL = 1e-9
# The slope of sqrt(2 d g) is infinite at the end: from this share of the largest velocity down, it
# is taken as there.
_LEAST_ROOT = 1e-3


class VelocityByPositionLimit:
    """A `SpeedLimit` on the velocities of I joints, upwards and then downwards: 2 I quantities.

    Attributes:
        joints: Those that are limited, twice, shape (2 I,).
        way: Towards which end, 1 or -1, shape (2 I,).
        largest: Their velocity limits or, where there are none, those from which they would stop
            over the whole range, shape (2 I,) [rad/s or m/s].
    """

    kind = "velocity_by_position"
    order = 1
    signs = (1.0,)

    def __init__(self, limits: JointLimits) -> None:
        """Take the laws of an arm's joints."""
        laws = limits.velocity_by_position
        joints = np.array([law.joint for law in laws], dtype=np.int64)
        self.joints = np.tile(joints, 2)
        self.way = np.repeat([1.0, -1.0], len(laws))
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

    def edge(self, share: float = 0.0) -> FloatArray:
        """Return where what is allowed falls to a share of the largest, shape (2 I,) [rad or m]."""
        root = self._offset + share * self.largest
        edge: FloatArray = self.way * (self._end - root**2 / (2 * self._deceleration))
        return edge

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return velocities, and what the laws take off the largest, as shares of that."""
        allowed = self.allowed(at.position) / self.largest
        rate = self.way * at.by_path[1][:, self.joints]
        rate = np.where((allowed == 0) & (rate < _STILL), np.minimum(rate, 0.0), rate)
        asks = (rate > 0) | (allowed == 0)
        terms = {0: np.where(asks, 1 - allowed, 0.0), 1: rate / self.largest}
        return SpeedPolynomial(terms, allowed)

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return how the shares change with the path."""
        root = self._root(at.position)
        slope = self._deceleration / np.maximum(root, _LEAST_ROOT * self.largest)
        rate = self.way * at.by_path[1][:, self.joints]
        slope = np.where((root > self._offset) & (rate > 0), slope, 0.0)
        count, n = at.position.shape
        change = np.zeros((2, count, len(self.joints), n))
        every = np.arange(len(self.joints))
        change[0][:, every, self.joints] = self.way * slope / self.largest
        change[1][:, every, self.joints] = self.way * speed / self.largest
        return dict(enumerate(change))

    def key_of(self, at: PathSamples) -> IntArray:
        """Return one key per joint."""
        return np.tile(np.arange(len(self.keys)), 2)[None]

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return which joint moves towards its end where it must not."""
        used = self.used(at)
        sample, column = np.argwhere((used.terms[0] >= 1) & (used.terms[1] > 0))[0].tolist()
        return self.refused(at.problem.robot, at.position[sample], column)

    def refused(self, robot: RobotModel, q: FloatArray, column: int) -> Infeasible:
        """Return that one of the quantities allows no motion at a configuration (n,)."""
        joint = int(self.joints[column])
        name, way = robot.joint_names[joint], "up" if self.way[column] > 0 else "down"
        return Infeasible(
            PlanStatus.NO_TRAJECTORY,
            f"joint '{name}' moves {way} at {q[joint]:.4f}, where limits.{self.kind} allows it no "
            f"velocity that way: from {self.edge()[column]:.4f} on; keep start, goal and tube away "
            "from the end of its range",
            Place(joint=name).at(robot.tool_position(q[None])[0]),
        )

    def out_of_reach(self, start: FloatArray, goal: FloatArray) -> IntArray:
        """Return the quantities that let no motion from start to goal, (n,) each, end there.

        An end is reached only if the offset is 0, and so only then the outermost place.
        """
        beyond = self.way * (goal[self.joints] - self.edge())
        to_go = self.way * (goal - start)[self.joints]
        allowed = np.where(self._offset > 0, -_STILL, _STILL)
        return np.flatnonzero((beyond > allowed) & (to_go > _STILL))

    def _root(self, q: FloatArray) -> FloatArray:
        """Return sqrt(2 d g) at configurations (N, n), shape (N, 2 I)."""
        left = np.maximum(self._end - self.way * q[:, self.joints], 0.0)
        root: FloatArray = np.sqrt(2 * self._deceleration * left)
        return root
