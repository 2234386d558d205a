"""The duration against any field of a problem file: one problem planned at several values of it.

Every value is planned from scratch, exactly as by `plan`: a row does not depend on its neighbours.
"""

import csv
import io
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from tubeplanner.arguments import given_options, given_row
from tubeplanner.errors import OptionError, ProblemError, RobotError
from tubeplanner.many.posed_problem import PosedProblem
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.planner import plan
from tubeplanner.problem.document_kind import require_problem
from tubeplanner.problem.field_paths import is_of_objective, require_changes, require_path
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import StoppedBy
from tubeplanner.short_repr import short_repr
from tubeplanner.simulation.run_verdict import RunVerdict
from tubeplanner.studies.axes import Levels
from tubeplanner.studies.formula_cells import without_formulas
from tubeplanner.studies.json_values import json_value, value_text
from tubeplanner.studies.study import Study
from tubeplanner.studies.swept_rows import swept_rows


@dataclass(frozen=True, eq=False)
class FieldRow:
    """One value of the field, and the result of planning with it.

    Attributes:
        value: As it is given, such as 0.02, [0.02, 0.03] or "x0.5".
        result: The result of planning; None where the problem cannot be posed.
        message: One sentence: the answer, or why there is none.
        loading_time: How long reading the problem took [s].
    """

    value: Any
    result: PlanResult | None
    message: str
    loading_time: float

    __repr__ = short_repr

    @property
    def status(self) -> PlanStatus:
        """How planning ended; bad_input where the problem cannot be posed."""
        return PlanStatus.BAD_INPUT if self.result is None else self.result.status

    @property
    def duration(self) -> float | None:
        """Duration of the certified trajectory [s]; None if there is none."""
        return None if self.result is None else self.result.duration

    @property
    def shortest_duration(self) -> float | None:
        """Duration of the shortest certified trajectory that was found [s]; None if none was."""
        return None if self.result is None else self.result.shortest_duration

    @property
    def verdict(self) -> RunVerdict | None:
        """What was seen of the answer in simulation; None unless robustness asks for it."""
        survival = None if self.result is None else self.result.survival
        return None if survival is None else survival.verdict

    @property
    def runs(self) -> int | None:
        """How many runs were simulated; None unless robustness asks for it."""
        return None if self.verdict is None else self.verdict.runs

    @property
    def runs_failed(self) -> int | None:
        """How many of them failed; likewise."""
        return None if self.verdict is None else self.verdict.failed

    @property
    def notes(self) -> tuple[str, ...]:
        """What else is worth knowing about the answer."""
        return () if self.result is None else self.result.notes

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        return {
            "value": json_value(self.value),
            "status": str(self.status),
            "duration": self.duration,
            "shortest_duration": self.shortest_duration,
            "runs": self.runs,
            "runs_failed": self.runs_failed,
            "method": None if self.result is None else self.result.method,
            "planning_time": None if self.result is None else self.result.planning_time,
            "loading_time": self.loading_time,
            "message": self.message,
            "notes": list(self.notes),
        }


@dataclass(frozen=True, eq=False)
class FieldSweep:
    """The duration against a field.

    Attributes:
        name: Of the problem.
        path: Of the field, such as "robot.payload.mass".
        rows: One per value, in the order given.
        stopped_by: "interrupt" if Ctrl-C kept other values from being planned; None otherwise.
    """

    name: str
    path: str
    rows: tuple[FieldRow, ...]
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    @property
    def succeeded(self) -> bool:
        """Whether any value has a certified trajectory."""
        return any(row.duration is not None for row in self.rows)

    @property
    def is_simulated(self) -> bool:
        """Whether any answer was executed in simulation."""
        return any(row.verdict is not None for row in self.rows)

    @property
    def varies_objective(self) -> bool:
        """Whether the field is part of the objective, so that answers may not be the shortest."""
        return is_of_objective(self.path)

    def as_dict(self) -> dict[str, Any]:
        """Return the sweep as JSON values."""
        rows = [row.as_dict() for row in self.rows]
        report = {"problem": self.name, "quantity": self.path}
        return {**report, "stopped_by": self.stopped_by, "rows": rows}

    def csv(self) -> str:
        """Return the rows as CSV; lists and maps as JSON, notes with semicolons between them."""
        stream = io.StringIO()
        first, *others = FieldRow(None, None, "", 0.0).as_dict()
        writer = csv.DictWriter(stream, [self.path, *others], lineterminator="\n")
        writer.writeheader()
        for row in self.rows:
            fields = row.as_dict()
            del fields[first]
            notes = "; ".join(row.notes)
            writer.writerow({self.path: value_text(row.value), **fields, "notes": notes})
        return without_formulas(stream.getvalue())


