"""Sweeps: duration against tolerance, or against any field of a file.

Every radius is planned from scratch, exactly as by `plan`: a start from the neighbour's trajectory
could end in another local optimum, and a row must not depend on its neighbours.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from tubeplanner.checks import checked_options, checked_row, in_figures, is_finite, is_number
from tubeplanner.errors import OptionError, ProblemError, RobotError
from tubeplanner.execution.run_verdict import RunVerdict
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.outcome import PlanStatus, StoppedBy
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.strategy import plan
from tubeplanner.studies.plan_many import swept_rows
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.study import Levels, Study
from tubeplanner.task.field_changes import is_of_objective, require_changes, require_path
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import require_problem
from tubeplanner.text import csv_text, json_value, short_repr, value_text

# ---- Duration against tolerance: one problem planned at several radii.

_SIDES = ("width", "height")  # of boxes, in the order of `Tube.cross_section`
_SAME = 1e-3  # durations nearer to each other (relative) do not differ


class _Row:
    """A row with the result of planning; None where the problem is invalid."""

    result: PlanResult | None

    @property
    def status(self) -> PlanStatus:
        """Status of the plan; bad_input where the problem is invalid."""
        return PlanStatus.BAD_INPUT if self.result is None else self.result.status

    @property
    def duration(self) -> float | None:
        """Duration of the certified trajectory [s]; None if there is none."""
        return None if self.result is None else self.result.duration


@dataclass(frozen=True, eq=False)
class SweepRow(_Row):
    """One tolerance, and the result of planning with it.

    Attributes:
        value: The radius of all segments [m], or the factor of all radii and sides of boxes.
        problem: The problem with that tolerance; None where it is invalid.
        result: The result of planning; None where the problem is invalid.
        message: One sentence: the answer, or the reason for its absence.
        elasticity: d ln T / d ln radius (of boxes, width and height) of all segments together, from
            the sensitivities; None if not known.
        note: Further information about the answer; None: none.
    """

    value: float
    problem: PlanningProblem | None
    result: PlanResult | None
    message: str
    elasticity: float | None = None
    note: str | None = None

    __repr__ = short_repr

    @property
    def slope(self) -> float | None:
        """The derivative of the duration by `value` [s/m, or s]; None if not known."""
        if self.elasticity is None or self.duration is None:
            return None
        return self.elasticity * self.duration / self.value

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        radius = None if self.problem is None else self.problem.tube.radius.tolist()
        return {
            "value": self.value,
            "radii": radius,
            "status": str(self.status),
            "duration": self.duration,
            "elasticity": self.elasticity,
            "slope": self.slope,
            "method": None if self.result is None else self.result.method,
            "planning_time": None if self.result is None else self.result.planning_time,
            "message": self.message,
            "note": self.note,
        }


@dataclass(frozen=True, eq=False)
class SweepResult:
    """The duration against the tolerance.

    Attributes:
        problem: The planning problem.
        quantity: "radius" [m] or "radius_scale".
        rows: One per tolerance, the narrowest first.
        stopped_by: "interrupt" if Ctrl-C kept wider tolerances from being planned; None otherwise.
    """

    problem: PlanningProblem
    quantity: str
    rows: tuple[SweepRow, ...]
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    @property
    def succeeded(self) -> bool:
        """True if any tolerance has a certified trajectory."""
        return any(row.duration is not None for row in self.rows)

    def as_dict(self) -> dict[str, Any]:
        """Return the sweep as JSON values."""
        rows = [row.as_dict() for row in self.rows]
        report = {"problem": self.problem.name, "quantity": self.quantity}
        return {**report, "stopped_by": self.stopped_by, "rows": rows}

    def csv(self) -> str:
        """Return the rows as CSV; `radii` has a number per segment [m], spaces between."""
        _, *others = SweepRow(1.0, None, None, "").as_dict()
        rows = []
        for row in self.rows:
            fields = row.as_dict()
            radii = " ".join(repr(value) for value in fields["radii"] or ())
            rows.append({**fields, "radii": radii}.values())
        return csv_text([self.quantity, *others], rows)


def sweep(
    problem: PlanningProblem,
    radii: Sequence[float] | None = None,
    *,
    scales: Sequence[float] | None = None,
    options: PlanOptions | None = None,
    executor: Executor | None = None,
    progress: Callable[[object], None] | None = None,
) -> SweepResult:
    """Plan a problem at several tolerances, each from scratch.

    Args:
        problem: The planning problem; its radii are replaced.
        radii: Path tolerances, each for all segments [m]; either these or `scales`.
        scales: Factors for the problem's own radii and boxes.
        options: Planning options.
        executor: As for `sweep_field`.
        progress: As for `sweep_field`.

    Returns:
        A row for every tolerance, the narrowest first. A tolerance that cannot be planned has the
        reason in its row. After Ctrl-C, the finished rows.

    Raises:
        ProblemError: The problem is no `PlanningProblem`, or has boxes, for which radii are no
            tolerances.
        OptionError: Not exactly one of radii and scales is given, one is no positive number, or an
            argument is of another kind.
        KeyboardInterrupt: Ctrl-C before the first tolerance was done.
    """
    PlanningProblem.require(problem)
    if (radii is None) == (scales is None):
        raise OptionError("sweep takes either radii or scales")
    if scales is None:
        remedy = "sweep over factors (scales, --radius-scale), which scale its width and height"
        problem.tube.require_discs("a sweep over radii", remedy)
    quantity, requested = ("radius", radii) if scales is None else ("radius_scale", scales)
    values = checked_row(quantity, requested, "numbers")
    if not values:
        raise OptionError(f"{quantity}: give at least one number")
    for value in values:
        if not is_number(value) or not is_finite(value) or value <= 0:
            raise OptionError(f"{quantity} is {in_figures(value)}; it must be > 0 and finite")
    values = sorted({float(value) for value in values})
    work = partial(
        _tolerance_row, problem, quantity, checked_options(options, PlanOptions).shortest
    )
    label = f"tolerance {{}} of {len(values)}".format
    rows, stopped_by = swept_rows(work, values, label, executor, progress)
    for number, row in enumerate(rows):
        faster = [
            narrow
            for narrow in rows[:number]
            if narrow.duration is not None
            and row.duration is not None
            and narrow.duration < (1 - _SAME) * row.duration
        ]
        if faster:
            note = (
                f"another local optimum: the faster motion of {quantity} {faster[-1].value:g} "
                "stays in this tube too"
            )
            rows[number] = replace(row, note=note)
    return SweepResult(problem, quantity, tuple(rows), stopped_by)


def _tolerance_row(
    problem: PlanningProblem,
    quantity: str,
    options: PlanOptions,
    value: float,
    progress: Callable[[object], None] | None = None,
) -> SweepRow:
    tube = problem.tube
    try:
        changed = tube.with_radius(value) if quantity == "radius" else tube.scaled(value)
        spec = problem.with_tube(changed)
    except ProblemError as error:
        return SweepRow(value, None, None, str(error))
    result = plan(spec, options, progress)
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    elasticities = [_by_whole_radius(each, spec.tube) for each in result.sensitivities]
    # + 0.0: no minus in front of zero.
    elasticity = sum(elasticities) + 0.0 if elasticities else None
    return SweepRow(value, spec, result, result.message, elasticity)


def _by_whole_radius(sensitivity: Sensitivity, tube: Tube) -> float:
    """Return the elasticity by radius or side, tool radius included; zero for limits of joints."""
    if sensitivity.limit not in ("radius", *_SIDES) or sensitivity.segment is None:
        return 0.0
    k = tube.segment_index(sensitivity.segment)
    whole = tube.radius[k]
    if sensitivity.limit in _SIDES and tube.cross_section is not None:
        whole = tube.cross_section[k, _SIDES.index(sensitivity.limit)] / 2
    return float(sensitivity.elasticity * whole / (whole - tube.tool_radius))


# ---- Duration against any field of a problem file.


@dataclass(frozen=True, eq=False)
class FieldRow(_Row):
    """One value of the field, and the result of planning with it.

    Attributes:
        value: The value as given, such as 0.02, [0.02, 0.03] or "x0.5".
        result: The result of planning; None where the problem is invalid.
        message: One sentence: the answer, or the reason for its absence.
        loading_time: Time of reading the problem [s].
    """

    value: Any
    result: PlanResult | None
    message: str
    loading_time: float

    __repr__ = short_repr

    @property
    def shortest_duration(self) -> float | None:
        """Duration of the shortest certified trajectory [s]; None if there is none."""
        return None if self.result is None else self.result.shortest_duration

    @property
    def verdict(self) -> RunVerdict | None:
        """Verdict over the answer's simulated runs; None unless robustness requires runs."""
        survival = None if self.result is None else self.result.survival
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
        name: Name of the problem.
        path: Path of the field, such as "robot.payload.mass".
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
        """True if any value has a certified trajectory."""
        return any(row.duration is not None for row in self.rows)

    @property
    def is_simulated(self) -> bool:
        """True if any answer was executed in simulation."""
        return any(row.verdict is not None for row in self.rows)

    @property
    def varies_objective(self) -> bool:
        """True if the field is part of the objective, so that answers may not be the shortest."""
        return is_of_objective(self.path)

    def as_dict(self) -> dict[str, Any]:
        """Return the sweep as JSON values."""
        rows = [row.as_dict() for row in self.rows]
        report = {"problem": self.name, "quantity": self.path}
        return {**report, "stopped_by": self.stopped_by, "rows": rows}

    def csv(self) -> str:
        """Return the rows as CSV; lists and maps as JSON, notes with semicolons between."""
        _, *others = FieldRow(None, None, "", 0.0).as_dict()
        rows = []
        for row in self.rows:
            texts = {"value": value_text(row.value), "notes": "; ".join(row.notes)}
            rows.append({**row.as_dict(), **texts}.values())
        return csv_text([self.path, *others], rows)


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
        path: Path of the field, as for `load_problem`.
        values: Values of the field; "x0.5" scales every number there.
        changes: Values of other fields by path, set first.
        options: Planning options.
        executor: Any executor of `concurrent.futures`; None: this process, value by value.
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
    options = checked_options(options, PlanOptions)
    if not is_of_objective(path):
        options = options.shortest
    elif options.slack is not None:
        raise OptionError(f"{path} is varied and slack is given; leave out one of them")
    values = checked_row("values", values, f"what {path} is to be")
    if len(values) == 0:
        raise OptionError(f"{path}: give at least one value")
    if path in changes:
        raise OptionError(f"{path} is both varied and changed; leave out one of them")
    spec = ProblemSpec.read(problem)
    require_problem(spec.document, spec.name)
    levels = [Levels(path, values)]
    study = Study(spec.name, {spec.name: spec.changed(changes)}, levels, options=options)
    items = ((value, study.spec(point)) for value, point in zip(values, study.points, strict=True))
    label = f"value {{}} of {len(values)}".format
    rows, stopped_by = swept_rows(partial(_field_row, options), items, label, executor, progress)
    return FieldSweep(study.name, path, tuple(rows), stopped_by)


def _field_row(
    options: PlanOptions,
    item: tuple[Any, ProblemSpec],
    progress: Callable[[object], None] | None = None,
) -> FieldRow:
    """Return the row of a value, given with its problem; arguments as of `plan`."""
    value, spec = item
    begin = time.perf_counter()
    if progress is not None:
        progress("loading robot and collision geometry")
    try:
        problem = spec.load()
    except (ProblemError, RobotError) as error:
        reason = str(error).removeprefix(f"{spec.name}: ")
        return FieldRow(value, None, reason, time.perf_counter() - begin)
    loading_time = time.perf_counter() - begin
    assert isinstance(problem, PlanningProblem)
    result = plan(problem, options, progress)
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    return FieldRow(value, result, result.message, loading_time)
