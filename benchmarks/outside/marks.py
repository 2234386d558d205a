"""When the steps of a cycle begin, as a trajectory file says."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from outside.cycle import Cycle, Step
from outside.files import BadInput


@dataclass(frozen=True)
class Times:
    """When the legs of a cycle and the steps between them begin and end.

    Attributes:
        legs: Begin and end of each leg [s].
        rests: Likewise, of each step of each rest.
    """

    legs: list[tuple[float, float]]
    rests: list[list[tuple[float, float]]]

    def seam(self, seam: int, duration: float) -> tuple[float, float]:
        """Return when a seam begins and ends [s]."""
        ends = [0.0, *(end for _, end in self.legs)]
        begins = [*(begin for begin, _ in self.legs), duration]
        return ends[seam], begins[seam]


def read_times(path: Path, cycle: Cycle, duration: float) -> Times:
    """Read the marks of a trajectory file of so many seconds, which must be those of a cycle.

    Raises:
        BadInput: There are none, they are not those of its steps, or not in order.
    """
    marks = json.loads(path.read_text("utf-8-sig")).get("marks")
    if not isinstance(marks, list) or len(marks) != len(cycle.steps):
        raise BadInput(f"{path}: marks are not one for each of {len(cycle.steps)} steps")
    for mark, step in zip(marks, cycle.steps, strict=True):
        if mark != {"time": mark.get("time"), **_asked(step)}:
            raise BadInput(f"{path}: the mark {mark} is not that of {_asked(step)}")
    begins = [float(mark["time"]) for mark in marks]
    ends = [*begins[1:], duration]
    steps = list(zip(begins, ends, strict=True))
    if begins[0] < 0 or any(end < begin for begin, end in steps):
        raise BadInput(f"{path}: marks are not in the order of time")
    last = [leg.first + len(leg.moves) - 1 for leg in cycle.legs]
    legs = [(begins[leg.first], ends[k]) for leg, k in zip(cycle.legs, last, strict=True)]
    firsts = [0, *(k + 1 for k in last)]
    both = zip(firsts, cycle.rests, strict=True)
    return Times(legs, [steps[first : first + len(rest)] for first, rest in both])


def _asked(step: Step) -> dict[str, Any]:
    setting = step.fields.get("set") if step.kind == "event" else None
    return {step.kind: step.name} | ({} if setting is None else {"set": setting})
