"""Study: problems, axes, designs of points; every point planned once; rows and table."""

import hashlib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from pathlib import Path
from typing import Any, TypeAlias, overload

from tubeplanner.arrays import FloatArray
from tubeplanner.checks import in_figures
from tubeplanner.errors import FormerName, OptionError, ProblemError, shown
from tubeplanner.outcome import Location, PlanStatus, StoppedBy
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.studies.journal import require_fields
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.rows import PlannedRow, RowRun, RowTable, Variant, columns
from tubeplanner.task.field_changes import factor_of
from tubeplanner.text import csv_text, short_repr, value_text

# ---- Axes: fields with some values, or with any value between two.

_DIGITS = 12  # of interpolated values: 0.015, where a sum gives 0.015000000000000001


@dataclass(frozen=True)
class Levels:
    """An axis of single values."""

    path: str  # path of the field; or "problem"
    values: Sequence[Any]  # the values in their order

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
    """An axis of any value between two."""

    path: str  # path of the field
    first: float  # value at 0
    last: float  # value at 1
    is_logarithmic: bool  # True if equal steps are equal ratios
    is_factor: bool  # True if values scale the value of the file

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
    """Values of an interval at equal steps, made one by one: there may be millions."""

    interval: Interval  # the interval
    length: int  # number of values, at least 2

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

    Raises:
        ProblemError: On construction, for numbers out of their bounds.
    """

    count: int  # number of points
    seed: int = 0  # seed of the random numbers

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MAX_POINTS:
            raise ProblemError(f"latin is {self.count}; it must be >= 1 and <= {MAX_POINTS}")
        if self.seed < 0:
            raise ProblemError(f"seed is {self.seed}; it must be >= 0")


@dataclass(frozen=True)
class StudyPoint:
    """One point of a study."""

    index: int  # index of the point
    values: Mapping[str, Any]  # its values by field path


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


# ---- Rows, made where points are planned, so that little travels.

_HASH_DIGITS = 16


@dataclass(frozen=True, eq=False)
class StudyRow:
    """One point of a study, and its plan.

    Attributes:
        point: Index of the point.
        values: Its values by field path.
        status: Status of the plan; bad_input where the problem is invalid, crashed where its
            process died or the program failed.
        duration: Duration of the certified motion [s]; None if there is none.
        shortest_duration: Duration of the shortest certified motion [s]; None if there is none.
        bound: Lower bound on the duration of all motions [s]; None without a motion.
        planning_time: Wall time from the loaded problem to the certified result [s]; None without a
            plan.
        loading_time: Wall time of reading the problem [s]; None if reading failed.
        runs: Number of simulated runs; None unless robustness requires them.
        runs_failed: Number of failed runs; None unless robustness requires them.
        method: Method of the plan, as of `PlanResult`; None without a plan.
        message: One sentence: the answer, or the reason for its absence.
        where: Location of the failure; empty without one.
        notes: Notes on the answer.
        trajectory_hash: Hash of all bits of the motion's breakpoints and coefficients; None if
            there is no motion.
        key: Hash of all inputs of the point: contents of all its files, options, program; None if
            its values cannot be set together.
    """

    point: int
    values: Mapping[str, Any]
    status: PlanStatus
    duration: float | None = None
    shortest_duration: float | None = None
    bound: float | None = None
    planning_time: float | None = None
    loading_time: float | None = None
    runs: int | None = None
    runs_failed: int | None = None
    method: str | None = None
    message: str = ""
    where: Location = field(default_factory=Location)
    notes: tuple[str, ...] = ()
    trajectory_hash: str | None = None
    key: str | None = None

    __repr__ = short_repr

    @classmethod
    def of(
        cls, point: int, values: Mapping[str, Any], key: str | None, answer: Mapping[str, Any]
    ) -> "StudyRow":
        """Return the row of an answer.

        Args:
            point: Index of the point.
            values: Its values by field path.
            key: Hash of all inputs of the point.
            answer: The other fields, as JSON values.

        Raises:
            ValueError: The answer has unknown fields, or values of other types.
            TypeError: Its place has unknown fields.
        """
        require_fields(cls, {"point": point, "values": {}, **answer})
        converted: dict[str, Any] = {
            "status": PlanStatus(answer["status"]),
            "where": Location.of_dict(answer["where"]),
            "notes": tuple(answer["notes"]),
        }
        return cls(point, values, key=key, **{**answer, **converted})

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        return columns(self, (each.name for each in fields(self)))


_REFUSED = "status", "message", "where", "notes"
_PLANNED = (
    *("status", "message", "where", "duration", "shortest_duration", "bound", "method"),
    *("planning_time", "runs", "runs_failed", "notes"),
)


def planned_answer(spec: ProblemSpec, options: PlanOptions) -> dict[str, Any]:
    """Plan a problem or a cycle, and return its row as JSON values, without point and values.

    Raises:
        KeyboardInterrupt: Ctrl-C, even if a certified motion was there already.
    """
    row = PlannedRow.of(spec, options)
    if row.result is None:
        return {**columns(row, _REFUSED), "loading_time": row.loading_time}
    motion = row.result if isinstance(row.result, PlanResult) else row.result.motion
    trajectory = None if motion is None else motion.trajectory
    digest = None
    if trajectory is not None:
        parts = (trajectory.breakpoints, trajectory.coefficients)
        content = b"".join(part.tobytes() for part in parts)
        digest = hashlib.sha256(content).hexdigest()[:_HASH_DIGITS]
    more = {"trajectory_hash": digest, "loading_time": row.loading_time}
    return {**columns(row, _PLANNED), **more}


def refused_answer(reason: str) -> dict[str, Any]:
    """Return the answer of a point with an invalid problem, as JSON values."""
    return columns(PlannedRow(None, reason), _REFUSED)


def crashed_answer(error: Exception) -> dict[str, Any]:
    """Return the answer of a point whose process died or whose plan raised."""
    text = f"{type(error).__name__}: {error}"
    return columns(PlannedRow(None, text, crashed=True), _REFUSED)


@dataclass(frozen=True, eq=False)
class StudyResult(RowTable):
    """The rows of a study.

    Attributes:
        study: The study.
        rows: Rows of all finished points, in the order of the points.
        stopped_by: "interrupt" if Ctrl-C kept other points from being planned; None otherwise.
    """

    study: Study
    rows: tuple[StudyRow, ...]
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows of each status, the most frequent first."""
        return dict(Counter(str(row.status) for row in self.rows).most_common())

    @property
    def shortest(self) -> StudyRow | None:
        """The row of the shortest duration; None if no point has a certified motion."""
        durations = [row.duration for row in self.rows if row.duration is not None]
        if not durations:
            return None
        return next(row for row in self.rows if row.duration == min(durations))

    def as_dict(self) -> dict[str, Any]:
        """Return the study as JSON values."""
        count = len(self.study.points)
        return self.table(study=self.study.name, points=count, counts=self.counts)

    def csv(self) -> str:
        """Return the rows as CSV, with a column for every varied field.

        Lists and maps are written as JSON, places as text, notes with semicolons between them.
        """
        paths = [axis.path for axis in self.study.axes]
        names = [each.name for each in fields(StudyRow) if each.name not in ("point", "values")]
        rows = []
        for row in self.rows:
            texts = {**row.as_dict(), "where": str(row.where), "notes": "; ".join(row.notes)}
            values = [value_text(row.values[path]) for path in paths]
            rows.append([row.point, *values, *(texts[name] for name in names)])
        return csv_text(["point", *paths, *names], rows)


