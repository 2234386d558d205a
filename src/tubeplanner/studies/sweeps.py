"""Sweeps: duration against tolerance, or against any field of a file.

Every value is planned from scratch, exactly as by `plan`: a start from the neighbour's trajectory
could end in another local optimum. Then, when all rows are there, each has the motion of a
neighbour if that is faster and passes the certificate of the row's own problem.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any

from tubeplanner.checks import checked_options, checked_row, in_figures, is_finite, is_number
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.outcome import PlanningClock, Progress, ProgressCallback, StoppedBy
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import CycleResult, PlanResult, certified_result
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.rows import (
    PlannedRow,
    Row,
    RowRun,
    RowTable,
    Variant,
    columns,
    finished_plan,
    rows_csv,
    run_many,
)
from tubeplanner.studies.study import Levels, Study
from tubeplanner.task.field_changes import is_of_objective, require_changes, require_path
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.problem_format import is_cycle, require_problem
from tubeplanner.text import short_repr, value_text

# ---- Rows, and the better motions of neighbours.

_SIDES = ("width", "height")  # of boxes, in the order of `Tube.cross_section`
_SAME = 1e-3  # durations nearer to each other (relative) do not differ


@dataclass(frozen=True, eq=False)
class SweepRow(Row):
    """One tolerance, and the result of planning with it.

    Attributes:
        value: The radius of all segments [m], or the factor of all radii and sides of boxes.
        problem: The problem with that tolerance; None where it is invalid.
        result: The result of planning; None where the problem is invalid.
        message: One sentence: the answer, or the reason for its absence.
        elasticity: d ln T / d ln radius (of boxes, width and height) of all segments together, from
            the sensitivities; None if not known, as of the motion of a narrower tolerance.
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

    @property
    def radii(self) -> list[float] | None:
        """The radii of all segments [m]; None where the problem is invalid."""
        return None if self.problem is None else self.problem.tube.radius.tolist()

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        answer = "status", "duration", "bound", "elasticity", "slope", "method", "planning_time"
        return columns(self, ("value", "radii", *answer, "message", "note"))


@dataclass(frozen=True, eq=False)
class FieldRow(Row):
    """One value of the field, and the result of planning with it.

    Attributes:
        value: The value as given, such as 0.02, [0.02, 0.03] or "x0.5".
        result: The result of planning; None where the problem is invalid.
        message: One sentence: the answer, or the reason for its absence.
        loading_time: Time of reading the problem [s].
    """

    value: Any
    result: PlanResult | CycleResult | None
    message: str
    loading_time: float

    __repr__ = short_repr

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        answer = "status", "duration", "shortest_duration", "bound", "runs", "runs_failed"
        more = "method", "planning_time", "loading_time", "message", "notes"
        return columns(self, ("value", *answer, *more))


def _take_better_motions(
    run: RowRun[Any],
    problems: Sequence[PlanningProblem | ProblemSpec | None],
    names: Sequence[str],
    options: PlanOptions,
    *,
    is_sorted: bool = False,
) -> None:
    """Give rows the motion of a neighbour that is faster and passes the certificate of the row.

    Motions go on from row to row until none passes: the result depends on the rows alone. With a
    slack, which makes durations longer, all rows stay as they are.

    Args:
        run: The run with all rows, named from 0.
        problems: Their problems; None where it is invalid.
        names: Words for their values.
        options: Their planning options.
        is_sorted: True if the narrowest tolerance is first: only wider ones take its motion.
    """
    planned: dict[int, SweepRow | FieldRow] = dict(run.rows)
    origins = {k: k for k, row in planned.items() if isinstance(row.result, PlanResult)}
    pairs = list(pairwise(origins)) if options.slack == 0 else []
    pairs += [] if is_sorted else [(target, source) for source, target in pairs]
    durations = {k: row.duration or inf for k, row in planned.items()}
    tried: set[tuple[int, int]] = set()
    while True:
        sources: dict[int, int] = {}  # of the fastest motion, by the row that it may be for
        for source, target in pairs:
            limit = (1 - _SAME) * durations[sources.get(target, target)]
            if durations[source] < limit and (origins[source], target) not in tried:
                sources[target] = source
        if not sources:
            return
        tried |= {(origins[source], target) for target, source in sources.items()}
        calls = [(problems[target], run.rows[source].result) for target, source in sources.items()]
        former = dict(origins)
        for done in run_many(partial(_judged, options), calls, run.executor):
            run.report("certificates of neighbours' motions")
            if done.error is not None:
                raise done.error
            if done.value is None:
                continue
            target = list(sources)[done.index]
            row, origins[target] = planned[target], former[sources[target]]
            durations[target] = done.value.duration or inf
            own = f"the {row.duration:.4f} s" if row.duration else f"none, but {row.status},"
            note = (
                f"the motion of {names[origins[target]]}, which is faster than {own} planned here"
            )
            values: dict[str, Any] = {"message": done.value.message}
            if isinstance(row, SweepRow):
                values |= {"elasticity": None, "note": note}
            time_spent = (row.planning_time or 0.0) + done.value.certificate_time
            notes = (*done.value.notes, note)
            values["result"] = replace(done.value, planning_time=time_spent, notes=notes)
            run.replace(target, replace(row, **values))


