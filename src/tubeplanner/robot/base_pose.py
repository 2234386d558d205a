"""Where a robot stands in its cell."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tubeplanner.arrays import FloatArray, read_only
from tubeplanner.errors import RobotError, shown
from tubeplanner.options import are_numbers
from tubeplanner.orientation import matrix_of_quaternion, matrix_of_rpy

_FARTHEST = 1e4  # [m], as of obstacles
_SHORTEST, _LONGEST = 1e-9, 1e9  # of a quaternion that has a direction


@dataclass(frozen=True)
class BasePose:
    """The pose of a robot's root link in its cell; at most one of rpy, quaternion.

    Attributes:
        position: Of its origin [m].
        rpy: Roll, pitch, yaw about fixed x, y, z, as in URDF [rad]; None: not turned.
        quaternion: x, y, z, w of any length, instead of `rpy`.
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] | None = None
    quaternion: tuple[float, float, float, float] | None = None

    def __post_init__(self) -> None:
        is_point = are_numbers(self.position, 3)
        if not is_point or not (np.abs(self.position) <= _FARTHEST).all():
            raise RobotError(
                f"robot.base: position {shown(self.position)} must be three finite numbers within "
                f"{_FARTHEST:g} m"
            )
        if self.rpy is not None and self.quaternion is not None:
            raise RobotError("robot.base takes rpy or quaternion, not both; remove one of them")
        if self.rpy is not None and not are_numbers(self.rpy, 3):
            raise RobotError(f"robot.base: rpy {shown(self.rpy)} must be three finite angles [rad]")
        if self.quaternion is not None and not _has_direction(self.quaternion):
            raise RobotError(
                f"robot.base: quaternion {shown(self.quaternion)} has no direction; give x, y, z, w"
            )

    @cached_property
    def placement(self) -> FloatArray:
        """The pose as a homogeneous transform, shape (4, 4)."""
        placement = np.eye(4)
        placement[:3, 3] = self.position
        if self.rpy is not None:
            placement[:3, :3] = matrix_of_rpy(*self.rpy)
        if self.quaternion is not None:
            placement[:3, :3] = matrix_of_quaternion(np.array(self.quaternion, dtype=float))
        return read_only(placement)


def _has_direction(quaternion: tuple[float, ...]) -> bool:
    length = float(np.linalg.norm(quaternion)) if are_numbers(quaternion, 4) else 0.0
    return _SHORTEST < length < _LONGEST
