"""What a study varies: a field that takes some values, or any value between two."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, overload

from tubeplanner.errors import ProblemError, shown
from tubeplanner.options import in_figures
from tubeplanner.problem.field_paths import factor_of

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
