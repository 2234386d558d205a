"""Run_study: each point once, journaled; rows, table."""

import csv
import hashlib
import io
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any

from tubeplanner.checks import given_path, require_executor
from tubeplanner.errors import OptionError, ProblemError, TubePlannerError
from tubeplanner.outcome import Place, PlanStatus, StoppedBy, require_callback
from tubeplanner.planning.cycle_result import CycleResult
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.studies.journal import Journal, require_fields
from tubeplanner.studies.plan_many import Done, plan_either, run_many
from tubeplanner.studies.problem_spec import PosedProblem
from tubeplanner.studies.study import Study
from tubeplanner.studies.worker_processes import WorkerProcesses
from tubeplanner.text import json_value, short_repr, value_text, without_formulas
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

# ---- One point of a study as its table has it, made where it is planned, so that little travels.

_HASH_DIGITS = 16


@dataclass(frozen=True, eq=False)
class StudyRow:
    """One point of a study, and what became of it.

    Attributes:
        point: Which one, from 0.
        values: By field path.
        status: How planning ended; bad_input where the problem cannot be posed, crashed where its
            process died or the program failed.
        duration: Of the certified motion [s]; None if there is none.
        shortest_duration: Of the shortest certified motion that was found [s]; likewise.
        planning_time: Wall time from the loaded problem to the certified result [s]; None where
            nothing was planned.
        loading_time: Wall time of reading the problem [s]; None if that did not come to an end.
        runs: How many runs were simulated; None unless robustness asks for it.
        runs_failed: How many of them failed.
        method: As of a `PlanResult`; None where nothing was planned.
        message: One sentence: the answer, or why there is none.
        where: In what place, if there is no answer.
        notes: What else is worth knowing about the answer.
        trajectory_hash: Of the motion's breakpoints and coefficients, bit by bit; None if there is
            none.
        key: Of what the point is: the contents of all its files, options, program; None if its
            values cannot be set together.
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
    where: Place = field(default_factory=Place)
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
            point: Which one.
            values: By field path.
            key: Of what the point is.
            answer: The other fields, as JSON values.

        Raises:
            ValueError: The answer has other fields, or values of other types.
            TypeError: Likewise, its place.
        """
        require_fields(cls, {"point": point, "values": {}, **answer})
        place: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in answer["where"].items()
        }
        converted: dict[str, Any] = {
            "status": PlanStatus(answer["status"]),
            "where": Place(**place),
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


def planned_answer(posed: PosedProblem, options: PlanOptions) -> dict[str, Any]:
    """Plan a problem or a cycle, and return its row as JSON values, without point and values.

    Args:
        posed: Which one.
        options: How.

    Raises:
        KeyboardInterrupt: Ctrl-C, also where there was something certified already.
    """
    begin = time.perf_counter()
    loading_time = None
    try:
        loaded = posed.load()
        loading_time = time.perf_counter() - begin
        result = plan_either(loaded, options)
    except TubePlannerError as error:
        reason = str(error).removeprefix(f"{posed.name}: ")
        return {**refused_answer(reason), "loading_time": loading_time}
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    return {**_of_result(result), "loading_time": loading_time}


def refused_answer(reason: str) -> dict[str, Any]:
    """Return the answer of a point that cannot be posed, as JSON values."""
    return _without_plan(PlanStatus.BAD_INPUT, reason)


def crashed_answer(error: Exception) -> dict[str, Any]:
    """Return the answer of a point whose process died, or at which the program failed."""
    return _without_plan(PlanStatus.CRASHED, f"{type(error).__name__}: {error}")


def _without_plan(status: PlanStatus, message: str) -> dict[str, Any]:
    return {"status": str(status), "message": message, "where": Place().as_dict(), "notes": []}


def _of_result(result: PlanResult | CycleResult) -> dict[str, Any]:
    survival = result.survival if isinstance(result, PlanResult) else None
    verdict = None if survival is None else survival.verdict
    return {
        "status": str(result.status),
        "message": result.message,
        "where": result.place.as_dict(),
        "duration": result.duration,
        "shortest_duration": result.shortest_duration,
        "method": result.method,
        "planning_time": result.planning_time,
        "runs": None if verdict is None else verdict.runs,
        "runs_failed": None if verdict is None else verdict.failed,
        "notes": list(result.notes),
        "trajectory_hash": _hash_of(result),
    }


def _hash_of(result: PlanResult | CycleResult) -> str | None:
    """Return a hash of every bit of a motion: the same only if it is the same motion."""
    trajectory: JointTrajectory | None
    if isinstance(result, PlanResult):
        trajectory = result.trajectory
    else:
        trajectory = None if result.motion is None else result.motion.trajectory
    if trajectory is None:
        return None
    parts = (trajectory.breakpoints, trajectory.coefficients)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()[:_HASH_DIGITS]


# ---- What came of a study: its rows, as a table.


@dataclass(frozen=True, eq=False)
class StudyResult:
    """What came of a study.

    Attributes:
        study: The study.
        rows: Of every point that is done, in the order of the points.
        stopped_by: "interrupt" if Ctrl-C kept other points from being planned; None otherwise.
    """

    study: Study
    rows: tuple[StudyRow, ...]
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    @property
    def succeeded(self) -> bool:
        """Whether any point has a certified motion."""
        return any(row.duration is not None for row in self.rows)

    @property
    def counts(self) -> dict[str, int]:
        """How many rows have each status, the most frequent first."""
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
        """Return the rows as CSV: a column for every field that is varied.

        Lists and maps are written as JSON, places as text, notes with semicolons between them.
        """
        stream = io.StringIO()
        paths = [axis.path for axis in self.study.axes]
        plain = StudyRow.__dataclass_fields__.keys() - {"point", "values"}
        columns = [name for name in StudyRow.__dataclass_fields__ if name in plain]
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["point", *paths, *columns])
        for row in self.rows:
            texts = {**row.as_dict(), "where": str(row.where), "notes": "; ".join(row.notes)}
            values = [value_text(row.values[path]) for path in paths]
            writer.writerow([row.point, *values, *(texts[name] for name in columns)])
        return without_formulas(stream.getvalue())


