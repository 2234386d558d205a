"""What was found out about a problem: how its plan ended, and what single changes do to it."""

from dataclasses import dataclass
from typing import Any

from tubeplanner.explanation.remedy import Remedy, Room
from tubeplanner.outcome import Place, PlanStatus
from tubeplanner.planning.plan_result import PlanResult
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.progress import StoppedBy
from tubeplanner.short_repr import short_repr


@dataclass(frozen=True, eq=False)
class Explanation:
    """What was found out about a problem.

    Attributes:
        name: Of the problem.
        problem: The problem; None if it cannot be posed.
        result: Of planning it; None if it cannot be posed.
        refused: Why it cannot be posed; None if it can.
        remedies: Single changes with which it was planned, the smallest for its scale first; empty
            if the problem itself was.
        in_vain: Paths of what was changed, as far as makes sense, and helps nothing.
        rooms: How much worse single quantities may become; empty unless the problem was planned.
        tried: How many changes were planned with.
        stopped_by: "time_limit" or "interrupt" if that ended the search early; None: all was tried.
    """

    name: str
    problem: PlanningProblem | None
    result: PlanResult | None
    refused: str | None
    remedies: tuple[Remedy, ...] = ()
    in_vain: tuple[str, ...] = ()
    rooms: tuple[Room, ...] = ()
    tried: int = 0
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    @property
    def succeeded(self) -> bool:
        """Whether the problem can be solved, as it is or by some change."""
        return self.is_possible or bool(self.remedies)

    @property
    def is_possible(self) -> bool:
        """Whether the problem was planned as it is."""
        return self.result is not None and self.result.succeeded

    @property
    def status(self) -> PlanStatus:
        """How planning it ended; bad_input where it cannot be posed."""
        return PlanStatus.BAD_INPUT if self.result is None else self.result.status

    @property
    def message(self) -> str:
        """How planning it ended, or why it cannot be posed, in one sentence."""
        return self.refused or "" if self.result is None else self.result.message

    @property
    def place(self) -> Place:
        """Where, if there is no answer."""
        return Place() if self.result is None else self.result.place

    def as_dict(self) -> dict[str, Any]:
        """Return what was found out as JSON values, beside the fields of the plan's own JSON."""
        planned = {} if self.result is None else self.result.as_dict()
        return {
            **planned,
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "stopped_by": self.stopped_by,
            "remedies": [remedy.as_dict() for remedy in self.remedies],
            "in_vain": list(self.in_vain),
            "room": [room.as_dict() for room in self.rooms],
            "tried": self.tried,
        }
