"""Place: grid and pattern search for the base pose of the shortest motion.

The compass search of Hooke and Jeeves' family: Kolda, Lewis and Torczon, SIAM Review 45 (2003).
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import inf
from pathlib import Path
from typing import Any, Generic, TypeVar

from tubeplanner.checks import (
    checked_options,
    checked_path,
    checked_row,
    require_count,
    require_executor,
)
from tubeplanner.errors import FormerName, OptionError, ProblemError, TubePlannerError, unknown_name
from tubeplanner.outcome import Infeasible, Location, PlanStatus, StoppedBy, require_callback
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.result import PlanResult
from tubeplanner.planning.strategy import plan
from tubeplanner.studies.base_regions import (
    BasePlacement,
    MovableProblem,
    PlacementGrid,
    Region,
    leading_seeds,
    require_base_free,
)
from tubeplanner.studies.journal import require_fields
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.rows import RowRun, Variant, columns
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.text import short_repr

# ---- Rows: one for every base pose tried.

BASE_IN_OBSTACLE = "base_in_obstacle"
# The kinds of answers, from the earliest failure of a plan to success.
KINDS = (
    *(PlanStatus.CRASHED, PlanStatus.BAD_INPUT, BASE_IN_OBSTACLE, PlanStatus.UNREACHABLE),
    *(PlanStatus.GRAVITY_EXCEEDS_EFFORT, PlanStatus.TUBE_BLOCKED, PlanStatus.NO_TRAJECTORY),
    *(PlanStatus.CERTIFICATE_FAILED, PlanStatus.SUCCESS),
)


@dataclass(frozen=True, eq=False)
class PlacementRow:
    """One base pose of the robot, and the answer of planning with it.

    Attributes:
        base_placement: Base pose.
        status: "base_in_obstacle", or the status of the plan, as of `PlanResult`.
        message: One sentence: the answer, or the reason for its absence.
        location: Location of the failure; empty without one.
        duration: Duration of the shortest certified motion with quality "fast" [s]; None if there
            is none.
        seeds: Seeds of start and goal, where the given joints lead to no collision-free
            configuration.
    """

    base_placement: BasePlacement
    status: str
    message: str
    location: Location = field(default_factory=Location)
    duration: float | None = None
    seeds: Mapping[str, Sequence[float]] = field(default_factory=dict)

    __repr__ = short_repr

    place = FormerName("location")
    stand = FormerName("base_placement")

    @property
    def is_feasible(self) -> bool:
        """True if there is a certified motion."""
        return self.duration is not None

    @property
    def reason(self) -> str:
        """The reason for the failure without numbers, the same for many base poses."""
        words = str(self.status).replace("_", " ")
        at = self.location
        if at.links and at.obstacle is not None:
            between = "in" if self.status == BASE_IN_OBSTACLE else "and"
            return f"{words}: '{at.links[0]}' {between} '{at.obstacle}'"
        if at.links:
            return f"{words}: {' and '.join(map(repr, at.links))}"
        if at.joint is not None:
            return f"{words}: {at.joint}"
        return words if at.segment is None else f"{words}: segment {at.segment}"

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        return {
            **self.base_placement.as_dict(),
            **columns(self, ("status", "message")),
            "where": self.location.as_dict(),
            **columns(self, ("duration", "seeds")),
        }

    @classmethod
    def of_dict(cls, fields: Mapping[str, Any]) -> "PlacementRow":
        """Return the row of values from `as_dict`.

        Raises:
            KeyError: A value is missing.
            ValueError: A value is unknown, or of another type.
        """
        location = Location.of_dict(fields["where"])
        x, y, z = fields["position"]
        names = {"position": "base_placement", "where": "location"}
        plain = {names.get(key, key): value for key, value in fields.items() if key != "yaw"}
        require_fields(cls, {**plain, "base_placement": [x, y, z, fields["yaw"]]})
        return cls(
            BasePlacement(x, y, z, fields["yaw"]),
            fields["status"],
            fields["message"],
            location,
            fields["duration"],
            fields["seeds"],
        )


def tried(call: tuple[MovableProblem, BasePlacement, Sequence[str], PlanOptions]) -> PlacementRow:
    """Return the row of a base pose.

    Args:
        call: The problem, the base pose, names of obstacles that links which no joint moves may
            touch, and planning options.
    """
    movable, base_placement, stands_on, options = call
    try:
        problem = movable.load(base_placement)
        try:
            require_base_free(problem, stands_on)
        except Infeasible as reason:
            return PlacementRow(base_placement, BASE_IN_OBSTACLE, str(reason), reason.location)
        seeds = leading_seeds(problem, tuple(movable.seeds))
        result = plan(movable.load(base_placement, seeds) if seeds else problem, options)
    except TubePlannerError as error:
        return PlacementRow(base_placement, str(PlanStatus.BAD_INPUT), str(error))
    status, duration = str(result.status), result.shortest_duration
    return PlacementRow(base_placement, status, result.message, result.location, duration, seeds)


def grouped(
    rows: Sequence[PlacementRow], key: Callable[[PlacementRow], str]
) -> list[tuple[str, list[PlacementRow]]]:
    """Return rows by a key, the largest group first."""
    groups: dict[str, list[PlacementRow]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return sorted(groups.items(), key=lambda pair: -len(pair[1]))


# ---- Results: what `place` returns.


@dataclass(frozen=True, eq=False)
class GivenPlacement:
    """The plan of the problem as given.

    Attributes:
        base_placement: Base pose.
        result: Result of planning; None where the problem is invalid or its base is in an obstacle.
        message: One sentence: the answer, or the reason for its absence.
    """

    base_placement: BasePlacement
    result: PlanResult | None
    message: str

    __repr__ = short_repr

    stand = FormerName("base_placement")

    @classmethod
    def of(
        cls, movable: MovableProblem, stands_on: Sequence[str], options: PlanOptions
    ) -> "GivenPlacement":
        """Plan a problem as given."""
        try:
            problem = movable.spec.load()
            assert isinstance(problem, PlanningProblem)
            require_base_free(problem, stands_on)
        except (ProblemError, Infeasible) as error:
            return cls(movable.given, None, str(error).removeprefix(f"{movable.spec.name}: "))
        result = plan(problem, options)
        return cls(movable.given, result, result.message)

    @property
    def duration(self) -> float | None:
        """Duration of the certified motion [s]; None if there is none."""
        return None if self.result is None else self.result.duration


@dataclass(frozen=True, eq=False)
class Placement:
    """The base pose of a robot with the shortest motion.

    Attributes:
        problem: The problem with the best base pose, or as given if there is none.
        region: Region of the base pose.
        stands_on: Names of obstacles that links which no joint moves may touch.
        grid: The base poses of the grid.
        rows: Rows of all base poses tried, those of the grid first.
        given: The plan of the problem as given.
        best: Row of the best base pose; None if no base pose has a motion.
        result: Result of planning there; None if there is none.
        changes: Values of the best base pose in the problem file, by field path, as `load_problem`
            takes them; empty if there is none.
        restored: Number of rows from the journal.
        stopped_by: "interrupt" if Ctrl-C ended the search; None otherwise.
        refusal: Message of the plan at the best base pose, if it failed; empty otherwise.
    """

    problem: PlanningProblem
    region: Region
    stands_on: tuple[str, ...]
    grid: PlacementGrid
    rows: tuple[PlacementRow, ...]
    given: GivenPlacement
    best: PlacementRow | None
    result: PlanResult | None
    changes: Mapping[str, Any]
    restored: int = 0
    stopped_by: StoppedBy | None = None
    refusal: str = ""

    def __repr__(self) -> str:
        answer = (
            "no stand has a motion" if self.best is None else f"best {self.best.base_placement}"
        )
        return (
            f"<Placement of {self.problem.name}: {len(self.rows)} base placements tried, {answer}>"
        )

    @property
    def succeeded(self) -> bool:
        """True if there is a base pose with a certified motion."""
        return self.result is not None

    @property
    def duration(self) -> float | None:
        """Duration of the motion at the best base pose [s]; None if there is none."""
        return None if self.result is None else self.result.duration

    @property
    def gain(self) -> float | None:
        """Fraction by which the shortest motion is shorter than as given; None without both."""
        results = self.given.result, self.result
        before, after = (None if r is None else r.shortest_duration for r in results)
        return None if before is None or after is None else 1 - after / before

    @property
    def feasible_count(self) -> int:
        """Number of base poses with a motion."""
        return sum(row.is_feasible for row in self.rows)

    @cached_property
    def reasons(self) -> tuple[tuple[str, int, str], ...]:
        """Reason, count and a message of the failures, the most frequent reason first."""
        others = [row for row in self.rows if not row.is_feasible]
        groups = grouped(others, lambda row: row.reason)
        return tuple((reason, len(rows), rows[0].message) for reason, rows in groups)

    @property
    def message(self) -> str:
        """The answer, or the reason for its absence, as a sentence."""
        if self.result is not None:
            return self.result.message
        if self.feasible_count:
            return (
                f"none of the {self.feasible_count} places that have a motion could be planned "
                f"once more; the best of them: {self.refusal}"
            )
        reason, count, example = self.reasons[0]
        return (
            f"no place of {len(self.rows)} has a motion; the most frequent reason, {count} times: "
            f"{reason} (such as: {example})"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the placement as JSON values."""
        keys = "reason", "count", "example"
        return {
            "problem": self.problem.name,
            "region": self.region.bounds,
            "stands_on": list(self.stands_on),
            "message": self.message,
            "duration": self.duration,
            "stopped_by": self.stopped_by,
            "given": {
                **self.given.base_placement.as_dict(),
                "duration": self.given.duration,
                "message": self.given.message,
            },
            "best": None if self.best is None else self.best.base_placement.as_dict(),
            "gain": self.gain,
            "changes": dict(self.changes),
            "tried": len(self.rows),
            "feasible": self.feasible_count,
            "restored": self.restored,
            "reasons": [dict(zip(keys, each, strict=True)) for each in self.reasons],
            "rows": [row.as_dict() for row in self.rows],
        }