# ---- Studies are run: every point planned once, in worker processes, and kept in a journal.

Answer = dict[str, Any]


def run_study(
    study: Study,
    *,
    journal: str | Path | None = None,
    executor: Executor | None = None,
    progress: Callable[[object], None] | None = None,
) -> StudyResult:
    """Plan every point of a study, each from scratch, as `plan` does with the study's options.

    Points that are the same to the last byte of their files are planned once.

    Args:
        study: The study.
        journal: A file that keeps every answer as soon as it is there. Answers that it has of
            a former run are used: a run that was ended goes on. None: nothing is kept.
        executor: What plans, any of `concurrent.futures`; None: a process for every processor.
        progress: Called with a `StudyProgress` whenever points are done.

    Returns:
        A row for every point, in their order. A point that cannot be planned has the reason in its
        row. After Ctrl-C, the finished rows.

    Raises:
        OutputError: The journal cannot be used or written.
        ProblemError: The study is none.
        OptionError: The executor broke, whoever plans has other files than this process had, or an
            argument is of another kind.
        KeyboardInterrupt: Ctrl-C before the first point was done.
    """
    Study.require(study)
    require_callback(progress)
    require_executor(executor)
    kept_in = None if journal is None else given_path("journal", journal)
    with ExitStack() as stack:
        kept = None if kept_in is None else stack.enter_context(Journal(kept_in))
        run = _Run(study, kept, progress or _silent)
        work = partial(_answer, options=study.options)
        try:
            # Inside: Ctrl-C goes through it, which ends the processes.
            with WorkerProcesses() if executor is None else nullcontext(executor) as workers:
                for done in run_many(work, run.asked(), workers):
                    run.answered(done)
        except KeyboardInterrupt:
            if not (rows := run.rows()):
                raise
            return StudyResult(study, rows, "interrupt")
    return StudyResult(study, run.rows())