def _judged(
    options: PlanOptions, call: tuple[PlanningProblem | ProblemSpec, PlanResult]
) -> PlanResult | None:
    """Return the result of a motion for another problem; None if it is none there."""
    problem, result = call
    loaded = problem.load() if isinstance(problem, ProblemSpec) else problem
    trajectory = result.trajectory
    if not isinstance(loaded, PlanningProblem) or trajectory is None:
        return None
    if options.robust and loaded.robustness is not None:  # only a simulation knows
        return None
    if set(trajectory.joint_names) != set(loaded.robot.joint_names):
        return None
    judged = certified_result(loaded, trajectory, result.method, PlanningClock(None, None))
    return replace(judged, bound=lower_bound(loaded)) if judged.succeeded else None


# ---- Duration against tolerance: one problem planned at several radii.


@dataclass(frozen=True, eq=False)
class SweepResult(RowTable):
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

    def as_dict(self) -> dict[str, Any]:
        """Return the sweep as JSON values."""
        return self.table(problem=self.problem.name, quantity=self.quantity)

    def csv(self) -> str:
        """Return the rows as CSV; `radii` has a number per segment [m], spaces between."""

        def texts(row: SweepRow) -> dict[str, str]:
            return {"radii": " ".join(map(repr, row.radii or ()))}

        return rows_csv(self.rows, texts, value=self.quantity)


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

    Where the motion of a narrower tolerance is faster, and passes the certificate of the wider
    tube, it is the answer there, and the row's note says so. This is not done with a slack or with
    robustness.

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
    options = checked_options(options, PlanOptions).shortest
    with RowRun[SweepRow]("tolerances", executor, progress, is_here=True) as run:
        here = run.report if executor is None else None
        work = partial(_tolerance_row, problem, quantity, options, here)
        run.run(work, (Variant(*each) for each in enumerate(values)), len(values))
        names = [f"{quantity} {value:g}" for value in values]
        problems = [row.problem for row in run.rows.values()]
        _take_better_motions(run, problems, names, options, is_sorted=True)
    return SweepResult(problem, quantity, tuple(run.rows.values()), run.stopped_by)


def _tolerance_row(
    problem: PlanningProblem,
    quantity: str,
    options: PlanOptions,
    progress: ProgressCallback | None,
    value: float,
) -> SweepRow:
    tube = problem.tube
    try:
        changed = tube.with_radius(value) if quantity == "radius" else tube.scaled(value)
        spec = problem.with_tube(changed)
    except ProblemError as error:
        return SweepRow(value, None, None, str(error))
    result = finished_plan(spec, options, progress)
    assert isinstance(result, PlanResult)
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
class FieldSweep(RowTable):
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
    def is_simulated(self) -> bool:
        """True if any answer was executed in simulation."""
        return any(row.verdict is not None for row in self.rows)

    @property
    def varies_objective(self) -> bool:
        """True if the field is part of the objective, so that answers may not be the shortest."""
        return is_of_objective(self.path)

    def as_dict(self) -> dict[str, Any]:
        """Return the sweep as JSON values."""
        return self.table(problem=self.name, quantity=self.path)

    def csv(self) -> str:
        """Return the rows as CSV; lists and maps as JSON, notes with semicolons between."""

        def texts(row: FieldRow) -> dict[str, str]:
            return {"value": value_text(row.value), "notes": "; ".join(row.notes)}

        return rows_csv(self.rows, texts, value=self.path)


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

    Where the motion of a neighbouring value is faster, and passes the certificate of the row's own
    problem, it is the row's answer, and a note says so. This is not done with a slack, with
    robustness, for the field `period`, or for cycles.

    Answers are the shortest motions, unless a slack is given or the field is of the objective.

    Args:
        problem: A path of a problem or cycle, or `example:ROBOT/NAME` for a bundled one.
        path: Path of the field, as for `load_problem`.
        values: Values of the field; "x0.5" scales every number there.
        changes: Values of other fields by path, set first.
        options: Planning options.
        executor: Any executor of `concurrent.futures`; None: this process, value by value.
        progress: Called with a `StudyProgress`, which has the stage of the plan in this process.

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
    if not is_cycle(spec.document):
        require_problem(spec.document, spec.name)
    levels = [Levels(path, values)]
    study = Study(spec.name, {spec.name: spec.changed(changes)}, levels, options=options)
    specs = [study.spec(point) for point in study.points]
    with RowRun[FieldRow]("values", executor, progress, is_here=True) as run:
        here = run.report if executor is None else None
        items = enumerate(zip(values, specs, strict=True))
        work = partial(_field_row, options, here)
        run.run(work, (Variant(*each) for each in items), len(values))
        if path != "period":  # a motion has the period that it was planned with
            names = [f"{path} {value_text(value)}" for value in values]
            _take_better_motions(run, specs, names, options)
    return FieldSweep(study.name, path, tuple(run.rows.values()), run.stopped_by)


def _field_row(
    options: PlanOptions, progress: ProgressCallback | None, item: tuple[Any, ProblemSpec]
) -> FieldRow:
    """Return the row of a value, given with its problem."""
    value, spec = item
    begin = time.perf_counter()
    if progress is not None:
        progress(Progress("loading robot and collision geometry"))
    row = PlannedRow.of(spec, options, progress, raises_options=True)
    spent = time.perf_counter() - begin
    loading_time = spent if row.loading_time is None else row.loading_time
    return FieldRow(value, row.result, row.message, loading_time)
