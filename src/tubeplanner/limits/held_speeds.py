"""Speeds that an arm can hold in bends of a tube: widest arcs, and the tool's largest acceleration.

A path that turns by th within r of two straight lines is no wider than the arc of the radius
R = 2r / (1 - cos(th / 2)). A tool that keeps the speed v on it has the acceleration v^2 / R towards
its centre, so that v is at most sqrt(a R), a being the tool's largest acceleration that way.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.path_samples import JointSpeedLimit, LimitKey, PathSamples, SpeedLimit
from tubeplanner.limits.speed_limits import speed_limits
from tubeplanner.task.problem import PlanningProblem

TOOL = "tool"


@dataclass(frozen=True)
class HeldSpeed:
    """A speed of the tool that joints can hold somewhere, and what limits it."""

    speed: float  # [m/s]; inf: nothing limits it
    kind: str  # of the limit, such as "acceleration"
    name: str  # of the limited joint, or "tool"
    joint: str | None = None  # name of that joint; None: another limit
    acceleration: float = np.inf  # the tool's largest into the bend [m/s^2]


# ---- Bends of a tube: how far the path turns about each point, and the widest arc there.

# A bend of short segments counts as a whole up to so many points on both sides of its middle.
_MAX_WINDOW = 200
_STRAIGHT = 1e-6  # [rad]


@dataclass(frozen=True, eq=False)
class Bend:
    """A bend of a tube about an inner reference point."""

    point: int  # index of the point
    angle: float  # by which the path turns [rad]
    length: float  # of the path on which it turns; 0 at a single corner [m]
    radius: float  # the smaller effective radius beside the point [m]
    before: FloatArray  # unit vectors along the path before and after the bend, (3,) each
    after: FloatArray

    @property
    def arc(self) -> float:
        """Radius of the widest arc [m]; inf where the path is straight."""
        return widest_arc(self.radius, self.angle, self.length)

    def radius_for(self, speed: float, acceleration: float) -> float:
        """Return the radius of the tube at which a speed [m/s] can be held [m]."""
        if self.angle < _STRAIGHT:
            return 0.0
        missing = speed**2 / acceleration - self.length / self.angle
        return float(max(missing, 0.0) * (1 - np.cos(self.angle / 2)) / 2)


def widest_arc(radius: float, angle: float, length: float = 0.0) -> float:
    """Return the radius of the widest arc in a strip of a half width `radius` that turns [m].

    Args:
        radius: Half width of the strip [m].
        angle: By which it turns [rad].
        length: Of its centre line on which it turns evenly; 0: at a corner [m].
    """
    if angle < _STRAIGHT:
        return np.inf
    return float(length / angle + 2 * radius / (1 - np.cos(angle / 2)))


def sharpest_bends(tube: Tube) -> list[Bend]:
    """Return the bend about every inner point of a tube, with the narrowest arc.

    Of many short segments several count together, as many as leave the least room for an arc:
    single ones turn by little, and noise turns back at once.
    """
    steps = np.diff(tube.points, axis=0)
    length = np.linalg.norm(steps, axis=1)
    along, travel = steps / length[:, None], np.concatenate([[0.0], np.cumsum(length)])
    radius, count = tube.effective_radius, tube.segment_count
    bends = []
    for point in range(1, count):
        window = np.arange(min(point, count - point, _MAX_WINDOW))
        before, after = along[point - 1 - window], along[point + window]
        across = np.linalg.norm(np.cross(before, after), axis=1)
        angle = np.arctan2(across, np.einsum("ni,ni->n", before, after))
        turned = travel[point + window] - travel[point - window]
        own = float(min(radius[point - 1 : point + 1]))
        sizes = zip(angle.tolist(), turned.tolist(), strict=True)
        arcs = [widest_arc(own, th, straight) for th, straight in sizes]
        k = int(np.argmin(arcs))
        bends.append(Bend(point, float(angle[k]), float(turned[k]), own, before[k], after[k]))
    return bends


def held_speed(problem: PlanningProblem, bend: Bend, q: FloatArray) -> HeldSpeed:
    """Return about the largest speed that the tool can hold in a bend [m/s].

    Of the velocity along it and the acceleration into it, the one that allows less counts. Efforts
    that grow with the velocity do not count, nor limits on jerk.

    Args:
        problem: The planning problem.
        bend: The bend.
        q: Configuration with the tool there, shape (n,).
    """
    if not np.isfinite(bend.arc):
        return largest_speed(problem, bend.point, bend.before, q)
    # The directions along the arc, and those to its centre.
    into = bend.after - (bend.after @ bend.before) * bend.before
    size = float(np.linalg.norm(into))
    angle = np.linspace(0, bend.angle, _DIRECTIONS if size > 0 else 1)[:, None]
    into = into / max(size, _ROUNDING)
    along = np.cos(angle) * bend.before + np.sin(angle) * into
    inwards = np.cos(angle) * into - np.sin(angle) * bend.before
    speeds = [largest_speed(problem, bend.point, each, q) for each in along]
    held = min(speeds, key=lambda each: each.speed)
    if size == 0:  # the path turns back, in any plane
        return held
    # While the tool passes the arc, in the time T = th sqrt(R / a), it may turn from one end of its
    # rotation tolerance b to the other and back: by angular accelerations up to 8 b / T^2, about.
    turned = _TURNS / (bend.angle**2 * bend.arc)
    rates = _Rates(problem, bend.point, q, order=2)
    each_way = [rates.largest(each, turned) for each in inwards]
    a, key = min(each_way, key=lambda each: each[0])
    speed = float(np.sqrt(a * bend.arc))
    if speed > held.speed:
        return replace(held, acceleration=a)
    return HeldSpeed(speed, *_named(problem, key), a)


def largest_speed(
    problem: PlanningProblem, segment: int, direction: FloatArray, q: FloatArray
) -> HeldSpeed:
    """Return the largest speed of the tool in a direction, which velocity limits allow [m/s].

    Args:
        problem: The planning problem.
        segment: Index of the tool's segment.
        direction: A vector along it, shape (3,).
        q: Configuration with the tool there, shape (n,).
    """
    speed, key = _Rates(problem, segment, q, order=1).largest(direction)
    return HeldSpeed(speed, *_named(problem, key))


def _named(problem: PlanningProblem, key: LimitKey) -> tuple[str, str, str | None]:
    joint = None if key.joint is None else problem.robot.joint_names[key.joint]
    return key.kind, joint or TOOL, joint


# ---- The largest velocity or acceleration of the tool in a direction, with none across: a linear
# program over the joints' velocities or accelerations, all other derivatives zero.
#
# Joints' limits are linear in them. Others, such as the norm of the tool's acceleration, then take
# what they allow of the solution: exactly for the tool's own, somewhat too little for held parts.

_DIRECTIONS = 5  # on an arc
_TURNS = 8.0
_UNLIMITED = 1e6  # bound on rates of joints [rad or m per s or s^2]
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class _Rates:
    """Velocities (order 1) or accelerations (2) of the joints in a configuration, all else zero."""

    problem: PlanningProblem
    segment: int  # index of the tool's segment
    q: FloatArray  # shape (n,)
    order: int

    def largest(self, direction: FloatArray, turned: float = 0.0) -> tuple[float, LimitKey]:
        """Return the tool's largest rate in a direction (3,), and the limit that bounds it.

        `turned` is the angular acceleration about an axis of a bounded rotation per its bound and
        per the tool's rate.
        """
        from scipy.optimize import linprog

        n = self.problem.robot.joint_count
        unit = direction / np.linalg.norm(direction)
        jacobian, bound = self._rotation
        turning = -turned * bound[:, None]
        upper = [np.column_stack([sign * jacobian, turning]) for sign in (1.0, -1.0)]
        free, keys = [np.zeros(2 * len(bound))], [LimitKey("rotation")] * (2 * len(bound))
        still = self._path(np.zeros(n))
        for limit in self._limits:
            if not isinstance(limit, JointSpeedLimit):
                continue
            used, by_rate = limit.used(still).at(1.0)[0], limit.by_path(still, 1.0)
            for sign in limit.signs:
                rows = sign * by_rate[self.order][0]
                upper.append(np.column_stack([rows, np.zeros(len(rows))]))
                free.append(1 - sign * used)
                keys += [limit.keys[k] for k in limit.key_of(still)[0].tolist()]
        solution = linprog(
            np.append(np.zeros(n), -1.0),
            A_ub=np.vstack(upper),
            b_ub=np.concatenate(free),
            A_eq=np.column_stack([still.tool_jacobian[0, :3], -unit]),
            b_eq=np.zeros(3),
            bounds=[(-_UNLIMITED, _UNLIMITED)] * n + [(0, None)],
        )
        if solution.x is None:  # the motors do not even hold the arm there
            return 0.0, LimitKey("effort")
        key = keys[int(np.argmin(solution.ineqlin.marginals))] if keys else LimitKey("")
        share, at = 1.0, self._path(solution.x[:-1])
        for limit in self._limits:
            speeds = limit.used(at).largest_speed(limit.signs)[0]
            least = int(speeds.argmin())
            if (own := float(speeds[least]) ** self.order) < share - _ROUNDING:
                share, key = own, limit.keys[int(limit.key_of(at)[0, least])]
        return share * float(solution.x[-1]), key

    @cached_property
    def _limits(self) -> list[SpeedLimit]:
        return [each for each in speed_limits(self.problem) if each.order == self.order]

    def _path(self, rates: FloatArray) -> PathSamples:
        states = np.zeros((4, 1, len(rates)))
        states[0], states[self.order] = self.q, rates
        return PathSamples(self.problem, states, lambda: np.array([self.segment]))

    @property
    def _rotation(self) -> tuple[FloatArray, FloatArray]:
        """The angular Jacobian about axes of bounded rotation, (K, n), and the bounds (K,) [rad].

        At the point before the segment, the smaller bounds of both segments.
        """
        robot, rotation = self.problem.robot, self.problem.tube.rotation
        if rotation is None:
            return np.zeros((0, robot.joint_count)), np.zeros(0)
        tool, jacobian = robot.tool_jacobian(self.q[None])
        both = rotation.bounds[max(self.segment - 1, 0) : self.segment + 1].min(axis=0)
        bounds = np.minimum(both[:3], both[3])
        axes = rotation.reference(tool, np.array([self.segment]))[0].T
        is_bounded = np.isfinite(bounds)
        return (axes @ jacobian[0, 3:])[is_bounded], bounds[is_bounded]
