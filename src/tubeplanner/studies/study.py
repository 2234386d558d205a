"""Study: problems, axes, designs of points."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias, overload

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import in_figures
from tubeplanner.errors import ProblemError, shown
from tubeplanner.planning.options import PlanOptions
from tubeplanner.studies.problem_spec import PosedProblem
from tubeplanner.task.field_changes import factor_of
from tubeplanner.text import short_repr

# ---- What a study varies: a field that takes some values, or any value between two.

_DIGITS = 12  # of values between two others: 0.015, where adding up gives 0.015000000000000001


@dataclass(frozen=True)
class Levels:
    """Values that are given one by one.

    Attributes:
        path: Of the field; or "problem".
        values: In their order.
    """

    path: str
    values: Sequence[Any]

    @property
    def ends(self) -> Sequence[Any]:
        """The values that show whether all can be set.

        The first number or text, the first factor, and every list and map, as other fields may lead
        into them.
        """
        if isinstance(self.values, EvenValues):
            return self.values.interval.ends
        return tuple(_of_each_kind(self.values))

    def at(self, share: float) -> Any:
        """Return the value at a share of the way, from 0 (included) to 1 (excluded)."""
        return self.values[int(share * len(self.values))]


@dataclass(frozen=True)
class Interval:
    """Any value between two.

    Attributes:
        path: Of the field.
        first: At 0.
        last: At 1.
        is_logarithmic: Whether equal steps are equal ratios.
        is_factor: Whether values scale what the file gives.
    """

    path: str
    first: float
    last: float
    is_logarithmic: bool
    is_factor: bool

    @property
    def ends(self) -> Sequence[Any]:
        """The values that show whether all can be set."""
        return self.at(0.0), self.at(1.0)

    def at(self, share: float) -> Any:
        """Return the value at a share of the way, from 0 to 1."""
        value: float
        if self.is_logarithmic:
            value = self.first * (self.last / self.first) ** share
        else:
            value = (1 - share) * self.first + share * self.last
        value = float(f"{value:.{_DIGITS}g}")
        value = int(value) if value.is_integer() else value
        return f"x{value!r}" if self.is_factor else value

    def levels(self, count: int) -> Levels:
        """Return so many of the values, first and last included."""
        return Levels(self.path, EvenValues(self, count))


@dataclass(frozen=True)
class EvenValues(Sequence[Any]):
    """Values between two others, made one by one: there may be millions.

    Attributes:
        interval: Between which.
        length: How many, at least 2.
    """

    interval: Interval
    length: int

    def __len__(self) -> int:
        return self.length

    @overload
    def __getitem__(self, index: int) -> Any: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Any]: ...
    def __getitem__(self, index: int | slice) -> Any:
        places = range(self.length)[index]
        if isinstance(places, range):
            return [self[place] for place in places]
        return self.interval.at(places / (self.length - 1))


Axis: TypeAlias = Levels | Interval


def interval(path: str, first: Any, last: Any, *, is_logarithmic: bool) -> Interval:
    """Return the values between two, numbers or factors such as "x0.5".

    Raises:
        ProblemError: They are the same, one is a factor and the other none, or one is not positive
            where steps are ratios.
    """
    factors = [factor_of(end) for end in (first, last)]
    is_factor = None not in factors
    if not is_factor and factors != [None, None]:
        raise ProblemError(
            f"from is {shown(first)} and to is {shown(last)}; give two numbers or two factors"
        )
    begin, end = map(float, factors if is_factor else (first, last))
    if begin == end:
        raise ProblemError(f"from and to are both {in_figures(first)}; give a list of one value")
    if is_logarithmic and min(begin, end) <= 0:
        raise ProblemError(
            f"from is {in_figures(first)} and to is {in_figures(last)}; with spacing log both "
            "must be > 0"
        )
    return Interval(path, begin, end, is_logarithmic, is_factor)


def _of_each_kind(values: Iterable[Any]) -> Iterable[Any]:
    """Yield the first value without parts, the first factor, and all others."""
    seen = set()
    for value in values:
        if not isinstance(value, list | dict):
            is_factor = factor_of(value) is not None
            if is_factor in seen:
                continue
            seen.add(is_factor)
        yield value


# ---- The points of a study: which values go together.

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


# ---- A study: problems, the fields in which they vary, and how every point is planned.

PROBLEM = "problem"  # what the axis of several problems is called


@dataclass(frozen=True, eq=False)
class Study:
    """Many plans that belong together.

    Attributes:
        name: What figures call it.
        problems: By their names.
        axes: What is varied; the axis "problem" chooses among several problems.
        latin: Which points; None: all of the grid.
        options: How every point is planned.
        files: It was read from.

    Raises:
        ProblemError: On construction: nothing is varied, a path leads nowhere, or to no number
            where a factor is given, or the grid is too large.
    """

    name: str
    problems: Mapping[str, PosedProblem]
    axes: Sequence[Axis]
    latin: Latin | None = None
    options: PlanOptions = field(default_factory=PlanOptions)
    files: Sequence[Path] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not self.axes:
            raise ProblemError("nothing is varied; give at least one field or several problems")
        if empty := [axis.path for axis in self.axes if len(axis.ends) == 0]:
            raise ProblemError(f"{empty[0]}: give at least one value")
        assert len(self.points) > 0
        self._require_paths()

    @staticmethod
    def require(study: object) -> None:
        """Raise ProblemError unless something is a study."""
        if not isinstance(study, Study):
            raise ProblemError(f"the study is {shown(study)}; give a Study, as load_study returns")

    @cached_property
    def points(self) -> StudyPoints:
        """What is planned, in order."""
        return StudyPoints(self.axes, self.latin)

    def posed(self, point: StudyPoint) -> PosedProblem:
        """Return the problem of a point.

        Raises:
            ProblemError: Its values cannot be set together.
        """
        changes = dict(point.values)
        name = changes.pop(PROBLEM, next(iter(self.problems)))
        return self.problems[name].changed(changes)

    def _require_paths(self) -> None:
        """Raise unless every value can be set in every problem, beside the first of the others."""
        first = {axis.path: axis.ends[0] for axis in self.axes if axis.path != PROBLEM}
        for name, problem in self.problems.items():
            for axis in self.axes:
                for value in axis.ends if axis.path in first else ():
                    try:
                        problem.changed({**first, axis.path: value})
                    except ProblemError as error:
                        where = f"{name}: " if len(self.problems) > 1 else ""
                        raise ProblemError(f"{where}{error}") from None
