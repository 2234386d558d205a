"""Rows of planned variants: the record, and the one runner with journal, executor and progress."""

import itertools
import time
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, Generic, NamedTuple, TypeVar

from tubeplanner.checks import checked_path, require_executor
from tubeplanner.errors import OptionError, TubePlannerError
from tubeplanner.execution.run_verdict import RunVerdict
from tubeplanner.outcome import (
    Location,
    PlanStatus,
    ProgressCallback,
    StoppedBy,
    TimeLimitReached,
    require_callback,
)
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import CycleResult, PlanResult
from tubeplanner.planning.strategy import plan, plan_cycle
from tubeplanner.studies.journal import Journal
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.worker_processes import WorkerProcesses
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import Task
from tubeplanner.text import csv_text, json_value, short_repr

# ---- The record: one variant of a problem, and the result of its plan.


class Row:
    """A planned variant; a subclass says which, and chooses the columns of its table.

    Attributes:
        result: Result of planning; None where the problem is invalid, or its plan crashed.
        crashed: True if planning raised an unexpected exception, or its process died twice.
    """

    result: PlanResult | CycleResult | None
    crashed = False

    @property
    def status(self) -> PlanStatus:
        """Status of the plan; bad_input where the problem is invalid."""
        if self.result is not None:
            return self.result.status
        return PlanStatus.CRASHED if self.crashed else PlanStatus.BAD_INPUT

    @property
    def duration(self) -> float | None:
        """Duration of the certified motion [s]; None if there is none."""
        return None if self.result is None else self.result.duration

    @property
    def shortest_duration(self) -> float | None:
        """Duration of the shortest certified motion [s]; None if there is none."""
        return None if self.result is None else self.result.shortest_duration

    @property
    def bound(self) -> float | None:
        """Lower bound on the duration of all motions [s]; None without a motion."""
        bound = None if self.result is None else self.result.bound
        return None if bound is None else bound.duration

    @property
    def method(self) -> str | None:
        """Method of the plan; None without a plan."""
        return None if self.result is None else self.result.method

    @property
    def planning_time(self) -> float | None:
        """Wall time from the loaded problem to the certified result [s]; None without a plan."""
        return None if self.result is None else self.result.planning_time

    @property
    def where(self) -> Location:
        """Location of the failure; empty without one."""
        return Location() if self.result is None else self.result.location

    @property
    def verdict(self) -> RunVerdict | None:
        """Verdict over the answer's simulated runs; None unless robustness requires runs."""
        survival = self.result.survival if isinstance(self.result, PlanResult) else None
        return None if survival is None else survival.verdict

    @property
    def runs(self) -> int | None:
        """Number of simulated runs; None unless robustness requires runs."""
        return None if self.verdict is None else self.verdict.runs

    @property
    def runs_failed(self) -> int | None:
        """Number of failed runs; None unless robustness requires runs."""
        return None if self.verdict is None else self.verdict.failed

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the answer."""
        return () if self.result is None else self.result.notes


@dataclass(frozen=True, eq=False)
class PlannedRow(Row):
    """A variant that was read and planned."""

    result: PlanResult | CycleResult | None  # as of a `Row`
    message: str  # one sentence: the answer, or the reason for its absence
    loading_time: float | None = None  # time of reading the problem [s]; None if that failed
    crashed: bool = False  # as of a `Row`

    __repr__ = short_repr

    @classmethod
    def of(
        cls,
        spec: ProblemSpec,
        options: PlanOptions,
        progress: ProgressCallback | None = None,
        *,
        raises_options: bool = False,
    ) -> "PlannedRow":
        """Read and plan a problem or a cycle.

        Args:
            spec: The problem or cycle.
            options: Planning options.
            progress: As for `plan`.
            raises_options: True to raise where `plan` does; False: the message says why.

        Raises:
            KeyboardInterrupt: Ctrl-C, even if a certified motion was there already.
        """
        begin, loading_time = time.perf_counter(), None
        try:
            loaded = spec.load()
            loading_time = time.perf_counter() - begin
            result = finished_plan(loaded, options, progress)
        except TubePlannerError as error:
            if raises_options and loading_time is not None:
                raise
            return cls(None, str(error).removeprefix(f"{spec.name}: "), loading_time)
        return cls(result, result.message, loading_time)


def columns(row: object, names: Iterable[str]) -> dict[str, Any]:
    """Return attributes of a row as JSON values by name."""
    return {name: _plain(getattr(row, name)) for name in names}


def _plain(value: Any) -> Any:
    if isinstance(value, Location):
        return value.as_dict()
    return str(value) if isinstance(value, PlanStatus) else json_value(value)


class RowTable:
    """A result with rows; a subclass says of what.

    Attributes:
        rows: The rows.
        stopped_by: "interrupt" if Ctrl-C kept other variants from being planned; None otherwise.
    """

    rows: tuple[Any, ...]
    stopped_by: StoppedBy | None

    @property
    def succeeded(self) -> bool:
        """True if any row has a certified motion."""
        return any(row.duration is not None for row in self.rows)

    def table(self, **about: Any) -> dict[str, Any]:
        """Return the rows as JSON values, behind what they are about."""
        rows = [row.as_dict() for row in self.rows]
        return {**about, "stopped_by": self.stopped_by, "rows": rows}


def rows_csv(rows: Sequence[Any], texts: Callable[[Any], Mapping[str, str]], **titles: str) -> str:
    """Return rows as CSV.

    Args:
        rows: At least one.
        texts: Function from a row to the texts of its values that are lists or maps, by column.
        titles: Other titles of columns.
    """
    lines = [{**row.as_dict(), **texts(row)} for row in rows]
    return csv_text(
        [titles.get(name, name) for name in lines[0]], (each.values() for each in lines)
    )


def plan_task(
    task: Task, options: PlanOptions, progress: ProgressCallback | None = None
) -> PlanResult | CycleResult:
    """Plan a problem or a cycle, with the arguments and exceptions of `plan`."""
    if isinstance(task, Cycle):
        return plan_cycle(task, options, progress)
    return plan(task, options, progress)


def finished_plan(
    task: Task, options: PlanOptions, progress: ProgressCallback | None = None
) -> PlanResult | CycleResult:
    """Plan a problem or a cycle as a row among others.

    Raises:
        KeyboardInterrupt: Ctrl-C, even if a certified motion was there already.
    """
    result = plan_task(task, options, progress)
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    return result


# ---- Calls of one function with many items, by any executor.

_T = TypeVar("_T")
_R = TypeVar("_R")
# More would hold more in memory; fewer would leave some of a large cluster without work.
_SUBMITTED = 4000


@dataclass(frozen=True)
class Done(Generic[_R]):
    """The result of the call with one item."""

    index: int  # index of the item
    value: _R | None = None  # the returned value; None if the call failed
    error: Exception | None = None  # of the call or of its worker; None if the call returned


def run_many(
    work: Callable[[_T], _R],
    items: Iterable[_T],
    executor: Executor | None = None,
    until: float | None = None,
) -> Iterator[Done[_R]]:
    """Call a function with each item, and yield each result in the order of completion.

    Args:
        work: The function; it must be importable by name for executors that pickle.
        items: Its arguments; taken a few thousand at most ahead of the finished calls.
        executor: Executor of the calls, by `submit` alone; None: this process, one after the other.
        until: Time by `time.monotonic` after which no call of an executor is waited for; None:
            all are waited for.

    Raises:
        OptionError: The executor broke, or dropped items: unfinished calls are lost.
        TimeLimitReached: `until` has passed.
        KeyboardInterrupt: Ctrl-C; calls that have not begun are dropped.
    """
    if executor is None:
        for index, item in enumerate(items):
            try:
                result = Done(index, work(item))
            except Exception as error:
                result = Done(index, error=error)
            yield result
        return
    waiting: dict[Future[_R], int] = {}
    finished: SimpleQueue[Future[_R]] = SimpleQueue()
    numbered = enumerate(items)
    try:
        while True:
            if finished.empty() and len(waiting) < _SUBMITTED and (entry := next(numbered, None)):
                index, item = entry
                try:
                    future = executor.submit(work, item)
                except BrokenExecutor as error:
                    raise _broken(error) from error
                waiting[future] = index
                future.add_done_callback(finished.put)
            elif waiting:
                try:
                    future = finished.get(
                        timeout=None if until is None else max(until - time.monotonic(), 0.0)
                    )
                except Empty:
                    raise TimeLimitReached from None
                index = waiting.pop(future)
                try:
                    result = Done(index, future.result())
                except (BrokenExecutor, CancelledError) as error:
                    raise _broken(error) from error
                except Exception as error:
                    result = Done(index, error=error)
                yield result
            else:
                return
    finally:
        for future in waiting:
            future.cancel()


def _broken(error: BaseException) -> OptionError:
    return OptionError(
        f"the executor broke ({type(error).__name__}: {error}); WorkerProcesses goes on where a "
        "process dies, and so does a Dask cluster"
    )


# ---- The runner: each variant planned once, kept in a journal, counted.


@dataclass(frozen=True)
class StudyProgress:
    """The progress of a study, or of another run of many plans."""

    done: int  # number of finished points
    count: int  # number of all points
    planned: int  # number of finished points that were planned, not read from the journal
    elapsed: float  # wall time since the study began [s]
    noun: str = "points"  # plural of a point
    stage: str = ""  # part of the run, or stage of the current plan; empty: none

    @property
    def rate(self) -> float | None:
        """Points planned per second; None before the first."""
        return self.planned / self.elapsed if self.planned and self.elapsed else None

    @property
    def time_left(self) -> float | None:
        """Wall time until all are done, at the present rate [s]; None before the first."""
        return None if self.rate is None else (self.count - self.done) / self.rate

    def __str__(self) -> str:
        text = f"{self.done} of {self.count} {self.noun}"
        if self.rate is not None and self.time_left is not None:
            rate = (
                f"{self.rate:.3g} per second" if self.rate >= 1 else f"{1 / self.rate:.3g} s each"
            )
            hours, minutes = divmod(round(self.time_left / 60), 60)
            duration = f"{hours} h {minutes} min" if hours else f"{minutes} min"
            if self.time_left < 100:
                duration = f"{self.time_left:.0f} s"
            text += f", {rate}, {duration} left"
        return f"{text}; {self.stage}" if self.stage else text


class Variant(NamedTuple):
    """A variant of a problem that is to be planned."""

    name: Hashable  # index of its row, or another name that no other variant of the run has
    argument: Any  # argument of the work
    # hash of all inputs of its plan: equal keys are planned once; None: planned by itself
    key: str | None = None
    values: Mapping[str, Any] = {}  # varied values by field path, for readers of the journal
    answer: Any = None  # the answer, if it is known without a plan; None: it is not


class RowRun(Generic[_R]):
    """A run of many plans, for use in a `with` statement.

    Ctrl-C ends the statement, and its own processes, quietly once there is an answer.

    Attributes:
        executor: The executor; None: this process.
        restored: Number of answers from the journal.
        stopped_by: "interrupt" if Ctrl-C ended the statement; None otherwise.
    """

    def __init__(
        self,
        noun: str,
        executor: Executor | None,
        progress: Callable[[Any], None] | None,
        *,
        is_here: bool = False,
        journal: str | Path | None = None,
        plain: Callable[[_R], Mapping[str, Any]] = dict,  # type: ignore[assignment]
        restore: Callable[[Mapping[str, Any]], _R] = dict,  # type: ignore[assignment]
    ) -> None:
        """Check the arguments.

        Args:
            noun: Plural of a variant, for progress.
            executor: Any executor of `concurrent.futures`; None: as `is_here` says.
            progress: Called with a `StudyProgress`; None: nothing is called.
            is_here: True: without an executor this process plans; False: `WorkerProcesses`.
            journal: File of the answers, which are JSON values then; None: none.
            plain: Function from an answer to its JSON values in the journal.
            restore: Its inverse; raises for invalid values, as for `Journal.made`.

        Raises:
            OptionError: An argument is of another kind.
        """
        require_callback(progress)
        require_executor(executor)
        self._noun, self._progress = noun, progress
        self._plain, self._restore = plain, restore
        self.executor, self._is_here = executor, is_here
        self._path = None if journal is None else checked_path("journal", journal)
        self._journal: Journal | None = None
        self._stack = ExitStack()
        self._answers: dict[Hashable, _R] = {}  # by key, or by name without one
        self._keys: dict[Hashable, Hashable] = {}  # by name
        self._done = self._count = self._planned = 0
        self._begin = time.perf_counter()
        self.restored = 0
        self.stopped_by: StoppedBy | None = None

    def __enter__(self) -> "RowRun[_R]":
        if self._path is not None:
            self._journal = self._stack.enter_context(Journal(self._path))
        if self.executor is None and not self._is_here:
            self.executor = self._stack.enter_context(WorkerProcesses())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> bool:
        self._stack.__exit__(kind, error, traceback)
        if not isinstance(error, KeyboardInterrupt) or not self._answers:
            return False
        self.stopped_by = "interrupt"
        return True

    @property
    def rows(self) -> dict[Any, _R]:
        """The answers by the names of their variants, in the order of the variants."""
        pairs = self._keys.items()
        return {name: self._answers[key] for name, key in pairs if key in self._answers}

    def key(self, name: Hashable) -> str | None:
        """Return the key of a variant."""
        key = self._keys[name]
        return key if isinstance(key, str) else None

    def replace(self, name: Hashable, answer: _R) -> None:
        """Put another answer in the place of the answer of a variant."""
        self._answers[self._keys[name]] = answer

    def report(self, stage: object = "") -> None:
        """Call the callback with the progress, and a stage or the part of the run."""
        if self._progress is not None:
            numbers = self._done, self._count, self._planned, time.perf_counter() - self._begin
            self._progress(StudyProgress(*numbers, self._noun, str(stage)))

    def run(
        self,
        work: Callable[[Any], _R],
        variants: Iterable[Variant],
        count: int,
        *,
        failed: Callable[[Variant, Exception], _R] | None = None,
        stage: str = "",
    ) -> None:
        """Add the answers of variants, each key planned once.

        Args:
            work: Function from a variant's argument to its answer, as for `run_many`.
            variants: The variants, taken as needed.
            count: Their number.
            failed: Function from a variant and the exception of its work to an answer; None: any
                exception is raised.
            stage: Part of the run, for progress.

        Raises:
            OptionError: The executor broke, or the work raised it.
            OutputError: The journal cannot be written, or has an invalid answer.
        """
        self._done, self._count, self._planned, self._begin = 0, count, 0, time.perf_counter()
        sent: dict[int, Variant] = {}  # by number of the call
        numbers = itertools.count()
        waiting: Counter[Hashable] = Counter()  # variants by key, while it is planned

        def add(number: int, planned: int = 0) -> None:
            self._done += number
            self._planned += planned
            self.report(stage)

        def arguments() -> Iterator[Any]:
            add(0)
            for variant in variants:
                key = self._keys[variant.name] = variant.key or variant.name
                if variant.answer is not None:
                    self._answers[key] = variant.answer
                if key in self._answers or self._is_restored(variant.key):
                    add(1)
                    continue
                waiting[key] += 1
                if waiting[key] == 1:
                    sent[next(numbers)] = variant
                    yield variant.argument

        for done in run_many(work, arguments(), self.executor):
            variant, answer = sent.pop(done.index), done.value
            if done.error is not None:
                if failed is None or isinstance(done.error, OptionError):
                    raise done.error
                answer = failed(variant, done.error)
            assert answer is not None
            if self._journal is not None and variant.key is not None:
                self._journal.add(variant.key, variant.values, self._plain(answer))
            key = variant.key or variant.name
            self._answers[key] = answer
            add(waiting.pop(key), planned=1)

    def _is_restored(self, key: str | None) -> bool:
        """Take the answer of a key from the journal; return True if there is an answer."""
        if self._journal is None or key is None or key not in self._journal:
            return False
        self._answers[key] = self._journal.made(key, self._restore)
        self.restored += 1
        return True
