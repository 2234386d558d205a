"""Run_study: each point planned once, with a journal; rows and table."""

import hashlib
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any

from tubeplanner.checks import checked_path, require_executor
from tubeplanner.errors import OptionError, ProblemError, TubePlannerError
from tubeplanner.outcome import Location, PlanStatus, StoppedBy, require_callback
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.studies.journal import Journal, require_fields
from tubeplanner.studies.plan_many import Done, plan_either, run_many
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.study import Study
from tubeplanner.studies.worker_processes import WorkerProcesses
from tubeplanner.text import csv_text, json_value, short_repr, value_text

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
        plain = {each.name: getattr(self, each.name) for each in fields(self)}
        return {
            **plain,
            "values": json_value(self.values),
            "status": str(self.status),
            "where": self.where.as_dict(),
            "notes": list(self.notes),
        }


def planned_answer(spec: ProblemSpec, options: PlanOptions) -> dict[str, Any]:
    """Plan a problem or a cycle, and return its row as JSON values, without point and values.

    Args:
        spec: The problem or cycle.
        options: Planning options.

    Raises:
        KeyboardInterrupt: Ctrl-C, even if a certified motion was there already.
    """
    begin = time.perf_counter()
    loading_time = None
    try:
        loaded = spec.load()
        loading_time = time.perf_counter() - begin
        result = plan_either(loaded, options)
    except TubePlannerError as error:
        reason = str(error).removeprefix(f"{spec.name}: ")
        return {**refused_answer(reason), "loading_time": loading_time}
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    motion = result if isinstance(result, PlanResult) else result.motion
    trajectory = None if motion is None else motion.trajectory
    digest = None
    if trajectory is not None:
        parts = (trajectory.breakpoints, trajectory.coefficients)
        content = b"".join(part.tobytes() for part in parts)
        digest = hashlib.sha256(content).hexdigest()[:_HASH_DIGITS]
    survival = result.survival if isinstance(result, PlanResult) else None
    verdict = None if survival is None else survival.verdict
    return {
        "status": str(result.status),
        "message": result.message,
        "where": result.location.as_dict(),
        "duration": result.duration,
        "shortest_duration": result.shortest_duration,
        "method": result.method,
        "planning_time": result.planning_time,
        "runs": None if verdict is None else verdict.runs,
        "runs_failed": None if verdict is None else verdict.failed,
        "notes": list(result.notes),
        "trajectory_hash": digest,
        "loading_time": loading_time,
    }


def refused_answer(reason: str) -> dict[str, Any]:
    """Return the answer of a point with an invalid problem, as JSON values."""
    return _without_plan(PlanStatus.BAD_INPUT, reason)


def crashed_answer(error: Exception) -> dict[str, Any]:
    """Return the answer of a point whose process died or whose plan raised."""
    return _without_plan(PlanStatus.CRASHED, f"{type(error).__name__}: {error}")


def _without_plan(status: PlanStatus, message: str) -> dict[str, Any]:
    return {"status": str(status), "message": message, "where": Location().as_dict(), "notes": []}


@dataclass(frozen=True, eq=False)
class StudyResult:
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
    def succeeded(self) -> bool:
        """True if any point has a certified motion."""
        return any(row.duration is not None for row in self.rows)

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
        rows = [row.as_dict() for row in self.rows]
        about = {"study": self.study.name, "points": len(self.study.points), "counts": self.counts}
        return {**about, "stopped_by": self.stopped_by, "rows": rows}

    def csv(self) -> str:
        """Return the rows as CSV, with a column for every varied field.

        Lists and maps are written as JSON, places as text, notes with semicolons between them.
        """
        paths = [axis.path for axis in self.study.axes]
        columns = [each.name for each in fields(StudyRow) if each.name not in ("point", "values")]
        rows = []
        for row in self.rows:
            texts = {**row.as_dict(), "where": str(row.where), "notes": "; ".join(row.notes)}
            values = [value_text(row.values[path]) for path in paths]
            rows.append([row.point, *values, *(texts[name] for name in columns)])
        return csv_text(["point", *paths, *columns], rows)


# ---- Running: every point planned once, in worker processes, and kept in a journal.

