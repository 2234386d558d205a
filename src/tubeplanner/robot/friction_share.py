"""What friction takes of the effort limits: at full speed, where it is most."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.robot.robot_model import RobotModel

_IMPLAUSIBLE = 1 / 3  # geared arms lose up to 27 % (UR10, identified)
_SAME = 1e-3  # relative


@dataclass(frozen=True)
class FrictionShare:
    """The most that friction takes of an effort limit.

    Attributes:
        share: Of the effort limit, at the velocity limit.
        joints: Names of the joints of which it takes so much; empty: of every joint.
    """

    share: float
    joints: tuple[str, ...]

    @property
    def is_implausible(self) -> bool:
        """Whether no gear loses as much."""
        return self.share > _IMPLAUSIBLE

    def __str__(self) -> str:
        whose = ", ".join(self.joints) or "every joint"
        percent = 100 * self.share
        figures = f"{percent:.0f}" if percent >= 10 else f"{percent:.2g}"
        return f"{figures} % of the effort limit ({whose})"


def friction_share(
    robot: RobotModel, viscous: FloatArray, coulomb: FloatArray
) -> FrictionShare | None:
    """Return the most that friction takes; None if there is none, or nothing that it could take.

    Args:
        robot: The arm, whose limits count.
        viscous: Viscous friction of its joints, shape (n,) [N m s/rad or N s/m].
        coulomb: Coulomb friction, likewise [N m or N].
    """
    limits = robot.limits
    is_bounded = np.isfinite(limits.velocity) & np.isfinite(limits.effort)
    velocity = np.where(is_bounded, limits.velocity, 0.0)
    shares = np.where(is_bounded, (viscous * velocity + coulomb) / limits.effort, 0.0)
    if not shares.any():
        return None
    is_worst = shares >= (1 - _SAME) * shares.max()
    worst = () if is_worst.all() else np.flatnonzero(is_worst)
    return FrictionShare(float(shares.max()), tuple(robot.joint_names[joint] for joint in worst))
