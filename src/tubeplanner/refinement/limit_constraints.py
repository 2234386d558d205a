"""Limits of effort, velocity, acceleration and jerk at samples of a spline.

Products with y = T^2 keep the constraints exact in y: efforts scale as tau = h / y + g (Hollerbach,
"Dynamic scaling of manipulator trajectories", 1984; Suh & Bishop 1988, property 2).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.constraints.time_scaling import effort_factor_of
from tubeplanner.refinement.linear_rows import (
    Rows,
    StepSize,
    stacked,
    two_sided_rows,
    two_sided_slack,
)
from tubeplanner.refinement.phased_spline import EvaluationPoints, PhasedSpline
from tubeplanner.refinement.sampled_spline import SampledSpline, sampled
from tubeplanner.robot.robot_model import RobotModel

_ORDERS = {"velocity": 1, "acceleration": 2, "jerk": 3}
EFFORT, VELOCITY, ACCELERATION, JERK = "effort", *_ORDERS


class LimitConstraints:
    """The limits of an arm's joints.

    Attributes:
        names: Kind and joint of every limit, in the order of their numbers.
    """

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot
        self._bounded = {
            kind: np.flatnonzero(np.isfinite(getattr(robot.limits, kind)))
            for kind in (EFFORT, *_ORDERS)
        }
        self.names = [(kind, int(j)) for kind, joints in self._bounded.items() for j in joints]

    def limited(self, kinds: tuple[str, ...]) -> bool:
        """Return whether any joint has a limit of one of some kinds."""
        return any(len(self._bounded[kind]) for kind in kinds)

    def at(
        self, spline: PhasedSpline, evaluation_points: EvaluationPoints, kinds: tuple[str, ...]
    ) -> "EvaluatedLimits":
        """Return the limits of some kinds at points of a spline; one kind must limit a joint."""
        at = sampled(spline, evaluation_points)
        asked = {kind: self._numbers[kind] for kind in kinds if len(self._bounded[kind])}
        gravity = effort = np.zeros_like(at.position)
        if EFFORT in asked:
            gravity = self._robot.gravity_effort(at.position)
            effort = self._robot.inverse_dynamics(*at.by_x[:3])
        return EvaluatedLimits(self._robot, at, gravity, effort, asked)

    @cached_property
    def _numbers(self) -> dict[str, tuple[IntArray, IntArray]]:
        """The bounded joints of every kind of limit, and the limits' numbers."""
        found, count = {}, 0
        for kind, joints in self._bounded.items():
            found[kind] = (joints, count + np.arange(len(joints)))
            count += len(joints)
        return found


@dataclass(frozen=True, eq=False)
class EvaluatedLimits:
    """The limits at N samples of a spline.

    Attributes:
        robot: The arm.
        at: The spline at the samples.
        gravity: Efforts against gravity, shape (N, n).
        effort: Efforts of the spline run in one second, shape (N, n).
        asked: For every requested kind, the bounded joints and their limits' numbers.
    """

    robot: RobotModel
    at: SampledSpline
    gravity: FloatArray
    effort: FloatArray
    asked: dict[str, tuple[IntArray, IntArray]]

    @cached_property
    def squared_durations(self) -> FloatArray:
        """The smallest y = T^2 that the limits allow at each sample, shape (N,) [s^2].

        inf where gravity alone needs a motor's whole effort.
        """
        found = np.zeros(len(self.at.position))
        for kind, (joints, _) in self.asked.items():
            limit = getattr(self.robot.limits, kind)[joints]
            if kind == EFFORT:
                tau, gravity = self.effort[:, joints], self.gravity[:, joints]
                with np.errstate(divide="ignore"):
                    least = effort_factor_of(limit, tau, gravity).min(axis=1) ** -2
            else:
                order = _ORDERS[kind]
                used = abs(self.at.by_x[order][:, joints]) / limit
                least = used.max(axis=1) ** (2 / order)
            found = np.maximum(found, least)
        return found

    @property
    def row_count(self) -> int:
        """How many rows there are."""
        return 2 * len(self.at.position) * sum(len(joints) for joints, _ in self.asked.values())

    def rows(self, duration: float, size: StepSize | None) -> Rows:
        """Return the rows of all limits, for both directions, of the spline run in T seconds.

        Args:
            duration: T [s].
            size: Of the step; rows that it cannot break are left out. None: all rows.
        """
        parts, count = [], 0
        for kind, (joints, numbers) in self.asked.items():
            used, by_duration = self._used(kind, joints, duration)
            change = self._change(kind, joints, duration)
            rows = two_sided_rows(self.at.first, change, used, by_duration, numbers, size)
            parts.append(rows.numbered_from(count))
            count += 2 * used.size
        return stacked(parts)

    def slack(self, duration: float, squared_duration: float) -> FloatArray:
        """Return the slack of all rows that `rows` numbers, here, for rows made elsewhere.

        Args:
            duration: The duration that those were made for [s].
            squared_duration: The new squared duration, as a multiple of the old one.
        """
        return np.concatenate(
            [
                two_sided_slack(*self._used(kind, joints, duration), squared_duration)
                for kind, (joints, _) in self.asked.items()
            ]
        )

    def _used(
        self, kind: str, joints: IntArray, duration: float
    ) -> tuple[FloatArray, tuple[FloatArray, float]]:
        """Return the used shares of limits, (N, I), and how they change with y."""
        limit = getattr(self.robot.limits, kind)[joints]
        if kind == EFFORT:
            gravity = self.gravity[:, joints]
            effort = gravity + (self.effort[:, joints] - gravity) / duration**2
            return effort / limit, (gravity / limit, 1.0)
        order = _ORDERS[kind]
        used = self.at.rate(order, duration)[:, joints] / limit
        return used, (np.zeros_like(used), order / 2)

    def _change(
        self, kind: str, joints: IntArray, duration: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return how the used shares change with control points and switching times."""
        limit = getattr(self.robot.limits, kind)[joints]
        if kind == EFFORT:
            q, v, a = self.at.position, self.at.rate(1, duration), self.at.rate(2, duration)
            blocks = self.robot.inverse_dynamics_derivatives(q, v, a)
            by_state = [
                block[:, joints] / limit[:, None] / duration**k for k, block in enumerate(blocks)
            ]
            return self.at.chained(np.stack(by_state))
        order = _ORDERS[kind]
        scale = 1 / (limit * duration**order)
        count, n = self.at.position.shape
        control = np.zeros((count, len(joints), self.at.basis.shape[2], n))
        by_point = scale[:, None, None] * self.at.basis[order]
        control[:, np.arange(len(joints)), :, joints] = by_point
        switching = scale[:, None] * self.at.by_switching[:, order][:, :, joints].transpose(1, 2, 0)
        return control, switching
