"""Study: problems, axes, designs of points."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias, overload

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import in_figures
from tubeplanner.errors import FormerName, ProblemError, shown
from tubeplanner.planning.options import PlanOptions
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.task.field_changes import factor_of
from tubeplanner.text import short_repr

# ---- Axes: fields with some values, or with any value between two.

_DIGITS = 12  # of interpolated values: 0.015, where a sum gives 0.015000000000000001


@dataclass(frozen=True)
class Levels:
    """An axis of single values.

    Attributes:
        path: Path of the field; or "problem".
        values: The values in their order.
    """

    path: str
    values: Sequence[Any]

    @property
    def ends(self) -> Sequence[Any]:
        """The values that are checked: if these can be set, all can.

        They are the first number or text, the first factor, and every list and map, as other fields
        may lead into them.
        """
        if isinstance(self.values, EvenValues):
            return self.values.interval.ends
        ends, kinds = [], set()
        for value in self.values:
            if isinstance(value, list | dict):
                ends.append(value)
            elif (is_factor := factor_of(value) is not None) not in kinds:
                kinds.add(is_factor)
                ends.append(value)
        return tuple(ends)

    def at(self, fraction: float) -> Any:
        """Return the value at a fraction of the axis, from 0 (included) to 1 (excluded)."""
        return self.values[int(fraction * len(self.values))]


@dataclass(frozen=True)
class Interval:
    """An axis of any value between two.

    Attributes:
        path: Path of the field.
        first: Value at 0.
        last: Value at 1.
        is_logarithmic: True if equal steps are equal ratios.
        is_factor: True if values scale the value of the file.
    """

    path: str
    first: float
    last: float
    is_logarithmic: bool
    is_factor: bool

    @property
    def ends(self) -> Sequence[Any]:
        """The values that are checked: if these can be set, all can."""
        return self.at(0.0), self.at(1.0)

    def at(self, fraction: float) -> Any:
        """Return the value at a fraction of the axis, from 0 to 1."""
        value: float
        if self.is_logarithmic:
            value = self.first * (self.last / self.first) ** fraction
        else:
            value = (1 - fraction) * self.first + fraction * self.last
        value = float(f"{value:.{_DIGITS}g}")
        value = int(value) if value.is_integer() else value
        return f"x{value!r}" if self.is_factor else value

    def levels(self, count: int) -> Levels:
        """Return an axis of `count` of the values, first and last included."""
        return Levels(self.path, EvenValues(self, count))


@dataclass(frozen=True)
class EvenValues(Sequence[Any]):
    """Values of an interval at equal steps, made one by one: there may be millions.

    Attributes:
        interval: The interval.
        length: Number of values, at least 2.
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
        steps = range(self.length)[index]
        if isinstance(steps, range):
            return [self[step] for step in steps]
        return self.interval.at(steps / (self.length - 1))


Axis: TypeAlias = Levels | Interval


