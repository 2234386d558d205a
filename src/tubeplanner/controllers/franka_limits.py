"""The limits that libfranka's documentation and its `rate_limiting.h` give for two arms."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray


@dataclass(frozen=True)
class FrankaLimits:
    """Limits of an arm of seven joints, in chain order.

    Attributes:
        name: Of the arm.
        lower_position: [rad].
        upper_position: [rad].
        velocity: [rad/s].
        acceleration: [rad/s^2].
        jerk: [rad/s^3].
        effort: [N m].
        effort_rate: [N m/s].
        tool_rates: Translation of Cartesian commands: velocity, acceleration and jerk
            [m/s, m/s^2, m/s^3].
        deceleration: [rad/s^2]; None: the velocity limit does not depend on the position.
        velocity_offset: [rad/s]; likewise.
    """

    name: str
    lower_position: Sequence[float]
    upper_position: Sequence[float]
    velocity: Sequence[float]
    acceleration: Sequence[float]
    jerk: Sequence[float]
    effort: Sequence[float]
    effort_rate: Sequence[float]
    tool_rates: tuple[float, float, float]
    deceleration: Sequence[float] | None = None
    velocity_offset: Sequence[float] | None = None

    def velocity_bounds(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the least and the largest velocity at positions, each (N, 7) [rad/s].

        Args:
            q: Positions, shape (N, 7) [rad].
        """
        most = np.broadcast_to(np.array(self.velocity), q.shape)
        if self.deceleration is None or self.velocity_offset is None:
            return -most, most
        offset, twice = np.array(self.velocity_offset), 2 * np.array(self.deceleration)
        room = (q - np.array(self.lower_position), np.array(self.upper_position) - q)
        lower, upper = (
            np.clip(np.sqrt(twice * np.maximum(side, 0.0)) - offset, 0.0, most) for side in room
        )
        return -lower, upper


FER = FrankaLimits(
    name="Franka Emika Robot (Panda)",
    lower_position=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    upper_position=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    velocity=(2.175,) * 4 + (2.61,) * 3,
    acceleration=(15, 7.5, 10, 12.5, 15, 20, 20),
    jerk=(7500, 3750, 5000, 6250, 7500, 10000, 10000),
    effort=(87,) * 4 + (12,) * 3,
    effort_rate=(1000,) * 7,
    tool_rates=(1.7, 13, 6500),
)
FR3 = FrankaLimits(
    name="Franka Research 3",
    lower_position=(-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196),
    upper_position=(2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196),
    velocity=(2.62,) * 4 + (5.26, 4.18, 5.26),
    acceleration=(10,) * 7,
    jerk=(5000,) * 7,
    effort=(87,) * 4 + (12,) * 3,
    effort_rate=(1000,) * 7,
    tool_rates=(3.0, 9, 4500),
    deceleration=(6, 2.585, 3.5, 4, 17, 5.5, 17),
    velocity_offset=(0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35),
)