def sweep_field(
    problem: str | Path,
    path: str,
    values: Sequence[Any],
    *,
    changes: Mapping[str, Any] | None = None,
    options: PlanOptions | None = None,
    executor: Executor | None = None,
    progress: Callable[[object], None] | None = None,
) -> FieldSweep:
    """Plan a problem file at several values of a field, each from scratch.

    Answers are the shortest motions, unless a slack is given or the field is of the objective.

    Args:
        problem: A path, or `example:ROBOT/NAME` for a bundled problem.
        path: Of the field, as for `load_problem`.
        values: What it is to be; "x0.5" scales every number there.
        changes: Of other fields, made first.
        options: How to plan.
        executor: What plans, any of `concurrent.futures`; None: this process, value by value.
        progress: Called as by `plan`, its stage with the value in front; with an executor, when a
            value is done.

    Returns:
        A row for every value, in their order. A value that cannot be planned has the reason in its
        row. After Ctrl-C, the finished rows.

    Raises:
        ProblemError: The file cannot be read, or the path leads nowhere in it.
        OptionError: No value is given, the field is changed too, the field is of the objective and
            a slack is given, or an argument is of another kind.
        KeyboardInterrupt: Ctrl-C before the first value was done.
    """
    require_path(path)
    changes = {} if changes is None else changes
    require_changes(changes)
    options = _options(path, given_options(options, PlanOptions))
    values = given_row("values", values, f"what {path} is to be")
    study = _study(problem, path, values, changes, options)
    asked = ((value, study.posed(point)) for value, point in zip(values, study.points, strict=True))
    called = f"value {{}} of {len(values)}".format
    rows, stopped_by = swept_rows(partial(_row, options), asked, called, executor, progress)
    return FieldSweep(study.name, path, tuple(rows), stopped_by)


def _options(path: str, options: PlanOptions) -> PlanOptions:
    if not is_of_objective(path):
        return options.shortest
    if options.slack is not None:
        raise OptionError(f"{path} is varied and slack is given; leave out one of them")
    return options


def _study(
    problem: str | Path,
    path: str,
    values: Sequence[Any],
    changes: Mapping[str, Any],
    options: PlanOptions,
) -> Study:
    """Return the values of a field as a study of one axis."""
    if len(values) == 0:
        raise OptionError(f"{path}: give at least one value")
    if path in changes:
        raise OptionError(f"{path} is both varied and changed; leave out one of them")
    posed = PosedProblem.read(problem)
    require_problem(posed.document, posed.name)
    changed = posed.changed(changes)
    return Study(posed.name, {posed.name: changed}, [Levels(path, values)], options=options)


def _row(
    options: PlanOptions,
    asked: tuple[Any, PosedProblem],
    progress: Callable[[object], None] | None = None,
) -> FieldRow:
    """Return the row of a value, given with its problem; arguments as of `plan`."""
    value, posed = asked
    begin = time.perf_counter()
    if progress is not None:
        progress("loading robot and collision geometry")
    try:
        problem = posed.load()
    except (ProblemError, RobotError) as error:
        reason = str(error).removeprefix(f"{posed.name}: ")
        return FieldRow(value, None, reason, time.perf_counter() - begin)
    loading_time = time.perf_counter() - begin
    assert isinstance(problem, PlanningProblem)
    result = plan(problem, options, progress)
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    return FieldRow(value, result, result.message, loading_time)