@dataclass(frozen=True)
class StudyProgress:
    """How far a study has come.

    Attributes:
        done: How many points.
        count: Of how many.
        planned: How many of these were planned, not found in the journal.
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
        """Wall time until all are done, at this rate [s]; None before the first."""
        return None if self.rate is None else (self.count - self.done) / self.rate

    def __str__(self) -> str:
        text = f"{self.done} of {self.count} points"
        if self.rate is None or self.time_left is None:
            return text
        rate = f"{self.rate:.3g} per second" if self.rate >= 1 else f"{1 / self.rate:.3g} s each"
        return f"{text}, {rate}, {_in_words(self.time_left)} left"


class _Run:
    """The answers of a study that come in, by the key of what was planned."""

    def __init__(
        self, study: Study, journal: Journal | None, progress: Callable[[object], None]
    ) -> None:
        self._study, self._journal, self._progress = study, journal, progress
        self._keys: list[str | None] = []  # of the points so far
        self._waiting: dict[str, list[int]] = {}  # the points of keys that are being planned
        self._order: list[str] = []  # the keys as they were sent out
        self._answers: dict[str, Answer] = {}
        self._refused: dict[int, Answer] = {}  # of points without a key
        self._begin = time.perf_counter()
        self._done = self._planned = 0

    def asked(self) -> Iterator[tuple[str, PosedProblem]]:
        """Yield keys and what is to be planned, point by point."""
        self._note(0)
        for point in self._study.points:
            try:
                posed = self._study.posed(point)
            except ProblemError as error:
                self._keys.append(None)
                self._refused[point.index] = refused_answer(str(error))
                self._note(1)
                continue
            key = posed.content_hash(self._study.options)
            self._keys.append(key)
            if key in self._waiting:
                self._waiting[key].append(point.index)
            elif key in self._answers or self._is_kept(key):
                self._note(1)
            else:
                self._waiting[key] = [point.index]
                self._order.append(key)
                yield key, posed

    def answered(self, done: Done[Answer]) -> None:
        """Keep an answer.

        Raises:
            OptionError: It was not planned, as the files are others.
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
        """Return the rows of all points that are done."""
        found = []
        for index, key in enumerate(self._keys):
            answer = self._refused.get(index) if key is None else self._answers.get(key)
            if answer is not None:
                values = self._study.points[index].values
                found.append(StudyRow.of(index, values, key, answer))
        return tuple(found)

    def _is_kept(self, key: str) -> bool:
        """Return whether the journal has an answer, which is then taken."""
        if self._journal is None or key not in self._journal:
            return False
        self._answers[key] = self._journal.made(key, _answer_of_study)
        return True

    def _note(self, done: int) -> None:
        self._done += done
        elapsed = time.perf_counter() - self._begin
        self._progress(StudyProgress(self._done, len(self._study.points), self._planned, elapsed))


def _answer(asked: tuple[str, PosedProblem], options: PlanOptions) -> Answer:
    """Plan what is of a key, and return its answer.

    Raises:
        OptionError: It is not of that key.
    """
    key, posed = asked
    if posed.content_hash(options) != key:
        raise OptionError(
            f"{posed.name}: its files, or tubeplanner's own, are not what they were when the study "
            "began, or where it was started; run it again, the answers so far are kept"
        )
    return planned_answer(posed, options)


def _answer_of_study(answer: Mapping[str, Any]) -> Answer:
    """Return an answer once it is one; errors as `StudyRow.of`."""
    StudyRow.of(0, {}, None, answer)
    return dict(answer)


def _in_words(seconds: float) -> str:
    """Return a time as one says it: 40 s, 12 min, 3 h 20 min."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def _silent(_: object) -> None:
    return None
