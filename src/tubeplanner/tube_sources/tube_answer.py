"""The result of a search for a tube: a problem to plan, or the reason why there is none."""

from dataclasses import dataclass
from typing import Any

from tubeplanner.outcome import Infeasible, Place, PlanStatus
from tubeplanner.progress import StoppedBy
from tubeplanner.short_repr import short_repr
from tubeplanner.tube_sources.measured_plan import PlannedTube


@dataclass(frozen=True, eq=False)
class TubeAnswer:
    """The result of a search for a tube.

    Attributes:
        status: Success means that the trajectory through the tube is certified.
        message: One sentence.
        place: Where, if there is no answer.
        found: The problem with its tube, and its plan; None unless successful.
        measured: The tube in which no collision was found, and its plan: `found`, or slower than
            that; None if there is none.
        notes: Further information.
        compared: Durations of the trajectories through the tubes that were compared before
            measuring, each of the same radius [s]; None where there was no trajectory.
        search_time: Wall time from the loaded problem to the answer [s].
        stopped_by: "time_limit" or "interrupt" if that ended the search early; None otherwise.
    """

    status: PlanStatus
    message: str
    place: Place
    found: PlannedTube | None = None
    measured: PlannedTube | None = None
    notes: tuple[str, ...] = ()
    compared: tuple[float | None, ...] = ()
    search_time: float = 0.0
    stopped_by: StoppedBy | None = None

    __repr__ = short_repr

    @property
    def succeeded(self) -> bool:
        """Whether there is a tube with a certified trajectory."""
        return self.status is PlanStatus.SUCCESS

    def as_dict(self) -> dict[str, Any]:
        """Return the fields of the command line's JSON, but for loading_time."""
        planned = {} if self.found is None else self.found.result.as_dict()
        return {
            **planned,
            "status": str(self.status),
            "message": self.message,
            "where": self.place.as_dict(),
            "notes": [*self.notes, *planned.get("notes", ())],
            "search_time": self.search_time,
            "compared_durations": list(self.compared),
            "stopped_by": self.stopped_by,
            **_tube_fields(self.found),
            "measured": self._measured_fields(),
        }

    def _measured_fields(self) -> dict[str, Any] | None:
        if self.measured is None:
            return None
        return {"duration": self.measured.duration, **_tube_fields(self.measured)}


def answer_of(found: PlannedTube | Infeasible, **more: Any) -> TubeAnswer:
    """Return an answer: what was found, or why nothing was.

    Args:
        found: What was found, or the reason.
        more: Other fields of the answer.
    """
    if isinstance(found, Infeasible):
        return TubeAnswer(found.status, str(found), found.place, **more)
    tube = found.problem.tube
    message = f"tube of {len(tube.points)} reference points; {found.result.message}"
    return TubeAnswer(PlanStatus.SUCCESS, message, Place(), found, **more)


def _tube_fields(found: PlannedTube | None) -> dict[str, Any]:
    if found is None:
        return {"points": None, "radius": None}
    tube = found.problem.tube
    return {"points": tube.points.tolist(), "radius": tube.radius.tolist()}
