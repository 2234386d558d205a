"""Studies are run: every point planned once, in worker processes, and kept in a journal."""

import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tubeplanner.arguments import given_path, require_executor
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.many.run_many import Done, run_many
from tubeplanner.many.worker_processes import WorkerProcesses
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.progress import require_callback
from tubeplanner.studies.journal import Journal
from tubeplanner.studies.study import Study
from tubeplanner.studies.study_result import StudyResult
from tubeplanner.studies.study_row import (
    StudyRow,
    crashed_answer,
    planned_answer,
    refused_answer,
)

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
