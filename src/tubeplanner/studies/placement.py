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

from tubeplanner.checks import given_options, given_path, given_row, require_count, require_executor
from tubeplanner.errors import OptionError, ProblemError, unknown_name
from tubeplanner.outcome import Infeasible, StoppedBy, require_callback
from tubeplanner.planning.options import PlanOptions
from tubeplanner.planning.strategy import plan
from tubeplanner.studies.base_regions import (
    MovableProblem,
    Region,
    Stand,
    StandGrid,
    require_base_free,
)
from tubeplanner.studies.journal import Journal
from tubeplanner.studies.placement_rows import GivenStand, Placement, PlacementRow, PlacementTrials
from tubeplanner.studies.problem_spec import PosedProblem
from tubeplanner.studies.worker_processes import WorkerProcesses
from tubeplanner.task.problem import PlanningProblem

# ---- Downhill by trying neighbours along the axes, in steps that halve: no derivative is needed.

_P = TypeVar("_P")
_LEAST_GAIN = 1e-3  # of a value: less is no reason to go on with steps of one size


@dataclass
class _Walk(Generic[_P]):
    """One way downhill: where it is, the value there, and how often its steps were halved."""

    point: _P
    value: float
    halved: int = 0


def pattern_search(
    starts: Sequence[tuple[_P, float]],
    neighbours: Callable[[_P, float], Sequence[_P]],
    values: Callable[[Sequence[_P]], Sequence[float]],
    halvings: int,
) -> list[tuple[_P, float]]:
    """Return where ways downhill from some points end, and the values there.

    All ways go on side by side: the neighbours of all are valued together. What is found does not
    depend on the order in which that is done.

    Args:
        starts: Points and their values.
        neighbours: From a point and a share of the first step: the points to try.
        values: Of points, in their order; infinity where there is none.
        halvings: How often steps are halved.
    """
    walks = [_Walk(point, value) for point, value in starts]
    while active := [walk for walk in walks if walk.halved <= halvings]:
        tries = [list(neighbours(walk.point, 0.5**walk.halved)) for walk in active]
        found = iter(values([point for points in tries for point in points]))
        for walk, points in zip(active, tries, strict=True):
            _step(walk, [(point, next(found)) for point in points])
    return [(walk.point, walk.value) for walk in walks]


def _step(walk: _Walk[_P], tried: Sequence[tuple[_P, float]]) -> None:
    """Go to the best of the points that were tried, or halve the steps."""
    point, value = min(tried, key=lambda pair: pair[1], default=(walk.point, walk.value))
    if value < walk.value * (1 - _LEAST_GAIN):
        walk.point, walk.value = point, value
    else:
        walk.halved += 1


# ---- Where a robot is to stand so that its motion is short: a grid, then a pattern search.

_STARTS = 5  # of the pattern search
_HALVINGS = 3
_MOST_POINTS = 100_000


@dataclass(frozen=True)
class PlaceOptions:
    """How to look for a place.

    Attributes:
        points: About how many stands the grid has: eight angles at each place, three heights if
            they may vary. With 300 the whole search plans about 500 times: some minutes on two
            processors for an arm that is planned in a second.
        quality: Of the plans of the problem as given and of the best stand; the search has "fast".
        slack: Of the same plans; None: what the problem's objective says. The search is for the
            shortest motion.
    """

    points: int = 300
    quality: str = "balanced"
    slack: float | None = None

    def __post_init__(self) -> None:
        require_count(self, 1, "points", most=_MOST_POINTS)
        _ = self.plan_options

    @property
    def plan_options(self) -> PlanOptions:
        """How what is answered is planned."""
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
    """Look for the place of a robot in its cell at which its motion is shortest.

    The tube and all else stays in the cell. Start and goal that are joints become seeds: the tool
    is then at the first or last point of the tube. Joint signs stay. Links that no joint moves are
    checked against obstacles. What is found depends on no clock and on no order of work.

    Args:
        problem: A path, or `example:ROBOT/NAME` for a bundled problem.
        region: X0, X1, Y0, Y1 and perhaps Z0, Z1: where the root link's origin may be, in the cell
            [m]. Without Z0, Z1 the height is as given. About the vertical it may be turned at will.
        stands_on: Names of obstacles that links which no joint moves may touch; required if there
            are obstacles: () if it stands on none of them.
        changes: Of fields of the problem, by path, as for `load_problem`.
        options: How to look.
        executor: What plans; None: as many `WorkerProcesses` as there are processors.
        journal: File in which answers are kept as they come, and looked for first; None: none.
        progress: Called with what is being done.

    Returns:
        The best stand and all that were tried; after Ctrl-C, what was found until then.

    Raises:
        ProblemError: The problem contradicts its format, itself or its robot wherever it stands.
        RobotError: The robot cannot be planned with.
        OptionError: The region is none, an obstacle's name is unknown or missing, or an argument is
            of another kind.
        OutputError: The journal cannot be used.
        KeyboardInterrupt: Ctrl-C before the first stand was tried.
    """
    options, report = given_options(options, PlaceOptions), progress or (lambda what: None)
    require_callback(report)
    require_executor(executor)
    kept_in = None if journal is None else given_path("journal", journal)
    stands_on = None if stands_on is None else given_row("stands_on", stands_on, "names")
    report("loading robot and collision geometry")
    movable = MovableProblem.of(PosedProblem.read(problem).changed(changes))
    where = Region.of(region, movable.given.z)
    loaded = movable.load(movable.given)
    on = _names(loaded, stands_on)
    report("planning as given")
    given = _given(movable, on, options.plan_options)
    grid = where.grid(options.points, movable.given.yaw)
    with nullcontext() if kept_in is None else Journal(kept_in) as kept:
        trials = PlacementTrials(movable, on, kept)
        stopped_by = _searched(trials, where, grid, movable.given, executor, report)
    found = Placement(
        loaded, where, on, grid, trials.rows, given, None, None, {}, trials.restored, stopped_by
    )
    if stopped_by is None:  # else the caller may take a report for a place to stop at again
        report("planning the best")
    return _answered(found, movable, options.plan_options)


