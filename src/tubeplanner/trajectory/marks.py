"""What happens during a trajectory, and when."""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from tubeplanner.errors import TrajectoryError, shown
from tubeplanner.options import is_number

MOVE, EVENT, ATTACH, DETACH = KINDS = ("move", "event", "attach", "detach")


@dataclass(frozen=True)
class Mark:
    """Something that happens at an instant.

    Attributes:
        time: When [s].
        kind: "move": a move begins; "event"; "attach" or "detach" of something.
        name: Of the move, the event or what is taken or let go.
        setting: What an event sets, as a file has it; None for nothing.
    """

    time: float
    kind: str
    name: str
    setting: Any = None

    def as_dict(self) -> dict[str, Any]:
        """Return the mark as a trajectory file has it."""
        setting = {} if self.setting is None else {"set": self.setting}
        return {"time": self.time, self.kind: self.name, **setting}

    def __str__(self) -> str:
        setting = "" if self.setting is None else f" {self.setting}"
        return f"{self.time:.4f} s: {self.kind} {self.name}{setting}"


def marks_of(fields: Any) -> tuple[Mark, ...]:
    """Return the marks that a trajectory file has.

    Args:
        fields: What it has under `marks`.

    Raises:
        TrajectoryError: They are no list of maps with a time and one of move, event, attach,
            detach, in the order of time.
    """
    if not isinstance(fields, list):
        raise TrajectoryError(f"marks is {shown(fields)}; it must be a list")
    marks = tuple(_mark(k, each) for k, each in enumerate(fields))
    for k, (mark, after) in enumerate(pairwise(marks), start=1):
        if after.time < mark.time:
            raise TrajectoryError(f"marks[{k}].time is {after.time:g} s, before the one before")
    return marks


def _mark(k: int, fields: Any) -> Mark:
    given = [kind for kind in KINDS if kind in fields] if isinstance(fields, dict) else []
    if len(given) != 1 or not isinstance(fields[given[0]], str):
        raise TrajectoryError(
            f"marks[{k}] is {shown(fields)}; it must be a map with a time and one name of "
            f"{', '.join(KINDS)}"
        )
    time = fields.get("time")
    if not is_number(time) or not time >= 0:
        raise TrajectoryError(f"marks[{k}].time is {shown(time)}; it must be a time [s]")
    return Mark(float(time), given[0], fields[given[0]], fields.get("set"))
