"""Where the base of a robot may stand: a region of its cell, turned about the vertical at will."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import isfinite, pi, remainder, sqrt
from typing import NamedTuple

from tubeplanner.arguments import given_row
from tubeplanner.errors import OptionError, shown
from tubeplanner.options import is_number

_YAWS, _HEIGHTS = 8, 3  # of the grid, at most
_DIGITS = 6  # of a stand: a micrometre, and what that is at a metre's distance


class Stand(NamedTuple):
    """Where a root link stands.

    Attributes:
        x: Of its origin, in the cell [m].
        y: Likewise.
        z: Likewise, upwards.
        yaw: The last of its roll, pitch and yaw: how it is turned about the vertical [rad].
    """

    x: float
    y: float
    z: float
    yaw: float


@dataclass(frozen=True)
class StandGrid:
    """Stands in the middles of equal cells of a region.

    Attributes:
        stands: All of them.
        spacing: Sides of a cell: x, y, z [m] and yaw [rad]; 0 where there is nothing to vary.
    """

    stands: tuple[Stand, ...]
    spacing: tuple[float, float, float, float]


@dataclass(frozen=True)
class Region:
    """A box in the cell, its sides along the axes, that a root link's origin must not leave.

    Attributes:
        low: Least x, y, z [m].
        high: Largest x, y, z [m].
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    @classmethod
    def of(cls, bounds: Sequence[float], height: float) -> "Region":
        """Return the region X0, X1, Y0, Y1 and perhaps Z0, Z1 [m], else at one height [m].

        Raises:
            OptionError: It is none.
        """
        given = given_row("region", bounds, "four or six numbers")
        if len(given) not in (4, 6) or not all(is_number(v) and isfinite(v) for v in given):
            raise OptionError(
                f"region is {shown(given)}; give X0, X1, Y0, Y1 and, if the height may vary, Z0, "
                "Z1, in metres in the cell"
            )
        given = [float(value) for value in given] + [height, height][: 6 - len(given)]
        low, high = given[::2], given[1::2]
        for axis, least, most in zip("xyz", low, high, strict=True):
            if least > most:
                raise OptionError(
                    f"region: {axis} goes from {least:g} to {most:g} m; give the smaller first"
                )
        return cls((low[0], low[1], low[2]), (high[0], high[1], high[2]))

    @property
    def bounds(self) -> list[float]:
        """X0, X1, Y0, Y1, Z0, Z1 [m]."""
        return [value for pair in zip(self.low, self.high, strict=True) for value in pair]

    def holds(self, stand: Stand) -> bool:
        """Return whether a stand is in it."""
        sides = zip(self.low, stand[:3], self.high, strict=True)
        return all(low <= value <= high for low, value, high in sides)

    def nearest(self, stand: Stand) -> Stand:
        """Return the stand in it that is nearest to another one, its yaw within half a turn."""
        sides = zip(self.low, stand[:3], self.high, strict=True)
        x, y, z = (min(max(round(value, _DIGITS), low), high) for low, value, high in sides)
        return Stand(x, y, z, round(remainder(stand.yaw, 2 * pi), _DIGITS))

    def grid(self, count: int, yaw: float) -> StandGrid:
        """Return about so many stands spread over it.

        Args:
            count: Of them.
            yaw: One of the angles about the vertical; the others share the turn evenly [rad].
        """
        counts = self._counts(count)
        axes = [
            [low + (k + 0.5) * (high - low) / n for k in range(n)]
            for low, high, n in zip(self.low, self.high, counts, strict=False)
        ]
        turn = 2 * pi / counts[3]
        yaws = [yaw + k * turn for k in range(counts[3])]
        stands = tuple(self.nearest(Stand(*each)) for each in product(*axes, yaws))
        x, y, z = (
            (high - low) / n for low, high, n in zip(self.low, self.high, counts, strict=False)
        )
        return StandGrid(stands, (x, y, z, turn))

    def _counts(self, count: int) -> tuple[int, int, int, int]:
        """Return how many of so many stands share x, y, z and yaw; cells are nearly square."""
        width, depth, height = (h - low for low, h in zip(self.low, self.high, strict=True))
        yaws = min(_YAWS, count)
        heights = min(_HEIGHTS, count // yaws) if height > 0 else 1
        columns = count // (yaws * heights)
        if width == 0 or depth == 0:
            return (columns if width else 1), (columns if depth else 1), heights, yaws
        along = min(max(1, round(sqrt(columns * width / depth))), columns)
        return along, max(1, round(columns / along)), heights, yaws
