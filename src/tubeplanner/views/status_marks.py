"""How figures tell apart why there is no plan: the same colour, mark and hatching everywhere."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tubeplanner.outcome import PlanStatus
from tubeplanner.views.palette import LINE_COLORS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ORDER = (
    PlanStatus.TUBE_BLOCKED,
    PlanStatus.UNREACHABLE,
    PlanStatus.NO_TRAJECTORY,
    PlanStatus.GRAVITY_EXCEEDS_EFFORT,
    PlanStatus.CERTIFICATE_FAILED,
    PlanStatus.TIME_LIMIT,
    PlanStatus.BAD_INPUT,
    PlanStatus.CRASHED,
)
_MARKS = ("x", "v", "P", "s", "D", "^", "*", "X")
_HATCHES = ("///", "\\\\\\", "xxx", "...", "+++", "ooo", "|||", "---")
_COLORS = (*LINE_COLORS[1:], "#777777", "#7A1F1F")  # without that of plans


@dataclass(frozen=True)
class StatusMark:
    """How one status is drawn.

    Attributes:
        color: Of marks and hatching.
        marker: As matplotlib names it.
        hatch: Likewise.
    """

    color: str
    marker: str
    hatch: str


def status_mark(status: PlanStatus) -> StatusMark:
    """Return how a status without a plan is drawn."""
    place = _ORDER.index(status)
    return StatusMark(_COLORS[place], _MARKS[place], _HATCHES[place])


def status_words(status: PlanStatus) -> str:
    """Return a status as figures write it."""
    return str(status).replace("_", " ")


def draw_rug(axis: "Axes", gaps: Iterable[tuple[float, PlanStatus]]) -> None:
    """Mark places without a plan at the lower edge of axes, by why there is none."""
    places: dict[PlanStatus, list[float]] = {}
    for place, status in gaps:
        places.setdefault(status, []).append(place)
    for status, found in places.items():
        mark = status_mark(status)
        axis.plot(
            found,
            [0.03] * len(found),
            mark.marker,
            transform=axis.get_xaxis_transform(),
            color=mark.color,
            markersize=6,
            label=f"no plan: {status_words(status)} ({len(found)})",
        )
