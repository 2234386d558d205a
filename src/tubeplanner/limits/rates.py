"""Velocity, acceleration, jerk limits of joints; limits of the tool and of points of links."""

from collections.abc import Mapping, Sequence

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.limits.path_samples import JointSpeedLimit, KeptWhenSlow, LimitKey, PathSamples
from tubeplanner.limits.speed_polynomial import SpeedPolynomial
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Location, PlanStatus
from tubeplanner.robot.joint_limits import JointLimits
from tubeplanner.robot.model import RobotModel
from tubeplanner.robot.overrides import PointSpeed
from tubeplanner.task.problem import PlanningProblem

RATES: Mapping[str, int] = {"velocity": 1, "acceleration": 2, "jerk": 3}


class JointRate(JointSpeedLimit):
    """A `SpeedLimit` on a derivative of some joints' positions [rad or m, per s, s^2 or s^3]."""

    def __init__(self, kind: str, limit: FloatArray) -> None:
        """Take the finite limits of n joints, (n,)."""
        self.kind, self.order = kind, RATES[kind]
        super().__init__(limit)

    def terms(self, at: PathSamples) -> Mapping[int, FloatArray]:
        """Return the single term of the rates, (N, n)."""
        return {self.order: at.by_path[self.order]}

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives of the fractions by the path: a single order alone."""
        count, n = at.position.shape
        change = np.zeros((len(self.joints), n))
        change[np.arange(len(self.joints)), self.joints] = speed**self.order / self.limit
        return {self.order: np.broadcast_to(change, (count, *change.shape))}


# ---- Velocity limits that fall towards the ends of the joints' ranges, in each direction.
#
# Towards an end at the distance g, a joint may move at L = max(0, sqrt(2 d g) - o): d is the
# deceleration that would stop it there, o an offset. Away from the end there is no limit. Where g
# <= o^2 / (2 d), no motion towards the end is allowed: a joint may rest there or leave. A joint
# outside cannot come there, as L falls to zero in proportion to the remaining distance.

# A joint at rest moves at this rate by rounding [rad or m per unit of x].
_STILL = 1e-9
# The slope of sqrt(2 d g) is infinite at the end: below this fraction of the largest velocity it
# stays constant.
_MIN_ROOT = 1e-3


class VelocityByPositionLimit(JointSpeedLimit):
    """A `SpeedLimit` on the velocities of I joints, upwards and then downwards: 2 I quantities.

    Fractions are of the velocity limits or, without any, of the velocities from which joints would
    stop over their whole range.
    """

    kind = "velocity_by_position"
    order = 1
    signs = (1.0,)

    def __init__(self, limits: JointLimits) -> None:
        """Take the laws of an arm's joints."""
        laws, largest = limits.velocity_by_position, np.full(len(limits.velocity), np.inf)
        for law in laws:
            most = np.sqrt(2 * law.deceleration * (law.upper - law.lower))
            own = limits.velocity[law.joint]
            largest[law.joint] = own if np.isfinite(own) else most
        super().__init__(largest, sides=2)
        self._deceleration = np.tile([law.deceleration for law in laws], 2)
        self._offset = np.tile([law.offset for law in laws], 2)
        self._end = np.array([*(law.upper for law in laws), *(-law.lower for law in laws)])

    def allowed(self, q: FloatArray) -> FloatArray:
        """Return the largest velocities towards the ends at configurations (N, n), (N, 2 I)."""
        return np.maximum(self._root(q) - self._offset, 0.0)

    def edge(self, fraction: float = 0.0) -> FloatArray:
        """Return positions of the limits' fall to a fraction of the largest, (2 I,) [rad or m]."""
        root = self._offset + fraction * self.limit
        edge: FloatArray = self.sign * (self._end - root**2 / (2 * self._deceleration))
        return edge

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return velocities and the limits' shortfall as fractions of the largest velocities."""
        allowed = self.allowed(at.position) / self.limit
        rate = self.sign * at.by_path[1][:, self.joints]
        rate = np.where((allowed == 0) & (rate < _STILL), np.minimum(rate, 0.0), rate)
        asks = (rate > 0) | (allowed == 0)
        terms = {0: np.where(asks, 1 - allowed, 0.0), 1: rate / self.limit}
        return SpeedPolynomial(terms, allowed)

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives of the fractions by the path."""
        root = self._root(at.position)
        slope = self._deceleration / np.maximum(root, _MIN_ROOT * self.limit)
        rate = self.sign * at.by_path[1][:, self.joints]
        slope = np.where((root > self._offset) & (rate > 0), slope, 0.0)
        count, n = at.position.shape
        change = np.zeros((2, count, len(self.joints), n))
        every = np.arange(len(self.joints))
        change[0][:, every, self.joints] = self.sign * slope / self.limit
        change[1][:, every, self.joints] = self.sign * speed / self.limit
        return dict(enumerate(change))

    def refusal(self, at: PathSamples) -> Infeasible:
        """Return the refusal of a joint that moves towards its end where it must not."""
        used = self.used(at)
        sample, column = np.argwhere((used.terms[0] >= 1) & (used.terms[1] > 0))[0].tolist()
        return self.refused(at.problem.robot, at.position[sample], column)

    def refused(self, robot: RobotModel, q: FloatArray, column: int) -> Infeasible:
        """Return the refusal of a quantity that allows no motion at a configuration (n,)."""
        joint = int(self.joints[column])
        name, sign = robot.joint_names[joint], "up" if self.sign[column] > 0 else "down"
        return Infeasible(
            PlanStatus.NO_TRAJECTORY,
            f"joint '{name}' moves {sign} at {q[joint]:.4f}, where limits.{self.kind} allows it no "
            f"velocity that way: from {self.edge()[column]:.4f} on; keep start, goal and tube away "
            "from the end of its range",
            Location(joint=name).at(robot.tool_position(q[None])[0]),
        )

    def out_of_reach(self, start: FloatArray, goal: FloatArray) -> IntArray:
        """Return the quantities that allow no motion from start to goal, (n,) each, to end there.

        A motion can end at the edge only if the offset is 0: the edge is the end of the range then.
        """
        beyond = self.sign * (goal[self.joints] - self.edge())
        to_go = self.sign * (goal - start)[self.joints]
        allowed = np.where(self._offset > 0, -_STILL, _STILL)
        return np.flatnonzero((beyond > allowed) & (to_go > _STILL))

    def _root(self, q: FloatArray) -> FloatArray:
        """Return sqrt(2 d g) at configurations (N, n), shape (N, 2 I)."""
        distance = np.maximum(self._end - self.sign * q[:, self.joints], 0.0)
        root: FloatArray = np.sqrt(2 * self._deceleration * distance)
        return root


# Positions that allow less than this fraction of the largest velocity are useless to fast motions.
_WORTH_USING = 0.01


def approachable_range(problem: PlanningProblem) -> tuple[FloatArray, FloatArray]:
    """Return the ranges of useful speed, extended to fixed start and goal, (n,) each [rad or m].

    Farther out, joints can leave but not enter. Infinite where there is no such limit.
    """
    count, limits = problem.robot.joint_count, problem.robot.limits
    bounds = np.tile([[-np.inf], [np.inf]], count)
    if not limits.velocity_by_position:
        return bounds[0], bounds[1]
    limit = VelocityByPositionLimit(limits)
    upper, lower = np.split(limit.edge(_WORTH_USING), 2)
    joints = limit.joints[: len(upper)]
    bounds[:, joints] = np.where(lower < upper, [lower, upper], bounds[:, joints])
    for end in problem.endpoints:
        if (q := end.joints) is not None:
            bounds = np.array([np.minimum(bounds[0], q), np.maximum(bounds[1], q)])
    return bounds[0], bounds[1]


def require_approachable(problem: PlanningProblem, start: FloatArray, goal: FloatArray) -> None:
    """Check that no joint must end, from start to goal (n,), where it may have no velocity.

    Raises:
        Infeasible: Status no_trajectory.
    """
    if not problem.robot.limits.velocity_by_position:
        return
    limit = VelocityByPositionLimit(problem.robot.limits)
    for column in limit.out_of_reach(start, goal).tolist():
        are_given = all(end.joints is not None for end in problem.endpoints)
        # A certificate allows ends that are off by a tolerance.
        nearer = goal - 2 * MARGIN_TOLERANCE * limit.sign[column]
        proved = are_given and column in limit.out_of_reach(start, nearer)
        raise limit.refused(problem.robot, goal, column).replaced(proved=proved)


# ---- Limits on the speeds of points: of the tool centre point and of points on links; and on the
# acceleration of the tool centre point.


class PointRates(KeptWhenSlow):
    """Base of a `SpeedLimit` on the norms of vectors of P points, as fractions of their limits.

    The vectors are velocities (order 1) or accelerations (order 2). A subclass has `kind`, `keys`,
    `order`, `vectors`, `derivatives` and `allowed`.
    """

    order: int
    signs = (1.0,)

    def vectors(self, at: PathSamples) -> FloatArray:
        """Return the vectors of every point at a speed of 1, shape (P, N, 3)."""
        raise NotImplementedError

    def derivatives(self, at: PathSamples) -> Sequence[FloatArray]:
        """Return the derivatives of `vectors` by q, q' and so on, shape (P, N, 3, n) each."""
        raise NotImplementedError

    def allowed(self, at: PathSamples) -> FloatArray:
        """Return the limit of every point at every sample, shape (P, N)."""
        raise NotImplementedError

    def used(self, at: PathSamples) -> SpeedPolynomial:
        """Return the vectors' norms as fractions of their limits."""
        fractions = np.linalg.norm(self.vectors(at), axis=2) / self.allowed(at)
        return SpeedPolynomial({self.order: fractions.T})

    def by_path(self, at: PathSamples, speed: float) -> Mapping[int, FloatArray]:
        """Return the derivatives of the fractions by the path; zero where a vector is zero."""
        vectors = self.vectors(at)
        size = np.linalg.norm(vectors, axis=2, keepdims=True)
        direction = vectors / np.maximum(size, np.finfo(float).tiny)
        gradient = direction * (speed**self.order / self.allowed(at))[..., None]
        blocks = enumerate(self.derivatives(at))
        return {k: np.einsum("pni,pnij->npj", gradient, by) for k, by in blocks}


