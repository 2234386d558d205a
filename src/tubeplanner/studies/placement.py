"""Place: grid and pattern search for the base pose of the shortest motion.

The compass search of Hooke and Jeeves' family: Kolda, Lewis and Torczon, SIAM Review 45 (2003).
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
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
from tubeplanner.errors import OptionError, unknown_name
from tubeplanner.outcome import StoppedBy, require_callback
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.strategy import plan
from tubeplanner.studies.base_regions import (
    BasePlacement,
    MovableProblem,
    PlacementGrid,
    Region,
)
from tubeplanner.studies.journal import Journal
from tubeplanner.studies.placement_rows import (
    GivenPlacement,
    Placement,
    PlacementRow,
    PlacementTrials,
)
from tubeplanner.studies.problem_spec import ProblemSpec
from tubeplanner.studies.worker_processes import WorkerProcesses

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
    with nullcontext() if path is None else Journal(path) as answers:
        # In steps of a period, durations have plateaus on which no search finds its way.
        spec = movable.spec if loaded.period is None else movable.spec.changed({"period": None})
        trials = PlacementTrials(replace(movable, spec=spec), on, answers)
        stopped_by = _searched(trials, bounds, grid, movable.given, executor, report)
    result = Placement(
        loaded, bounds, on, grid, trials.rows, as_given, None, None, {}, trials.restored, stopped_by
    )
    if stopped_by is None:  # after Ctrl-C no report: the caller may stop at one again
        report("planning the best")
    refusal = ""
    for row in _feasible(result.rows)[:_STARTS]:  # the next where the best fails
        best = movable.load(row.base_placement, row.seeds)
        answer = plan(best, options.plan_options)
        refusal = refusal or answer.message
        if answer.succeeded:
            values = movable.changes(row.base_placement, row.seeds)
            return replace(result, problem=best, best=row, result=answer, changes=values)
    return replace(result, refusal=refusal)


def _searched(
    trials: PlacementTrials,
    region: Region,
    grid: PlacementGrid,
    as_given: BasePlacement,
    executor: Executor | None,
    report: Callable[[object], None],
) -> StoppedBy | None:
    """Try the grid, the base pose as given and a pattern search; "interrupt" after Ctrl-C."""
    base_placements = [*grid.base_placements, *[region.nearest(as_given)] * region.holds(as_given)]
    try:
        # Inside: Ctrl-C goes through it, which ends the processes.
        with WorkerProcesses() if executor is None else nullcontext(executor) as workers:

            def rows_of(base_placements: Sequence[BasePlacement], stage: str) -> list[PlacementRow]:
                return trials.of(
                    base_placements, workers, lambda k, n: report(f"{stage}: {k} of {n} stands")
                )

            starts = _starts(rows_of(base_placements, "grid"))
            pattern_search(
                [(row.base_placement, _value(row)) for row in starts],
                partial(_neighbours, region, grid),
                lambda base_placements: [
                    _value(row) for row in rows_of(base_placements, "pattern search")
                ],
                _HALVINGS,
            )
    except KeyboardInterrupt:
        if not trials.rows:
            raise
        return "interrupt"
    return None


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
