"""Where a robot is to stand in its cell: what `place` returns."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import StoppedBy
from tubeplanner.short_repr import short_repr
from tubeplanner.studies.placement_region import Region, Stand, StandGrid
from tubeplanner.studies.placement_row import PlacementRow, grouped


@dataclass(frozen=True, eq=False)
class GivenStand:
    """What comes of the problem as it is given.

    Attributes:
        stand: Where the robot stands.
        result: Of planning; None where it was not planned.
        message: One sentence: the answer, or why there is none.
    """

    stand: Stand
    result: PlanResult | None
    message: str

    __repr__ = short_repr

    @property
    def duration(self) -> float | None:
        """Duration of the certified motion [s]; None if there is none."""
        return None if self.result is None else self.result.duration


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a robot is to stand so that its motion is short.

    Attributes:
        problem: The problem, its robot at the best stand, or as given if there is none.
        region: Where it may stand.
        stands_on: Names of obstacles that links which no joint moves may touch.
        grid: The stands that were tried first.
        rows: What came of each stand that was tried, those of the grid first.
        given: What comes of the problem as given.
        best: The stand chosen; None if no stand has a motion.
        result: Of planning there; None if there is none.
        changes: What the best stand changes in the problem file, by field path, as `load_problem`
            takes it; empty if there is none.
        restored: How many rows come from the journal.
        stopped_by: "interrupt" if Ctrl-C ended the search; None otherwise.
    """

    problem: PlanningProblem
    region: Region
    stands_on: tuple[str, ...]
    grid: StandGrid
    rows: tuple[PlacementRow, ...]
    given: GivenStand
    best: PlacementRow | None
    result: PlanResult | None
    changes: Mapping[str, Any]
    restored: int = 0
    stopped_by: StoppedBy | None = None

    def __repr__(self) -> str:
        answer = "no stand has a motion" if self.best is None else f"best {self.best.stand}"
        return f"<Placement of {self.problem.name}: {len(self.rows)} stands tried, {answer}>"

    @property
    def succeeded(self) -> bool:
        """Whether there is a stand with a certified motion."""
        return self.result is not None

    @property
    def duration(self) -> float | None:
        """Duration of the motion at the best stand [s]; None if there is none."""
        return None if self.result is None else self.result.duration

    @property
    def gain(self) -> float | None:
        """By which share the shortest motion is shorter than as given; None if one is missing."""
        results = self.given.result, self.result
        before, after = (None if r is None else r.shortest_duration for r in results)
        return None if before is None or after is None else 1 - after / before

    @property
    def feasible_count(self) -> int:
        """How many of the stands that were tried have a motion."""
        return sum(row.is_feasible for row in self.rows)

    @cached_property
    def reasons(self) -> tuple[tuple[str, int, str], ...]:
        """Why stands have no motion, how many for that reason, and the message of one of them.

        The most frequent first.
        """
        others = [row for row in self.rows if not row.is_feasible]
        groups = grouped(others, lambda row: row.reason)
        return tuple((reason, len(rows), rows[0].message) for reason, rows in groups)

    @property
    def message(self) -> str:
        """The answer, or why there is none, in one sentence."""
        if self.result is not None:
            return self.result.message
        if self.feasible_count:
            return (
                f"none of the {self.feasible_count} places that have a motion could be planned "
                "once more; run it again, or ask for another quality"
            )
        reason, count, example = self.reasons[0]
        return (
            f"no place of {len(self.rows)} has a motion; the most frequent reason, {count} times: "
            f"{reason} (such as: {example})"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the placement as JSON values."""
        given = {**_place_of(self.given.stand), "duration": self.given.duration}
        best = None if self.best is None else _place_of(self.best.stand)
        keys = "reason", "count", "example"
        return {
            "problem": self.problem.name,
            "region": self.region.bounds,
            "stands_on": list(self.stands_on),
            "message": self.message,
            "duration": self.duration,
            "stopped_by": self.stopped_by,
            "given": {**given, "message": self.given.message},
            "best": best,
            "gain": self.gain,
            "changes": dict(self.changes),
            "tried": len(self.rows),
            "feasible": self.feasible_count,
            "restored": self.restored,
            "reasons": [dict(zip(keys, each, strict=True)) for each in self.reasons],
            "rows": [row.as_dict() for row in self.rows],
        }


def _place_of(stand: Stand) -> dict[str, Any]:
    return {"position": list(stand[:3]), "yaw": stand.yaw}