class _ToolLimit(PointRates):
    """Base of a `SpeedLimit` on a single quantity, the tool's, with a key for each segment.

    Attributes:
        limit: Of each segment, the robot's own included, shape (m,); inf where it is free.
    """

    def __init__(self, problem: PlanningProblem) -> None:
        """Take the limits of a problem's robot and tube."""
        own, of_tube = (getattr(x, self.kind) for x in (problem.robot.limits, problem.tube))
        free = np.full(problem.tube.segment_count, own)
        self.limit = free if of_tube is None else np.minimum(free, of_tube)
        self._limited = np.flatnonzero(np.isfinite(self.limit))
        self.keys = tuple(LimitKey(self.kind, segment=k) for k in self._limited.tolist())

    def allowed(self, at: PathSamples) -> FloatArray:
        """Return the limit of each sample's segment, shape (1, N)."""
        return self.limit[at.segment][None]

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the index of the key of each sample's segment; any, where that is free."""
        columns = np.searchsorted(self._limited, at.segment)
        return np.minimum(columns, len(self._limited) - 1)[:, None]


class ToolSpeed(_ToolLimit):
    """A `SpeedLimit` on the tool's speed as a fraction of its segment's limit [m/s]."""

    kind = "tool_speed"
    order = 1

    def vectors(self, at: PathSamples) -> FloatArray:
        """Return the velocity of the tool."""
        return at.tool_rate[0][None]

    def derivatives(self, at: PathSamples) -> Sequence[FloatArray]:
        """Return the derivatives of the velocity."""
        return [by[None] for by in at.tool_rate[1:]]