# ---- Placement: a grid, then a pattern search from its best base poses.

_STARTS = 5  # of the pattern search
_HALVINGS = 3  # from half a cell of the grid to a sixteenth
_MAX_POINTS = 100_000


@dataclass(frozen=True)
class PlaceOptions:
    """Options of a placement.

    Attributes:
        points: Approximate number of base poses of the grid, angles and heights included: eight
            angles at each position, fewer if there are few poses, and three heights if the height
            may vary. With 300 the whole search plans about 500 times: some minutes on two
            processors for an arm that is planned in a second.
        quality: Quality of the plans of the problem as given and of the best base pose; the search
            has "fast".
        slack: Slack of the same plans; None: that of the problem's objective. The search is for the
            shortest motion, without the problem's period.
    """

    points: int = 300
    quality: str = "balanced"
    slack: float | None = None

    def __post_init__(self) -> None:
        require_count(self, 1, "points", most=_MAX_POINTS)
        _ = self.plan_options

    @property
    def plan_options(self) -> PlanOptions:
        """Options of the plans of the problem as given and of the best base pose."""
        return PlanOptions(quality=self.quality, slack=self.slack)


def place(
    problem: str | Path,
    region: Sequence[float],
    *,
    stands_on: Sequence[str] | None = None,
    changes: Mapping[str, Any] | None = None,
    options: PlaceOptions | None = None,
    executor: Executor | None = None,
    journal: str | Path | None = None,
    progress: Callable[[object], None] | None = None,
) -> Placement:
    """Return the base pose of a robot in its cell with the shortest motion.

    The tube and all else stays in the cell. Start and goal that are joints become seeds: the tool
    is then at the first or last point of the tube. Joint signs stay. Links that no joint moves are
    checked against obstacles. The result depends on no clock and on no order of work.

    Args:
        problem: A path, or `example:ROBOT/NAME` for a bundled problem.
        region: X0, X1, Y0, Y1 and perhaps Z0, Z1: bounds of the root link's origin in the cell [m].
            Without Z0, Z1 the height is as given. The angle about the vertical is free.
        stands_on: Names of obstacles that links which no joint moves may touch; required if there
            are obstacles: () if none may be touched.
        changes: Values of fields of the problem, by path, as for `load_problem`.
        options: Options of the placement.
        executor: Executor of the plans; None: as many `WorkerProcesses` as there are processors.
        journal: File that keeps every answer at once, and whose answers are used; None: none.
        progress: Called with the current stage.

    Returns:
        The best base pose and all that were tried; after Ctrl-C, those so far.

    Raises:
        ProblemError: The problem contradicts its format, or itself or its robot at any base pose.
        RobotError: The robot cannot be planned with.
        OptionError: The region is invalid, an obstacle's name is unknown or missing, or an argument
            is of another kind.
        OutputError: The journal cannot be used.
        KeyboardInterrupt: Ctrl-C before the first base pose was tried.
    """
    options, report = checked_options(options, PlaceOptions), progress or (lambda what: None)
    require_callback(report)
    require_executor(executor)
    path = None if journal is None else checked_path("journal", journal)
    stands_on = None if stands_on is None else checked_row("stands_on", stands_on, "names")
    report("loading robot and collision geometry")
    movable = MovableProblem.of(ProblemSpec.read(problem).changed(changes))
    bounds = Region.of(region, movable.given.z)
    loaded = movable.load(movable.given)
    names = [obstacle.name for obstacle in loaded.obstacles]
    if stands_on is None and names:
        raise OptionError(
            f"stands_on is required where there are obstacles ({', '.join(names)}): name what the "
            "robot stands on; --stands-on none, in Python (), if that is none of them"
        )
    for name in stands_on or ():
        if not isinstance(name, str) or name not in names:
            raise OptionError(f"stands_on: {unknown_name('obstacle', name, names)}")
    on = tuple(dict.fromkeys(stands_on or ()))
    report("planning as given")
    as_given = GivenPlacement.of(movable, on, options.plan_options)
    grid = bounds.grid(options.points, movable.given.yaw)
    # In steps of a period, durations have plateaus on which no search finds its way.
    spec = movable.spec if loaded.period is None else movable.spec.changed({"period": None})
    run = RowRun[PlacementRow](
        *("stands", executor, report),
        journal=path,
        plain=PlacementRow.as_dict,
        restore=PlacementRow.of_dict,
    )
    with run:
        rows_of = partial(_rows, run, replace(movable, spec=spec), on, path is not None)
        is_inside = bounds.holds(movable.given)
        starts = [*grid.base_placements, *[bounds.nearest(movable.given)] * is_inside]
        pattern_search(
            [(row.base_placement, _value(row)) for row in _starts(rows_of(starts, "grid"))],
            partial(_neighbours, bounds, grid),
            lambda base_placements: list(map(_value, rows_of(base_placements, "pattern search"))),
            _HALVINGS,
        )
    rows = tuple(run.rows.values())
    outcome = run.restored, run.stopped_by
    result = Placement(loaded, bounds, on, grid, rows, as_given, None, None, {}, *outcome)
    if run.stopped_by is None:  # after Ctrl-C no report: the caller may stop at one again
        report("planning the best")
    refusal = ""
    for row in _feasible(rows)[:_STARTS]:  # the next where the best fails
        best = movable.load(row.base_placement, row.seeds)
        answer = plan(best, options.plan_options)
        refusal = refusal or answer.message
        if answer.succeeded:
            values = movable.changes(row.base_placement, row.seeds)
            return replace(result, problem=best, best=row, result=answer, changes=values)
    return replace(result, refusal=refusal)