def interval(path: str, first: Any, last: Any, *, is_logarithmic: bool) -> Interval:
    """Return the axis between two values, numbers or factors such as "x0.5".

    Raises:
        ProblemError: The values are equal, one is a factor and the other is not, or one is not
            positive where steps are ratios.
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


# ---- Points: combinations of values.

MAX_POINTS = 10_000_000


@dataclass(frozen=True)
class Latin:
    """A Latin hypercube: each axis has as many equal parts as there are points, one point in each.

    Attributes:
        count: Number of points.
        seed: Seed of the random numbers.

    Raises:
        ProblemError: On construction, for numbers out of their bounds.
    """

    count: int
    seed: int = 0

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MAX_POINTS:
            raise ProblemError(f"latin is {self.count}; it must be >= 1 and <= {MAX_POINTS}")
        if self.seed < 0:
            raise ProblemError(f"seed is {self.seed}; it must be >= 0")


@dataclass(frozen=True)
class StudyPoint:
    """One point of a study.

    Attributes:
        index: Index of the point.
        values: Its values by field path.
    """

    index: int
    values: Mapping[str, Any]


class StudyPoints:
    """The points of a study, made one by one; in a grid the last axis changes fastest."""

    def __init__(self, axes: Sequence[Axis], latin: Latin | None) -> None:
        """Make the design.

        Args:
            axes: The axes.
            latin: The Latin hypercube; None: a grid.

        Raises:
            ProblemError: A grid has an axis without a count, or too many points.
        """
        self._axes = tuple(axes)
        self._fractions: FloatArray | None = None  # along each axis, shape (points, axes)
        if latin is not None:
            from scipy.stats.qmc import LatinHypercube  # takes a second to import

            self._fractions = LatinHypercube(len(axes), rng=latin.seed).random(latin.count)
        values: list[Sequence[Any]] = []
        for axis in axes if latin is None else ():
            if isinstance(axis, Interval):
                raise ProblemError(f"{axis.path}: count is required in a grid: how many values")
            values.append(axis.values)
        self._values = tuple(values)  # along each axis of a grid
        self._count = math.prod(map(len, values)) if latin is None else latin.count
        if self._count > MAX_POINTS:
            raise ProblemError(f"the grid has {self._count} points; at most {MAX_POINTS} can be")

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> StudyPoint:
        if not 0 <= index < self._count:
            raise IndexError(f"point {index} of {self._count}")
        if self._fractions is not None:
            pairs = zip(self._axes, self._fractions[index].tolist(), strict=True)
            return StudyPoint(index, {axis.path: axis.at(fraction) for axis, fraction in pairs})
        remainder, values = index, []
        for levels in self._values[::-1]:
            remainder, k = divmod(remainder, len(levels))
            values.append(levels[k])
        paths = [axis.path for axis in self._axes]
        return StudyPoint(index, dict(zip(paths, values[::-1], strict=True)))

    def __iter__(self) -> Iterator[StudyPoint]:
        return map(self.__getitem__, range(self._count))


PROBLEM = "problem"  # path of the axis of several problems


@dataclass(frozen=True, eq=False)
class Study:
    """A study: problems, axes, a design of points, and planning options.

    Attributes:
        name: Name in figures.
        problems: Problems by their names.
        axes: The axes; the axis "problem" chooses among several problems.
        latin: The Latin hypercube; None: a grid.
        options: Planning options of every point.
        files: The files it was read from.

    Raises:
        ProblemError: On construction: there is no axis, a path leads nowhere, or to no number where
            a factor is given, or the grid is too large.
    """

    name: str
    problems: Mapping[str, ProblemSpec]
    axes: Sequence[Axis]
    latin: Latin | None = None
    options: PlanOptions = field(default_factory=PlanOptions)
    files: Sequence[Path] = ()

    __repr__ = short_repr

    posed = FormerName("spec")

    def __post_init__(self) -> None:
        if not self.axes:
            raise ProblemError("nothing is varied; give at least one field or several problems")
        if empty := [axis.path for axis in self.axes if len(axis.ends) == 0]:
            raise ProblemError(f"{empty[0]}: give at least one value")
        assert len(self.points) > 0
        # Every value can be set in every problem, beside the first of the others.
        first = {axis.path: axis.ends[0] for axis in self.axes if axis.path != PROBLEM}
        for name, problem in self.problems.items():
            for axis in self.axes:
                for value in axis.ends if axis.path in first else ():
                    try:
                        problem.changed({**first, axis.path: value})
                    except ProblemError as error:
                        where = f"{name}: " if len(self.problems) > 1 else ""
                        raise ProblemError(f"{where}{error}") from None

    @staticmethod
    def require(study: object) -> None:
        """Raise ProblemError unless the argument is a study."""
        if not isinstance(study, Study):
            raise ProblemError(f"the study is {shown(study)}; give a Study, as load_study returns")

    @cached_property
    def points(self) -> StudyPoints:
        """The points, in order."""
        return StudyPoints(self.axes, self.latin)

    def spec(self, point: StudyPoint) -> ProblemSpec:
        """Return the problem of a point.

        Raises:
            ProblemError: Its values cannot be set together.
        """
        changes = dict(point.values)
        name = changes.pop(PROBLEM, next(iter(self.problems)))
        return self.problems[name].changed(changes)
