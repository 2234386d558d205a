"""Limits on efforts and accelerations along a trajectory's path, one side each, at any speed.

Run along its path at the speed p, 1 being the trajectory's own, and with the rate p' of that speed,
a trajectory q(t) has the velocities q' p and the accelerations q'' p^2 + q' p'. Efforts then are
gravity and Coulomb friction, which stay, viscous friction with p, inertia with p^2 and with p'.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.verification.path_steps import PathSteps

_WAYS = (1.0, -1.0)


@dataclass(frozen=True, eq=False)
class LimitSides:
    """R sides of limits at N places: a limit holds while what is used of it is at most 1.

    That is static + linear p + square p^2 + change p'.

    Attributes:
        condition: What each is called in the certificate, R names.
        joint: Whose it is, shape (R,).
        static: Shape (N, R).
        linear: Shape (N, R).
        square: Shape (N, R).
        change: Shape (N, R) [s].
    """

    condition: tuple[str, ...]
    joint: IntArray
    static: FloatArray
    linear: FloatArray
    square: FloatArray
    change: FloatArray

    @classmethod
    def joined(cls, parts: Sequence["LimitSides"]) -> "LimitSides":
        """Return the sides of all parts, at the same places."""
        names = ("static", "linear", "square", "change")
        return cls(
            sum((part.condition for part in parts), ()),
            np.concatenate([part.joint for part in parts]),
            *(np.concatenate([getattr(part, name) for part in parts], axis=1) for name in names),
        )


def effort_sides(robot: RobotModel, steps: PathSteps) -> LimitSides:
    """Return the limits on efforts and the torque-speed lines at the ends of S steps: N = 2 S.

    Friction is the worst that its uncertainty lets it be.

    Args:
        robot: The arm.
        steps: Of a trajectory in its joint order.
    """
    motors, limits = robot.motors, robot.limits
    q, v, a = (steps.at_ends(order) for order in range(3))
    gravity, viscous = robot.gravity_effort(q), motors.viscous_friction * v
    coulomb = motors.coulomb_effort(np.tile(steps.direction, (2, 1)))
    inertia = robot.inverse_dynamics(q, v, a) - gravity - viscous
    change = robot.inverse_dynamics(q, np.zeros_like(v), v) - gravity
    parts = []
    for way in _WAYS:
        static = way * (gravity + coulomb) + motors.friction_uncertainty * abs(coulomb)
        linear = way * viscous + motors.friction_uncertainty * abs(viscous)
        used = (static, linear, way * inertia, way * change)
        parts.append(_shares("effort", np.isfinite(limits.effort), used, _allowed(robot, q, way)))
        stall = np.broadcast_to(motors.saturation_effort, q.shape)
        with np.errstate(invalid="ignore"):
            slowed = linear + way * v * motors.saturation_effort / motors.no_load_velocity
        parts.append(_shares("motor_curve", motors.has_curve, (static, slowed, *used[2:]), stall))
    return LimitSides.joined(parts)


def acceleration_sides(robot: RobotModel, steps: PathSteps) -> LimitSides:
    """Return the limits on accelerations, as `effort_sides`."""
    limit = robot.limits.acceleration
    v, a = steps.at_ends(1), steps.at_ends(2)
    none, allowed = np.zeros_like(v), np.broadcast_to(limit, v.shape)
    return LimitSides.joined(
        [
            _shares("acceleration", np.isfinite(limit), (none, none, way * a, way * v), allowed)
            for way in _WAYS
        ]
    )


def _allowed(robot: RobotModel, q: FloatArray, way: float) -> FloatArray:
    """Return the most effort along (1) or against (-1) the joints at positions (N, n): (N, n)."""
    allowed = np.tile(robot.limits.effort, (len(q), 1))
    for limit in robot.limits.effort_ranges:
        allowed[:, limit.joint] = limit.allowed(q[:, limit.joint], way)
    return allowed


def _shares(
    condition: str, limited: BoolArray, used: tuple[FloatArray, ...], allowed: FloatArray
) -> LimitSides:
    """Return sides of those joints that are limited, of n, as shares of what is allowed."""
    joint = np.flatnonzero(limited)
    shares = (part[:, joint] / allowed[:, joint] for part in used)
    return LimitSides((condition,) * len(joint), joint, *shares)
