"""The duration against the tolerance: one problem planned at several radii.

Every radius is planned from scratch, exactly as by `plan`: a start from the neighbour's trajectory
could end in another local optimum, and a row must not depend on its neighbours.
"""

import csv
import io
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from tubeplanner.arguments import given_options, given_row
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.options import in_figures, is_finite, is_number
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning.plan_options import PlanOptions
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.planning.planner import plan
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import StoppedBy
from tubeplanner.refinement.sensitivities import Sensitivity
from tubeplanner.short_repr import short_repr
from tubeplanner.studies.formula_cells import without_formulas
from tubeplanner.studies.swept_rows import swept_rows
from tubeplanner.tube.tube import Tube

_SIDES = ("width", "height")  # of boxes, in the order of `Tube.cross_section`
_SAME = 1e-3  # durations nearer to each other (relative) do not differ


@dataclass(frozen=True, eq=False)
class SweepRow:
    """One tolerance, and the result of planning with it.

    Attributes:
        value: The radius of all segments [m], or the factor by which all radii, and the sides of
            boxes, are scaled.
        problem: The problem with that tolerance; None where it cannot be posed.
        result: The result of planning; None where the problem cannot be posed.
        message: One sentence: the answer, or why there is none.
        elasticity: d ln T / d ln radius (of boxes, width and height) of all segments together, from
            the sensitivities: the share
            by which the duration falls, per share by which the tolerance grows; None if not known.
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
    def status(self) -> PlanStatus:
        """How planning ended; bad_input where the problem cannot be posed."""
        return PlanStatus.BAD_INPUT if self.result is None else self.result.status

    @property
    def duration(self) -> float | None:
        """Duration of the certified trajectory [s]; None if there is none."""
        return None if self.result is None else self.result.duration

    @property
    def slope(self) -> float | None:
        """The change of the duration per unit of `value` [s/m, or s]; None if not known."""
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
        """Whether any tolerance has a certified trajectory."""
        return any(row.duration is not None for row in self.rows)

    def as_dict(self) -> dict[str, Any]:
        """Return the sweep as JSON values."""
        rows = [row.as_dict() for row in self.rows]
        report = {"problem": self.problem.name, "quantity": self.quantity}
        return {**report, "stopped_by": self.stopped_by, "rows": rows}

    def csv(self) -> str:
        """Return the rows as CSV; `radii` has one number per segment [m], spaces between them."""
        stream = io.StringIO()
        first, *others = SweepRow(1.0, None, None, "").as_dict()
        writer = csv.DictWriter(stream, [self.quantity, *others], lineterminator="\n")
        writer.writeheader()
        for row in self.rows:
            fields = row.as_dict()
            radii = " ".join(repr(value) for value in fields["radii"] or ())
            value = fields.pop(first)
            writer.writerow({self.quantity: value, **fields, "radii": radii})
        return without_formulas(stream.getvalue())


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
        problem: The planning problem, but for the radii.
        radii: Path tolerances, each for all segments [m]; either these or `scales`.
        scales: Factors for the problem's own radii and boxes.
        options: How to plan.
        executor: As for `sweep_field`.
        progress: Likewise.

    Returns:
        A row for every tolerance, the narrowest first. A tolerance that cannot be planned has the
        reason in its row. After Ctrl-C, the finished rows.

    Raises:
        ProblemError: The problem is none, or has boxes, for which radii are no tolerances.
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
    quantity, given = ("radius", radii) if scales is None else ("radius_scale", scales)
    values = _values(quantity, given)
    work = partial(_row, problem, quantity, given_options(options, PlanOptions).shortest)
    called = f"tolerance {{}} of {len(values)}".format
    rows, stopped_by = swept_rows(work, values, called, executor, progress)
    return SweepResult(problem, quantity, _noted(quantity, rows), stopped_by)


def _values(quantity: str, given: object) -> list[float]:
    values = given_row(quantity, given, "numbers")
    if not values:
        raise OptionError(f"{quantity}: give at least one number")
    for value in values:
        if not is_number(value) or not is_finite(value) or value <= 0:
            raise OptionError(f"{quantity} is {in_figures(value)}; it must be > 0 and finite")
    return sorted({float(value) for value in values})


def _row(
    problem: PlanningProblem,
    quantity: str,
    options: PlanOptions,
    value: float,
    progress: Callable[[object], None] | None = None,
) -> SweepRow:
    tube = problem.tube
    try:
        other = tube.with_radius(value) if quantity == "radius" else tube.scaled(value)
        posed = problem.with_tube(other)
    except ProblemError as error:
        return SweepRow(value, None, None, str(error))
    result = plan(posed, options, progress)
    if result.stopped_by == "interrupt":
        raise KeyboardInterrupt
    elasticities = [
        _by_whole_radius(sensitivity, posed.tube) for sensitivity in result.sensitivities
    ]
    elasticity = (
        sum(elasticities) + 0.0 if elasticities else None
    )  # + 0.0: no minus in front of zero
    return SweepRow(value, posed, result, result.message, elasticity)


def _noted(quantity: str, rows: Sequence[SweepRow]) -> tuple[SweepRow, ...]:
    """Return rows, the narrowest first, with notes where a narrower one is faster."""
    noted = []
    for number, row in enumerate(rows):
        faster = [each for each in rows[:number] if _is_faster(each, row)]
        note = None
        if faster:
            note = (
                f"slower than that at {quantity} {faster[-1].value:g}, which keeps to this tube "
                "too: another local optimum"
            )
        noted.append(replace(row, note=note))
    return tuple(noted)


def _by_whole_radius(sensitivity: Sensitivity, tube: Tube) -> float:
    """Return an elasticity by the radius or side, tool radius included; nothing for joints."""
    if sensitivity.limit not in ("radius", *_SIDES) or sensitivity.segment is None:
        return 0.0
    k = tube.segment_index(sensitivity.segment)
    whole = tube.radius[k]
    if sensitivity.limit in _SIDES and tube.cross_section is not None:
        whole = tube.cross_section[k, _SIDES.index(sensitivity.limit)] / 2
    return float(sensitivity.elasticity * whole / (whole - tube.tool_radius))


def _is_faster(narrow: SweepRow, wide: SweepRow) -> bool:
    if narrow.duration is None or wide.duration is None:
        return False
    return narrow.duration < (1 - _SAME) * wide.duration