# ---- Running: every point planned once, in worker processes, and kept in a journal.


def run_study(
    study: Study,
    *,
    journal: str | Path | None = None,
    executor: Executor | None = None,
    progress: Callable[[object], None] | None = None,
) -> StudyResult:
    """Plan every point of a study, each from scratch, as `plan` does with the study's options.

    Points that agree to the last byte of their files are planned once.

    Args:
        study: The study.
        journal: File that keeps every answer at once. Its answers of a former run are used: an
            interrupted run goes on. None: no file.
        executor: Any executor of `concurrent.futures`; None: a process for every processor.
        progress: Called with a `StudyProgress` whenever points are done.

    Returns:
        A row for every point, in their order. A point that cannot be planned has the reason in its
        row. After Ctrl-C, the finished rows.

    Raises:
        OutputError: The journal cannot be used or written.
        ProblemError: The study is no `Study`.
        OptionError: The executor broke, a worker has other files than this process had, or an
            argument is of another kind.
        KeyboardInterrupt: Ctrl-C before the first point was done.
    """
    Study.require(study)

    def variants() -> Iterator[Variant]:
        for point in study.points:
            try:
                spec = study.spec(point)
            except ProblemError as error:
                yield Variant(point.index, None, answer=refused_answer(str(error)))
                continue
            key = spec.content_hash(study.options)
            yield Variant(point.index, (key, spec), key, point.values)

    run = RowRun[dict[str, Any]]("points", executor, progress, journal=journal, restore=_restored)
    with run:
        work = partial(_answer, options=study.options)
        count = len(study.points)
        run.run(work, variants(), count, failed=lambda _, error: crashed_answer(error))
    rows = (
        StudyRow.of(index, study.points[index].values, run.key(index), answer)
        for index, answer in run.rows.items()
    )
    return StudyResult(study, tuple(rows), run.stopped_by)


def _restored(answer: Mapping[str, Any]) -> dict[str, Any]:
    StudyRow.of(0, {}, None, answer)
    return dict(answer)


def _answer(call: tuple[str, ProblemSpec], options: PlanOptions) -> dict[str, Any]:
    """Return the answer of a problem with its key.

    Raises:
        OptionError: The problem has another key here.
    """
    key, spec = call
    if spec.content_hash(options) != key:
        raise OptionError(
            f"{spec.name}: its files, or tubeplanner's own, are not what they were when the study "
            "began, or where it was started; run it again, the answers so far are kept"
        )
    return planned_answer(spec, options)
