"""The limits of Franka's arms as their control has them: those of the presets, and a few more."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.problem.presets import read_preset
from tubeplanner.robot.limit_overrides import LimitOverrides

_JOINTS = tuple(f"joint {k + 1}" for k in range(7))
# The control's position limits where the preset leaves them to the URDF [rad]; and the acceleration
# and jerk of Cartesian commands [m/s^2, m/s^3]. From "Limits for Panda" of Franka's documentation
# and, of the FR3, `kMaxTranslationalAcceleration` and `kMaxTranslationalJerk` of libfranka.
_POSITION = {
    "fer": (
        (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
        (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    )
}
_TOOL = {"fer": (13.0, 6500.0), "fr3": (9.0, 4500.0)}
FRANKA_ARMS = {"fer": "Franka Emika Robot (Panda)", "fr3": "Franka Research 3"}
_LAWS, _LAW_KEYS = "velocity_by_position", ("deceleration", "offset", "lower", "upper")


@dataclass(frozen=True, eq=False)
class FrankaLimits:
    """Limits of an arm of seven joints, in chain order.

    Attributes:
        name: Of the arm.
        position: Lower and upper, shape (2, 7) [rad].
        velocity: Shape (7,) [rad/s].
        acceleration: Shape (7,) [rad/s^2].
        jerk: Shape (7,) [rad/s^3].
        effort: Shape (7,) [N m].
        effort_rate: Shape (7,) [N m/s].
        tool_rates: Translation of Cartesian commands: velocity, acceleration and jerk
            [m/s, m/s^2, m/s^3].
        velocity_laws: How velocity falls with position: deceleration [rad/s^2], offset [rad/s],
            lower and upper [rad], shape (4, 7); None: it does not.
    """

    name: str
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    effort: FloatArray
    effort_rate: FloatArray
    tool_rates: tuple[float, float, float]
    velocity_laws: FloatArray | None = None

    def velocity_bounds(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the least and the largest velocity at positions, each (N, 7) [rad/s].

        Args:
            q: Positions, shape (N, 7) [rad].
        """
        most = np.broadcast_to(self.velocity, q.shape)
        if self.velocity_laws is None:
            return -most, most
        deceleration, offset, lower, upper = self.velocity_laws
        slowest, fastest = (
            np.clip(np.sqrt(2 * deceleration * np.maximum(room, 0.0)) - offset, 0.0, most)
            for room in (q - lower, upper - q)
        )
        return -slowest, fastest


def franka_limits(name: str) -> FrankaLimits:
    """Return the limits of an arm.

    Args:
        name: Of its preset: one of `FRANKA_ARMS`.
    """
    limits = read_preset(name).limits
    position = _POSITION.get(name)
    return FrankaLimits(
        name=FRANKA_ARMS[name],
        position=read_only(_rows(limits, "position").T if position is None else position),
        velocity=_rows(limits, "velocity"),
        acceleration=_rows(limits, "acceleration"),
        jerk=_rows(limits, "jerk"),
        effort=_rows(limits, "effort"),
        effort_rate=_rows(limits, "effort_rate"),
        tool_rates=(np.inf if limits.tool_speed is None else limits.tool_speed, *_TOOL[name]),
        velocity_laws=_velocity_laws(limits),
    )


def _velocity_laws(limits: LimitOverrides) -> FloatArray | None:
    given = limits.by_name(_LAWS, _JOINTS, _LAWS) if limits.velocity_by_position else {}
    laws = [[given[joint][key] for joint in _JOINTS] for key in _LAW_KEYS] if given else None
    return None if laws is None else read_only(laws)


def _rows(limits: LimitOverrides, quantity: str) -> FloatArray:
    """Return what a preset gives, one row per joint."""
    given = limits.by_name(quantity, _JOINTS, quantity)
    return read_only([given[joint] for joint in _JOINTS])
