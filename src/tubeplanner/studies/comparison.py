"""Compare: one problem by every method and baseline; smoothness, use of motors and tube."""

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from tubeplanner.certificate.judged_motion import JudgedCondition
from tubeplanner.certificate.refusal import refusal
from tubeplanner.certificate.verification import Certificate
from tubeplanner.checks import checked_options, checked_row
from tubeplanner.errors import OptionError, TubePlannerError, unknown_name
from tubeplanner.first_guess.baselines import BASELINES, judged_baseline
from tubeplanner.limits.lower_bound import LowerBound, lower_bound
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.limits.process_stretches import stretch_runs
from tubeplanner.limits.speed_limits import largest_use, speed_limits
from tubeplanner.limits.tube_membership import current_segments, tube_use
from tubeplanner.outcome import Infeasible, PlanStatus, StoppedBy
from tubeplanner.planning.options import METHODS, PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.studies.rows import RowRun, RowTable, Variant, columns, finished_plan, rows_csv
from tubeplanner.task.motion import MotionSection
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.polynomials import peak_magnitudes

# ---- Measures of trajectories: smoothness, jerk, use of the limits and of the tube.

AT_LIMIT = 0.99  # of a limit: from this use on a motor counts as at its limit
_SAMPLES = 2000  # in the middles of equal times
_SAME = 1e-6  # jumps below this fraction of a joint's largest value are rounding errors
_STILL = 1e-6  # a joint with less than this fraction of the largest value of all does not move


@dataclass(frozen=True)
class TrajectoryMeasures:
    """Measures of a trajectory.

    Attributes:
        smoothness: "C2": position, velocity and acceleration are continuous, also at the ends,
            where the arm rests; "C1": the acceleration jumps; "C0": the velocity does; "none".
        peak_jerk: The largest magnitude of any joint's third derivative [rad/s^3 or m/s^3]; None
            where the acceleration jumps: there is no bound.
        peak_jerk_joint: Its joint; None where `peak_jerk` is.
        at_limit: Fraction of the time in which some limit on the speed other than jerk, such as a
            joint's effort, velocity or acceleration, is used by 99 % or more.
        tube_use: Distance of the tool from the axis of its segment over that segment's radius,
            averaged over time.
        in_band: Share of the length of all stretches with a speed band in which the tool's speed
            is in its band; None without a band.
    """

    smoothness: str
    peak_jerk: float | None
    peak_jerk_joint: str | None
    at_limit: float
    tube_use: float
    in_band: float | None = None

    __repr__ = short_repr

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)


def trajectory_measures(
    problem: PlanningProblem, trajectory: JointTrajectory
) -> TrajectoryMeasures:
    """Measure a trajectory.

    Smoothness and jerk are those of the polynomials, for all t; fractions of time are counted at
    2,000 instants.

    Args:
        problem: The planning problem.
        trajectory: The motion of the problem's joints, in any order.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    smoothness = smoothness_class(trajectory)
    peak = joint = None
    if smoothness == "C2":
        peaks = peak_magnitudes(trajectory.derivative_coefficients(3), trajectory.widths).value
        fastest = int(peaks.argmax())
        peak, joint = float(peaks[fastest]), trajectory.joint_names[fastest]
    middles = (np.arange(_SAMPLES) + 0.5) / _SAMPLES * trajectory.duration
    samples = trajectory.at(middles)
    tool = problem.robot.tool_position(samples.position)
    segment = current_segments(problem, trajectory, samples)
    values = np.stack([samples.position, samples.velocity, samples.acceleration])
    path = PathSamples(problem, values, lambda: segment)
    limits = tuple(limit for limit in speed_limits(problem) if limit.order < 3)  # all but jerk
    runs = stretch_runs([MotionSection(problem, trajectory)])
    lengths = [run.length for run in runs]
    inside = sum(run.in_band * run.length for run in runs)
    return TrajectoryMeasures(
        smoothness,
        peak,
        joint,
        float((largest_use(path, limits) >= AT_LIMIT).mean()),
        float(tube_use(problem, tool, segment).mean()),
        inside / sum(lengths) if runs and sum(lengths) > 0 else None,
    )


def smoothness_class(trajectory: JointTrajectory) -> str:
    """Return the number of continuous derivatives: "C2", "C1", "C0" or "none".

    Jumps are measured between neighbouring pieces and, of velocity and acceleration, against the
    rest before the start and after the end; those below 1e-6 of a joint's largest value are
    rounding errors.
    """
    ends = trajectory.per_piece(2)
    rows = (ends.position, ends.velocity, ends.acceleration)
    largest = [abs(row).max(axis=0) for row in rows]
    for order, (values, most) in enumerate(zip(rows, largest, strict=True)):
        jumps = abs(values[2::2] - values[1:-1:2])
        if order > 0:
            jumps = np.vstack([jumps, abs(values[[0, -1]])])
        allowed = _SAME * np.maximum(most, _STILL * max(float(most.max()), 1e-300))
        if (jumps > allowed).any():
            return ("none", "C0", "C1")[order]
    return "C2"


# ---- Comparison: one problem by every method and baseline, with certificates.

_NO_MEASURES = {name: None for name in TrajectoryMeasures.__dataclass_fields__}


@dataclass(frozen=True, eq=False)
class ComparisonRow:
    """The result of one method or baseline.

    Attributes:
        method: Its name: one of `METHODS` or `BASELINES`.
        status: Success if there is a certified trajectory; certificate_failed if it failed its
            certificate.
        message: One sentence: notes on the trajectory, or the reason for its absence.
        planning_time: Wall time, the certificate included [s].
        trajectory: The trajectory; of a baseline also one that failed its certificate.
        certificate: Certificate of the trajectory, or of the best attempt; None if there was none.
        measures: Measures of the trajectory; None if there is none.
        answered_by: The method of the trajectory, where the requested method had no better one;
            None: `method`.
    """

    method: str
    status: PlanStatus
    message: str
    planning_time: float
    trajectory: JointTrajectory | None = None
    certificate: Certificate | None = None
    measures: TrajectoryMeasures | None = None
    answered_by: str | None = None

    __repr__ = short_repr

    @property
    def certified(self) -> bool:
        """True if there is a trajectory that passed its certificate."""
        return self.status is PlanStatus.SUCCESS

    @property
    def duration(self) -> float | None:
        """Duration of the trajectory [s], certified or not; None if there is none."""
        return None if self.trajectory is None else self.trajectory.duration

    @property
    def failures(self) -> dict[str, JudgedCondition]:
        """The conditions that the trajectory fails, by name."""
        if self.trajectory is None or self.certificate is None:
            return {}
        return {name: self.certificate.conditions[name] for name in self.certificate.failures()}

    @property
    def kind(self) -> str:
        """Kind of the method, "baseline" or "method"."""
        return "baseline" if self.method in BASELINES else "method"

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        first = "method", "kind", "status", "certified", "answered_by", "duration", "planning_time"
        failures = {
            name: {"margin": each.margin, "unit": each.unit, "where": each.where.as_dict()}
            for name, each in self.failures.items()
        }
        measures = _NO_MEASURES if self.measures is None else self.measures.as_dict()
        return {**columns(self, first), "failures": failures, **measures, "message": self.message}


@dataclass(frozen=True, eq=False)
class Comparison(RowTable):
    """The results of several methods on one problem.

    Attributes:
        problem: The planning problem.
        rows: One per method, in the requested order.
        stopped_by: "interrupt" if Ctrl-C came before the other methods; None otherwise.
    """

    problem: PlanningProblem
    rows: tuple[ComparisonRow, ...]
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    @property
    def succeeded(self) -> bool:
        """True if any method has a certified trajectory."""
        return any(row.certified for row in self.rows)

    @cached_property
    def bound(self) -> LowerBound:
        """Lower bound on the duration of all motions of the problem."""
        return lower_bound(self.problem)

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as JSON values."""
        return self.table(problem=self.problem.name, bound=asdict(self.bound))

    def csv(self) -> str:
        """Return the rows as CSV; `failures` has NAME=MARGIN, spaces between them."""

        def texts(row: ComparisonRow) -> dict[str, str]:
            failures = row.failures.items()
            return {"failures": " ".join(f"{name}={each.margin!r}" for name, each in failures)}

        return rows_csv(self.rows, texts)


