"""Rows and result of a placement; trials, each once."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from tubeplanner.errors import FormerName, ProblemError, TubePlannerError
from tubeplanner.outcome import Infeasible, Location, PlanStatus, StoppedBy
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
from tubeplanner.studies.journal import Journal, require_fields
from tubeplanner.studies.plan_many import run_many
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
        links, obstacle, joint = (
            self.location.links or (),
            self.location.obstacle,
            self.location.joint,
        )
        if links and obstacle is not None:
            between = "in" if self.status == BASE_IN_OBSTACLE else "and"
            return f"{words}: '{links[0]}' {between} '{obstacle}'"
        if links:
            return f"{words}: {' and '.join(map(repr, links))}"
        if joint is not None:
            return f"{words}: {joint}"
        return (
            words if self.location.segment is None else f"{words}: segment {self.location.segment}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        return {
            **self.base_placement.as_dict(),
            "status": str(self.status),
            "message": self.message,
            "where": self.location.as_dict(),
            "duration": self.duration,
            "seeds": {end: list(values) for end, values in self.seeds.items()},
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


# ---- Results: what `location` returns.


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


# ---- Trials: base poses tried side by side, each once.

# The search compares shortest motions; robustness counts in the final plans alone.
SEARCH_OPTIONS = PlanOptions(quality="fast", slack=0.0, robust=False)


class PlacementTrials:
    """The rows of a problem's base poses so far.

    Attributes:
        restored: Number of rows from the journal.
    """

    def __init__(
        self, problem: MovableProblem, stands_on: Sequence[str], journal: Journal | None
    ) -> None:
        """Begin without rows.

        Args:
            problem: The problem.
            stands_on: Names of obstacles that links which no joint moves may touch.
            journal: Journal of answers; None: none.
        """
        self._problem, self._stands_on = problem, tuple(sorted(stands_on))
        self._journal = journal
        self._rows: dict[BasePlacement, PlacementRow] = {}
        self._order: dict[BasePlacement, int] = {}  # of requests
        self.restored = 0

    @property
    def rows(self) -> tuple[PlacementRow, ...]:
        """All rows, in the order of requests."""
        return tuple(sorted(self._rows.values(), key=lambda row: self._order[row.base_placement]))

    def of(
        self,
        base_placements: Sequence[BasePlacement],
        executor: Executor,
        report: Callable[[int, int], None],
    ) -> list[PlacementRow]:
        """Return the rows of base poses, in their order; new base poses are tried.

        Args:
            base_placements: Base poses.
            executor: Executor of the plans.
            report: Called with the numbers of finished and of all new base poses.
        """
        new = [
            base_placement
            for base_placement in dict.fromkeys(base_placements)
            if base_placement not in self._rows
        ]
        self._order.update(
            {base_placement: len(self._order) + k for k, base_placement in enumerate(new)}
        )
        missing = []
        for base_placement in new:
            if self._journal is None or (key := self._key(base_placement)) not in self._journal:
                missing.append(base_placement)
                continue
            self._rows[base_placement] = self._journal.made(key, PlacementRow.of_dict)
            self.restored += 1
        calls = [
            (self._problem, base_placement, self._stands_on, SEARCH_OPTIONS)
            for base_placement in missing
        ]
        report(0, len(missing))
        for count, done in enumerate(run_many(tried, calls, executor), start=1):
            base_placement, row = missing[done.index], done.value
            if row is None:
                message = f"{type(done.error).__name__}: {done.error}"
                row = PlacementRow(base_placement, str(PlanStatus.CRASHED), message)
            self._rows[base_placement] = row
            if self._journal is not None:
                base = self._problem.changes(base_placement)["robot.base"]
                values = {f"robot.base.{key}": value for key, value in base.items()}
                self._journal.add(self._key(base_placement), values, row.as_dict())
            report(count, len(missing))
        return [self._rows[base_placement] for base_placement in base_placements]

    def _key(self, base_placement: BasePlacement) -> str:
        """Return a hash of all inputs of a row: the plan's, and `stands_on`."""
        planned = self._problem.at(base_placement).content_hash(SEARCH_OPTIONS)
        return f"{planned} standing on {', '.join(self._stands_on) or 'nothing'}"