# The search compares shortest motions; robustness counts in the final plans alone.
SEARCH_OPTIONS = PlanOptions(quality="fast", slack=0.0, robust=False)


def _rows(
    run: RowRun[PlacementRow],
    problem: MovableProblem,
    stands_on: Sequence[str],
    has_journal: bool,
    base_placements: Sequence[BasePlacement],
    stage: str,
) -> list[PlacementRow]:
    """Return the rows of base poses, in their order; new base poses are tried."""
    stands_on = tuple(sorted(stands_on))

    def variant(base_placement: BasePlacement) -> Variant:
        key, values = None, {}
        if has_journal:  # the hash of all inputs of a row: the plan's, and `stands_on`
            planned = problem.at(base_placement).content_hash(SEARCH_OPTIONS)
            key = f"{planned} standing on {', '.join(stands_on) or 'nothing'}"
            base = problem.changes(base_placement)["robot.base"]
            values = {f"robot.base.{name}": value for name, value in base.items()}
        call = (problem, base_placement, stands_on, SEARCH_OPTIONS)
        return Variant(base_placement, call, key, values)

    def crashed(variant: Variant, error: Exception) -> PlacementRow:
        message = f"{type(error).__name__}: {error}"
        return PlacementRow(variant.argument[1], str(PlanStatus.CRASHED), message)

    former = run.rows
    new = [each for each in dict.fromkeys(base_placements) if each not in former]
    run.run(tried, map(variant, new), len(new), failed=crashed, stage=stage)
    rows = run.rows
    return [rows[base_placement] for base_placement in base_placements]