def compare(
    problem: PlanningProblem,
    methods: Sequence[str] | None = None,
    *,
    options: PlanOptions | None = None,
    progress: Callable[[object], None] | None = None,
) -> Comparison:
    """Plan the same problem with several methods and baselines.

    Args:
        problem: The planning problem.
        methods: Names from `METHODS` and `BASELINES`; default: all of both.
        options: Planning options of the methods, but for `method`.
        progress: Called with a `StudyProgress`, whose stage names the method.

    Returns:
        A row for every method. A method without an answer gives the reason; it never stops the
        others. After Ctrl-C, the finished rows.

    Raises:
        ProblemError: The problem is no `PlanningProblem`.
        OptionError: A name is unknown, there is none, or an argument is of another kind.
        KeyboardInterrupt: Ctrl-C before the first method was done.
    """
    PlanningProblem.require(problem)
    options = checked_options(options, PlanOptions).shortest
    names = [*METHODS, *BASELINES]
    requested = names if methods is None else checked_row("methods", methods, "names")
    for name in requested:
        if not isinstance(name, str) or name not in names:
            raise OptionError(unknown_name("method", name, names))
    if not requested:
        raise OptionError("compare: give at least one method")
    with RowRun[ComparisonRow]("methods", None, progress, is_here=True) as run:
        work = partial(_row, problem, options=options, report=run.report)
        variants = [Variant(name, name) for name in dict.fromkeys(requested)]
        run.run(work, variants, len(variants))
    return Comparison(problem, tuple(run.rows.values()), run.stopped_by)


def _row(
    problem: PlanningProblem, name: str, options: PlanOptions, report: Callable[[object], None]
) -> ComparisonRow:
    begin = time.perf_counter()

    def announce(what: object) -> None:
        report(f"{name}: {what}")

    try:
        if name in BASELINES:
            baseline, certificate = judged_baseline(problem, name, announce)
            reason = refusal(problem, certificate)
            status = PlanStatus.SUCCESS if reason is None else reason.status
            spent = time.perf_counter() - begin
            motion = baseline.trajectory
            row = ComparisonRow(name, status, baseline.note, spent, motion, certificate)
        else:
            result = finished_plan(problem, replace(options, method=name, robust=False), announce)
            assert isinstance(result, PlanResult)
            other = result.method if result.succeeded and result.method != name else None
            message = result.message if other is None else f"answered by {other}; {result.message}"
            answer = (result.planning_time, result.trajectory, result.certificate)
            row = ComparisonRow(name, result.status, message, *answer, answered_by=other)
    except Infeasible as refused:
        row = ComparisonRow(name, refused.status, str(refused), time.perf_counter() - begin)
    except Exception as error:  # of any kind: the other methods must still run
        is_expected = isinstance(error, TubePlannerError)
        message = str(error) if is_expected else f"internal error, {type(error).__name__}: {error}"
        spent = time.perf_counter() - begin
        row = ComparisonRow(name, PlanStatus.NO_TRAJECTORY, message, spent)
    if row.trajectory is None:
        return row
    announce("measures")
    return replace(row, measures=trajectory_measures(problem, row.trajectory))