class ToolAcceleration(_ToolLimit):
    """A `SpeedLimit` on the tool's acceleration as a fraction of its segment's limit [m/s^2].

    Gravity is not counted.
    """

    kind = "tool_acceleration"
    order = 2

    def vectors(self, at: PathSamples) -> FloatArray:
        """Return the acceleration of the tool centre point, in its own axes."""
        return at.tool_motion[None, :, :3]

    def derivatives(self, at: PathSamples) -> Sequence[FloatArray]:
        """Return the derivatives of the acceleration, in the tool's axes."""
        return [by[None] for by in at.tool_motion_derivatives[:, :, :3]]


class PointSpeedLimit(PointRates):
    """A `SpeedLimit` on the speeds of P points that move with links, as fractions of their limits.

    Attributes:
        limit: Of each point, shape (P,) [m/s].
    """

    kind = "point_speed"
    order = 1

    def __init__(self, points: Sequence[PointSpeed]) -> None:
        """Take the points of a robot, in its order."""
        self.limit = np.array([point.speed for point in points])
        self.keys = tuple(
            LimitKey(self.kind, link=point.link, point=k) for k, point in enumerate(points)
        )

    def vectors(self, at: PathSamples) -> FloatArray:
        """Return the velocity of every point."""
        return at.point_rates[0]

    def derivatives(self, at: PathSamples) -> Sequence[FloatArray]:
        """Return the derivatives of the velocities."""
        return at.point_rates[1:]

    def allowed(self, at: PathSamples) -> FloatArray:
        """Return the limit of every point at every sample, shape (P, N)."""
        return np.repeat(self.limit[:, None], len(at), axis=1)

    def key_of(self, at: PathSamples) -> IntArray:
        """Return the index of each point's key, shape (1, P)."""
        return np.arange(len(self.limit))[None]
