"""Every condition of a motion at samples, and its derivatives by what an optimiser may change.

A motion is a spline over phases, run in T seconds. What may change are its control points C, its
inner gates g, and its squared duration y = T^2, by the relative step eta = dy / y. Rows are linear:
control . dC + gate . dg + duration eta <= room, each divided by its own limit. Products with y keep
them exact in y (Hollerbach 1984: efforts scale as tau = h / y + g).
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.phase_spline import Basis
from tubeplanner.problem import PlanningProblem
from tubeplanner.robot import RobotModel
from tubeplanner.time_scaling import scaling_factor

# Planes about a capsule's axis, on both sides of the outward direction [rad].
_FAN = np.radians([0.0, 15.0, -15.0, 45.0, -45.0, 90.0, -90.0, 180.0])
_NO_LENGTH = 1e-9  # [m]


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """Joint positions at N samples and their derivatives by x, run in T seconds.

    Attributes:
        basis: What the samples take of the control points.
        by_x: Position and three derivatives, shape (4, N, n).
        by_gate: Their derivatives by the inner gates, shape (gates, 4, N, n).
        duration: T [s].
    """

    basis: Basis
    by_x: FloatArray
    by_gate: FloatArray
    duration: float

    @property
    def position(self) -> FloatArray:
        """Shape (N, n)."""
        return self.by_x[0]

    def rate(self, order: int) -> FloatArray:
        """Return velocity (1), acceleration (2) or jerk (3), shape (N, n)."""
        rate: FloatArray = self.by_x[order] / self.duration**order
        return rate


def sampled_motion(basis: Basis, control_points: FloatArray, duration: float) -> SampledMotion:
    """Return the motion of control points (K, n) at the samples of a basis."""
    taken = control_points[basis.first[:, None] + np.arange(basis.values.shape[2])]
    by_x = np.einsum("onr,nrj->onj", basis.values, taken)
    by_gate = np.einsum("gonr,nrj->gonj", basis.by_gate, taken)
    return SampledMotion(basis, by_x, by_gate, duration)


@dataclass(frozen=True, eq=False)
class Rows:
    """R linear conditions.

    Attributes:
        first: The first of the four control points that count, shape (R,).
        control: Shape (R, 4, n).
        gate: Shape (R, gates).
        duration: Shape (R,).
        room: Shape (R,).
    """

    first: IntArray
    control: FloatArray
    gate: FloatArray
    duration: FloatArray
    room: FloatArray

    def __len__(self) -> int:
        return len(self.room)

    def where(self, keep: BoolArray | IntArray) -> "Rows":
        """Return some of the rows."""
        return Rows(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def reach(self, trust: float, gate_trust: float) -> FloatArray:
        """Return how far a step within the trust region can move each row, shape (R,)."""
        control = abs(self.control).sum(axis=(1, 2))
        return trust * control + gate_trust * abs(self.gate).sum(axis=1)


def stacked(parts: list[Rows]) -> Rows:
    """Return several sets of rows as one."""
    names = Rows.__dataclass_fields__
    return Rows(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def least_squared_durations(robot: RobotModel, motion: SampledMotion) -> FloatArray:
    """Return the smallest y = T^2 that the limits allow at each sample, shape (N,) [s^2].

    inf where gravity alone needs a motor's whole effort. (Suh & Bishop 1988, property 2.)
    """
    q, v, a, jerk = motion.by_x
    factor = scaling_factor(robot, q, v, a).min(axis=1)
    by_jerk = np.cbrt(abs(jerk) / robot.limits.jerk).max(axis=1)
    with np.errstate(divide="ignore"):
        return np.maximum(1 / factor, by_jerk) ** 2


def limit_rows(robot: RobotModel, motion: SampledMotion) -> Rows:
    """Return the rows of effort, velocity, acceleration and jerk, for both directions."""
    limits, parts = robot.limits, []
    if np.isfinite(limits.effort).any():
        parts += _effort_rows(robot, motion)
    for order, limit in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk)):
        for joint in np.flatnonzero(np.isfinite(limit)):
            parts += _rate_rows(motion, order, int(joint), float(limit[joint]))
    return stacked(parts)


def _effort_rows(robot: RobotModel, motion: SampledMotion) -> list[Rows]:
    q, v, a = motion.position, motion.rate(1), motion.rate(2)
    gravity, tau = robot.gravity_effort(q), robot.inverse_dynamics(q, v, a)
    blocks = robot.inverse_dynamics_derivatives(q, v, a)
    scales = motion.duration ** -np.arange(3.0)
    weights = motion.basis.values[:3] * scales[:, None, None]
    by_gate = motion.by_gate[:, :3] * scales[:, None, None]
    parts = []
    for joint in np.flatnonzero(np.isfinite(robot.limits.effort)):
        limit = robot.limits.effort[joint]
        by_state = np.stack([block[:, joint] for block in blocks]) / limit
        control = np.einsum("onr,onj->nrj", weights, by_state)
        gate = np.einsum("gonj,onj->ng", by_gate, by_state)
        for sign in (1.0, -1.0):
            parts.append(
                Rows(
                    motion.basis.first,
                    sign * control,
                    sign * gate,
                    sign * gravity[:, joint] / limit - 1,
                    1 - sign * tau[:, joint] / limit,
                )
            )
    return parts


def _rate_rows(motion: SampledMotion, order: int, joint: int, limit: float) -> list[Rows]:
    scale = 1 / (limit * motion.duration**order)
    count, joints = motion.position.shape
    control = np.zeros((count, motion.basis.values.shape[2], joints))
    control[:, :, joint] = scale * motion.basis.values[order]
    gate = scale * motion.by_gate[:, order, :, joint].T
    used = scale * motion.by_x[order, :, joint]
    duration = np.full(count, -order / 2)
    return [
        Rows(motion.basis.first, sign * control, sign * gate, duration, 1 - sign * used)
        for sign in (1.0, -1.0)
    ]


def tube_excess(
    problem: PlanningProblem, motion: SampledMotion, segment: IntArray, margin: float
) -> FloatArray:
    """Return how far the hand is outside capsules smaller by a share, in radii, shape (N,)."""
    hand = problem.robot.tool_position(motion.position)
    distance = problem.tube.distance(hand)[np.arange(len(hand)), segment]
    return distance / problem.tube.effective_radius[segment] - (1 - margin)


def tube_rows(
    problem: PlanningProblem, motion: SampledMotion, segment: IntArray, margin: float
) -> Rows:
    """Return rows that keep the hand in capsules smaller by a share of their radii.

    A capsule is convex: the hand is inside if it is behind every supporting plane n.p <= max(n.A,
    n.B) + r, A and B being the ends of the axis. Planes are taken about the outward direction, and
    at both caps.
    """
    tube = problem.tube
    hand, jacobian = problem.robot.tool_jacobian(motion.position)
    linear = jacobian[:, :3]
    begin, end = tube.points[:-1][segment], tube.points[1:][segment]
    axis = (end - begin) / np.linalg.norm(end - begin, axis=1)[:, None]
    radius = tube.effective_radius[segment]
    nearest = tube.nearest(hand)[np.arange(len(hand)), segment]
    parts = []
    for normal in _normals(hand - nearest, axis):
        support = np.maximum(
            np.einsum("ni,ni->n", normal, begin), np.einsum("ni,ni->n", normal, end)
        )
        used = (np.einsum("ni,ni->n", normal, hand) - support) / radius
        by_joint = np.einsum("ni,nij->nj", normal, linear) / radius[:, None]
        control = motion.basis.values[0][:, :, None] * by_joint[:, None]
        gate = np.einsum("gnj,nj->ng", motion.by_gate[:, 0], by_joint)
        zero = np.zeros(len(hand))
        parts.append(Rows(motion.basis.first, control, gate, zero, 1 - margin - used))
    return stacked(parts)


def _normals(away: FloatArray, axis: FloatArray) -> list[FloatArray]:
    """Return unit normals of supporting planes, each (N, 3): a fan about the axis, and the caps."""
    length = np.linalg.norm(away, axis=1, keepdims=True)
    helper = np.eye(3)[abs(axis).argmin(axis=1)]
    across = np.cross(axis, helper)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    outward = np.where(length > _NO_LENGTH, away / np.maximum(length, _NO_LENGTH), across)
    radial = outward - np.einsum("ni,ni->n", outward, axis)[:, None] * axis
    size = np.linalg.norm(radial, axis=1, keepdims=True)
    radial = np.where(size > 1e-6, radial / np.maximum(size, 1e-6), across)
    sideways = np.cross(axis, radial)
    fan = [np.cos(angle) * radial + np.sin(angle) * sideways for angle in _FAN]
    return [outward, *fan, axis, -axis]