def _names(problem: PlanningProblem, given: Sequence[str] | None) -> tuple[str, ...]:
    """Return the names of the obstacles that the robot stands on, once they are some."""
    known = [obstacle.name for obstacle in problem.obstacles]
    if given is None and known:
        raise OptionError(
            f"stands_on is required where there are obstacles ({', '.join(known)}): name what the "
            "robot stands on; --stands-on none, in Python (), if that is none of them"
        )
    for name in given or ():
        if not isinstance(name, str) or name not in known:
            raise OptionError(f"stands_on: {unknown_name('obstacle', name, known)}")
    return tuple(dict.fromkeys(given or ()))


def _given(movable: MovableProblem, stands_on: Sequence[str], options: PlanOptions) -> GivenStand:
    """Return what comes of the problem as it is given."""
    try:
        problem = movable.posed.load()
        assert isinstance(problem, PlanningProblem)
        require_base_free(problem, stands_on)
    except (ProblemError, Infeasible) as error:
        return GivenStand(movable.given, None, str(error).removeprefix(f"{movable.posed.name}: "))
    result = plan(problem, options)
    return GivenStand(movable.given, result, result.message)


def _searched(
    trials: PlacementTrials,
    region: Region,
    grid: StandGrid,
    given: Stand,
    executor: Executor | None,
    report: Callable[[object], None],
) -> StoppedBy | None:
    """Try the grid, where the robot stands as given, and what a pattern search leads to.

    Returns:
        "interrupt" if Ctrl-C ended it; None otherwise.

    Raises:
        KeyboardInterrupt: Ctrl-C before the first stand was tried.
    """
    stands = [*grid.stands, *[region.nearest(given)] * region.holds(given)]
    try:
        # Inside: Ctrl-C goes through it, which ends the processes.
        with WorkerProcesses() if executor is None else nullcontext(executor) as workers:

            def rows_of(stands: Sequence[Stand], stage: str) -> list[PlacementRow]:
                return trials.of(
                    stands, workers, lambda k, n: report(f"{stage}: {k} of {n} stands")
                )

            starts = _starts(rows_of(stands, "grid"))
            pattern_search(
                [(row.stand, _value(row)) for row in starts],
                partial(_neighbours, region, grid),
                lambda stands: [_value(row) for row in rows_of(stands, "pattern search")],
                _HALVINGS,
            )
    except KeyboardInterrupt:
        if not trials.rows:
            raise
        return "interrupt"
    return None


def _starts(rows: Sequence[PlacementRow]) -> list[PlacementRow]:
    """Return the rows to go on from: the best, first those of different places.

    Arms that turn about the vertical themselves are as good at one place at nearly every angle.
    """
    best = _feasible(rows)
    first = {row.stand[:3]: row for row in reversed(best)}
    return sorted(best, key=lambda row: first[row.stand[:3]] is not row)[:_STARTS]


def _neighbours(region: Region, grid: StandGrid, stand: Stand, share: float) -> list[Stand]:
    """Return the stands beside one, half a cell of the grid times a share away, in the region."""
    found = []
    for k, side in enumerate(grid.spacing):
        for step in (share * side / 2, -share * side / 2):
            moved = Stand(*(value + step * (j == k) for j, value in enumerate(stand)))
            found.append(region.nearest(moved))
    return [each for each in dict.fromkeys(found) if each != stand]


def _answered(found: Placement, movable: MovableProblem, options: PlanOptions) -> Placement:
    """Return a placement with the best of its rows, planned; the next ones where that fails."""
    for row in _feasible(found.rows)[:_STARTS]:
        problem = movable.load(row.stand, row.seeds)
        result = plan(problem, options)
        if result.succeeded:
            changes = movable.changes(row.stand, row.seeds)
            return replace(found, problem=problem, best=row, result=result, changes=changes)
    return found


def _feasible(rows: Sequence[PlacementRow]) -> list[PlacementRow]:
    """Return the rows that have a motion, the shortest first."""
    return sorted((row for row in dict.fromkeys(rows) if row.is_feasible), key=_value)


def _value(row: PlacementRow) -> float:
    return inf if row.duration is None else row.duration