Answer = dict[str, Any]


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
    require_callback(progress)
    require_executor(executor)
    path = None if journal is None else checked_path("journal", journal)
    with ExitStack() as stack:
        answers = None if path is None else stack.enter_context(Journal(path))
        run = _Run(study, answers, progress or (lambda what: None))
        work = partial(_answer, options=study.options)
        try:
            # Inside: Ctrl-C goes through it, which ends the processes.
            with WorkerProcesses() if executor is None else nullcontext(executor) as workers:
                for done in run_many(work, run.calls(), workers):
                    run.answered(done)
        except KeyboardInterrupt:
            if not (rows := run.rows()):
                raise
            return StudyResult(study, rows, "interrupt")
    return StudyResult(study, run.rows())


@dataclass(frozen=True)
class StudyProgress:
    """The progress of a study.

    Attributes:
        done: Number of finished points.
        count: Number of all points.
        planned: Number of finished points that were planned, not read from the journal.
        elapsed: Wall time since the study began [s].
    """

    done: int
    count: int
    planned: int
    elapsed: float

    @property
    def rate(self) -> float | None:
        """Points planned per second; None before the first."""
        return self.planned / self.elapsed if self.planned and self.elapsed else None

    @property
    def time_left(self) -> float | None:
        """Wall time until all are done, at the present rate [s]; None before the first."""
        return None if self.rate is None else (self.count - self.done) / self.rate

    def __str__(self) -> str:
        text = f"{self.done} of {self.count} points"
        if self.rate is None or self.time_left is None:
            return text
        rate = f"{self.rate:.3g} per second" if self.rate >= 1 else f"{1 / self.rate:.3g} s each"
        hours, minutes = divmod(round(self.time_left / 60), 60)
        duration = f"{hours} h {minutes} min" if hours else f"{minutes} min"
        if self.time_left < 100:
            duration = f"{self.time_left:.0f} s"
        return f"{text}, {rate}, {duration} left"


class _Run:
    """The answers of a study, by the key of the planned problem."""

    def __init__(
        self, study: Study, journal: Journal | None, progress: Callable[[object], None]
    ) -> None:
        self._study, self._journal, self._progress = study, journal, progress
        self._keys: list[str | None] = []  # of the points so far; None: refused
        self._waiting: dict[str, list[int]] = {}  # points by key, while it is planned
        self._order: list[str] = []  # keys in the order of the calls
        self._answers: dict[str, Answer] = {}
        self._refused: dict[int, Answer] = {}  # of points without a key
        self._begin = time.perf_counter()
        self._done = self._planned = 0

    def calls(self) -> Iterator[tuple[str, ProblemSpec]]:
        """Yield keys and problems to be planned, point by point."""
        self._note(0)
        for point in self._study.points:
            try:
                spec = self._study.spec(point)
            except ProblemError as error:
                self._keys.append(None)
                self._refused[point.index] = refused_answer(str(error))
                self._note(1)
                continue
            key = spec.content_hash(self._study.options)
            self._keys.append(key)
            if key in self._waiting:
                self._waiting[key].append(point.index)
            elif key in self._answers or self._restored(key):
                self._note(1)
            else:
                self._waiting[key] = [point.index]
                self._order.append(key)
                yield key, spec

    def answered(self, done: Done[Answer]) -> None:
        """Keep an answer.

        Raises:
            OptionError: It was not planned, as the files differ.
        """
        if isinstance(done.error, OptionError):
            raise done.error
        key = self._order[done.index]
        answer = crashed_answer(done.error) if done.error else done.value
        assert answer is not None
        points = self._waiting.pop(key)
        if self._journal is not None:
            self._journal.add(key, self._study.points[points[0]].values, answer)
        self._answers[key] = answer
        self._planned += 1
        self._note(len(points))

    def rows(self) -> tuple[StudyRow, ...]:
        result = []
        for index, key in enumerate(self._keys):
            answer = self._refused.get(index) if key is None else self._answers.get(key)
            if answer is not None:
                values = self._study.points[index].values
                result.append(StudyRow.of(index, values, key, answer))
        return tuple(result)

    def _restored(self, key: str) -> bool:
        """Take the answer of a key from the journal; return True if there is an answer."""
        if self._journal is None or key not in self._journal:
            return False

        def checked(answer: Mapping[str, Any]) -> Answer:
            StudyRow.of(0, {}, None, answer)
            return dict(answer)

        self._answers[key] = self._journal.made(key, checked)
        return True

    def _note(self, done: int) -> None:
        self._done += done
        elapsed = time.perf_counter() - self._begin
        self._progress(StudyProgress(self._done, len(self._study.points), self._planned, elapsed))


def _answer(call: tuple[str, ProblemSpec], options: PlanOptions) -> Answer:
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
