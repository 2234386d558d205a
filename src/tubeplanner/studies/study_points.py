"""The points of a study: which values go together."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.studies.axes import Axis, Interval

MOST_POINTS = 10_000_000


@dataclass(frozen=True)
class Latin:
    """A Latin hypercube: of as many equal parts of each axis as there are points, one in each.

    Attributes:
        count: How many points.
        seed: Of the random numbers.
    """

    count: int
    seed: int = 0

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MOST_POINTS:
            raise ProblemError(f"latin is {self.count}; it must be >= 1 and <= {MOST_POINTS}")
        if self.seed < 0:
            raise ProblemError(f"seed is {self.seed}; it must be >= 0")


@dataclass(frozen=True)
class StudyPoint:
    """One point of a study.

    Attributes:
        index: Which one, from 0.
        values: By field path.
    """

    index: int
    values: Mapping[str, Any]


class StudyPoints:
    """All points, made one by one: of a grid, the last axis changes fastest."""

    def __init__(self, axes: Sequence[Axis], latin: Latin | None) -> None:
        """Choose the points.

        Args:
            axes: What is varied.
            latin: The design; None: a grid.

        Raises:
            ProblemError: A grid has an axis without a count, or too many points.
        """
        self._axes = tuple(axes)
        self._shares = None if latin is None else _latin_shares(latin, len(axes))
        self._levels = () if latin else tuple(_of_grid(axis) for axis in axes)
        self._count = math.prod(map(len, self._levels)) if latin is None else latin.count
        if self._count > MOST_POINTS:
            raise ProblemError(f"the grid has {self._count} points; at most {MOST_POINTS} can be")

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> StudyPoint:
        if not 0 <= index < self._count:
            raise IndexError(f"point {index} of {self._count}")
        return StudyPoint(index, dict(self._values(index)))

    def __iter__(self) -> Iterator[StudyPoint]:
        return map(self.__getitem__, range(self._count))

    def _values(self, index: int) -> list[tuple[str, Any]]:
        paths = [axis.path for axis in self._axes]
        if self._shares is not None:
            each = zip(self._axes, self._shares[index].tolist(), strict=True)
            return [(axis.path, axis.at(share)) for axis, share in each]
        values = []
        for levels in self._levels[::-1]:
            index, place = divmod(index, len(levels))
            values.append(levels[place])
        return list(zip(paths, values[::-1], strict=True))


def _of_grid(axis: Axis) -> Sequence[Any]:
    if isinstance(axis, Interval):
        raise ProblemError(f"{axis.path}: count is required in a grid: how many values")
    return axis.values


def _latin_shares(latin: Latin, dimensions: int) -> FloatArray:
    """Return shares of the way along each axis, shape (points, axes)."""
    from scipy.stats.qmc import LatinHypercube  # takes a second to import

    shares: FloatArray = LatinHypercube(dimensions, rng=latin.seed).random(latin.count)
    return shares
