"""Limits on the speed of points of the arm."""

from dataclasses import dataclass

from tubeplanner.errors import RobotError, shown
from tubeplanner.options import are_numbers, in_figures, is_number

_SLOWEST, _FASTEST = 1e-6, 1e9  # [m/s]


@dataclass(frozen=True)
class PointSpeed:
    """A limit on the speed of a point that moves with a link.

    Attributes:
        link: Any link of the URDF.
        position: The point in the link's frame [m].
        speed: The most, in any direction, in the base frame [m/s].

    Raises:
        RobotError: The position is none, or the speed is not from 1e-6 to 1e9 m/s.
    """

    link: str
    position: tuple[float, float, float]
    speed: float

    def __post_init__(self) -> None:
        where = f"robot.limits.point_speed of link {shown(self.link)}"
        position = self.position
        if not are_numbers(position, 3):
            raise RobotError(f"{where}: position is {shown(position)}; give [x, y, z] in m")
        if not is_number(self.speed) or not _SLOWEST <= self.speed <= _FASTEST:
            raise RobotError(
                f"{where}: speed is {in_figures(self.speed)}; give a number from {_SLOWEST:g} to "
                f"{_FASTEST:g} m/s"
            )
        object.__setattr__(self, "position", tuple(float(value) for value in position))
