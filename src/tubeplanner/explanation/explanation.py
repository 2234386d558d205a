"""What was found out about a problem: how its plan ended, and what single changes do to it."""

from dataclasses import dataclass
from typing import Any

from tubeplanner.arrays import FloatArray
from tubeplanner.explanation.remedy import Remedy, Room
from tubeplanner.explanation.unposed import Unposed
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
        unposed: Why it cannot be posed, and what can be drawn of it; None if it can.
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
    unposed: Unposed | None
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
        known = self.result or self.unposed
        return "" if known is None else known.message

    @property
    def place(self) -> Place:
        """Where, if there is no answer."""
        known = self.result or self.unposed
        return Place() if known is None else known.place

    @property
    def configuration(self) -> FloatArray | None:
        """Of the arm there, shape (n,) [rad or m]; None if it is not known."""
        known = self.result or self.unposed
        return None if known is None else known.configuration

    @property
    def drawn(self) -> PlanningProblem | None:
        """The problem as it can be drawn, or what is left of one that cannot be posed."""
        return self.problem if self.unposed is None else self.unposed.drawn

    def as_dict(self) -> dict[str, Any]:
        """Return what was found out as JSON values, beside the fields of the plan's own JSON."""
        planned = {} if self.result is None else self.result.as_dict()
        proved = {} if self.unposed is None else {"proved": self.unposed.proved}
        return {
            **planned,
            **proved,
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "stopped_by": self.stopped_by,
            "remedies": [remedy.as_dict() for remedy in self.remedies],
            "in_vain": list(self.in_vain),
            "room": [room.as_dict() for room in self.rooms],
            "tried": self.tried,
        }