def _starts(rows: Sequence[PlacementRow]) -> list[PlacementRow]:
    """Return the best rows, different positions first.

    Arms whose first axis is vertical are as good at one position at nearly every angle.
    """
    best = _feasible(rows)
    first = {row.base_placement[:3]: row for row in reversed(best)}
    return sorted(best, key=lambda row: first[row.base_placement[:3]] is not row)[:_STARTS]


def _neighbours(
    region: Region, grid: PlacementGrid, base_placement: BasePlacement, fraction: float
) -> list[BasePlacement]:
    """Return the base poses half a cell of the grid times `fraction` away, in the region."""
    result = []
    for k, side in enumerate(grid.spacing):
        for step in (fraction * side / 2, -fraction * side / 2):
            neighbour = BasePlacement(
                *(value + step * (j == k) for j, value in enumerate(base_placement))
            )
            result.append(region.nearest(neighbour))
    return [each for each in dict.fromkeys(result) if each != base_placement]


def _feasible(rows: Sequence[PlacementRow]) -> list[PlacementRow]:
    """Return the rows with a motion, the shortest first."""
    return sorted((row for row in dict.fromkeys(rows) if row.is_feasible), key=_value)


def _value(row: PlacementRow) -> float:
    return inf if row.duration is None else row.duration


