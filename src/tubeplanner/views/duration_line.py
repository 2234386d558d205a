"""The duration against one field, for sweeps and studies: points, gaps, failed runs."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import PlanStatus
from tubeplanner.views.palette import WARNING_COLOR
from tubeplanner.views.panels import line_style
from tubeplanner.views.status_marks import draw_rug, status_words
from tubeplanner.views.study_plots import draw_gap
from tubeplanner.views.value_scale import ValueScale

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_NAMED = 12  # gaps with their reason beside them; more of them as marks with a legend
_ABOVE: dict[str, Any] = {
    "xytext": (0, 9),
    "textcoords": "offset points",
    "ha": "center",
    "fontsize": 7,
    "bbox": {"boxstyle": "square,pad=0.1", "color": "white", "alpha": 0.8},
}


class DurationRow(Protocol):
    """What a row must say of its plan."""

    @property
    def status(self) -> PlanStatus:
        """How planning ended."""

    @property
    def duration(self) -> float | None:
        """[s]; None if there is no plan."""

    @property
    def shortest_duration(self) -> float | None:
        """[s]; likewise."""

    @property
    def runs(self) -> int | None:
        """How many were simulated; None: none were."""

    @property
    def runs_failed(self) -> int | None:
        """How many of them failed; likewise."""


def draw_durations(
    axis: "Axes", scale: ValueScale, rows: Sequence[DurationRow], *, with_shortest: bool
) -> None:
    """Draw durations against a field's values; above those simulated, how many runs failed.

    Args:
        axis: Where.
        scale: Where the values of the rows stand.
        rows: One per value.
        with_shortest: Whether to draw the shortest durations that were found as well.
    """
    scale.draw(axis)
    lines = {"certified trajectory": [row.duration for row in rows]}
    if with_shortest:
        lines["shortest that was found"] = [row.shortest_duration for row in rows]
    for number, (label, durations) in enumerate(lines.items()):
        values = np.array([np.nan if d is None else d for d in durations])
        order = np.argsort(scale.places)
        order = order[np.isfinite(values[order])]
        style = {**line_style(number), "linewidth": 1.0 if scale.is_scaled else 0.0}
        axis.plot(scale.places[order], values[order], "o", label=label, **style)
    _draw_gaps(axis, scale.places, rows)
    _mark_runs(axis, scale.places, rows)
    axis.set_ylabel("duration [s]")
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8)


def _draw_gaps(axis: "Axes", places: FloatArray, rows: Sequence[DurationRow]) -> None:
    gaps = [
        (place, row.status)
        for place, row in zip(places.tolist(), rows, strict=True)
        if row.duration is None
    ]
    if len(gaps) > _MOST_NAMED:
        draw_rug(axis, gaps)
        return
    for place, status in gaps:
        draw_gap(axis, place, status_words(status))


def _mark_runs(axis: "Axes", places: FloatArray, rows: Sequence[DurationRow]) -> None:
    """Write above answers how many of their runs failed, and mark those of which some did."""
    failed = []
    for row, place in zip(rows, places, strict=True):
        if row.duration is None or row.runs is None:
            continue
        at = (place, row.duration)
        axis.annotate(f"{row.runs_failed} of {row.runs} failed", at, **_ABOVE)
        if row.runs_failed:
            failed.append(at)
    if failed:
        axis.plot(
            *np.transpose(failed),
            "X",
            label="some of its runs failed",
            color=WARNING_COLOR,
            markersize=11,
        )
    if any(row.runs is not None for row in rows):
        axis.margins(0.1)