# ---- Pattern search: neighbours along the axes, in steps that halve; no derivative is needed.

_P = TypeVar("_P")
_MIN_GAIN = 1e-3  # of a value: smaller gains halve the steps


@dataclass
class _Walk(Generic[_P]):
    """One descent: its point, the value there, and the number of halvings of its steps."""

    point: _P
    value: float
    halved: int = 0


def pattern_search(
    starts: Sequence[tuple[_P, float]],
    neighbours: Callable[[_P, float], Sequence[_P]],
    values: Callable[[Sequence[_P]], Sequence[float]],
    halvings: int,
) -> list[tuple[_P, float]]:
    """Return the points at which descents from some starts end, and the values there.

    All descents go on side by side: the neighbours of all are evaluated together. The result does
    not depend on the order of evaluation.

    Args:
        starts: Points and their values.
        neighbours: Function from a point and a fraction of the first step to the points to try.
        values: Function from points to their values; infinity where there is none.
        halvings: Number of halvings of the steps.
    """
    walks = [_Walk(point, value) for point, value in starts]
    while active := [walk for walk in walks if walk.halved <= halvings]:
        tries = [list(neighbours(walk.point, 0.5**walk.halved)) for walk in active]
        results = iter(values([point for points in tries for point in points]))
        for walk, points in zip(active, tries, strict=True):
            neighbourhood = [(point, next(results)) for point in points]
            best = min(neighbourhood, key=lambda pair: pair[1], default=(walk.point, walk.value))
            if best[1] < walk.value * (1 - _MIN_GAIN):
                walk.point, walk.value = best
            else:
                walk.halved += 1
    return [(walk.point, walk.value) for walk in walks]
