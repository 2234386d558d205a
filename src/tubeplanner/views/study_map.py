"""Durations over two fields: a map of a grid's cells, and points where values are scattered."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import PlanStatus
from tubeplanner.studies.json_values import value_text
from tubeplanner.studies.study_row import StudyRow
from tubeplanner.views.palette import SPEED_COLORS
from tubeplanner.views.status_marks import status_mark, status_words
from tubeplanner.views.value_scale import ValueScale, value_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MOST_WRITTEN = 150  # cells with their durations in them
_MOST_TICKS = 12
_MOST_UPRIGHT = 70  # [characters] of all labels together that are not turned
_DARK = 0.5  # brightness below which white letters are easier to read


def draw_map(axis: "Axes", rows: Sequence[StudyRow], across: str, up: str) -> None:
    """Draw a cell for every pair of values: its duration, or why there is none.

    Args:
        axis: Where.
        rows: Of a grid.
        across: The field along the horizontal axis.
        up: The field along the vertical one.
    """
    columns, lines = _Ticks(rows, across), _Ticks(rows, up)
    durations = np.full((len(lines.values), len(columns.values)), np.nan)
    gaps: dict[PlanStatus, list[tuple[int, int]]] = {}
    for row in rows:
        cell = lines.place(row), columns.place(row)
        if row.duration is None:
            gaps.setdefault(row.status, []).append(cell)
        else:
            durations[cell] = row.duration
    image = axis.imshow(durations, cmap=_shades(), origin="lower", aspect="auto")
    if np.isfinite(durations).any():
        _figure(axis).colorbar(image, ax=axis, label="duration [s]")
    if durations.size <= _MOST_WRITTEN:
        _write_durations(axis, durations, image)
    for status, cells in gaps.items():
        _hatch(axis, status, cells)
    axis.set(xlabel=columns.scale.label, ylabel=lines.scale.label)
    axis.set_xticks(*columns.labels, rotation=20 if columns.is_long else 0)
    axis.set_yticks(*lines.labels)
    _legend_above(axis)


def draw_scatter(axis: "Axes", rows: Sequence[StudyRow], across: str, up: str) -> None:
    """Draw a point for every row: its duration as a colour, or a mark that says why there is none.

    Arguments as of `draw_map`, but for any rows.
    """
    scales = [ValueScale.of(path, [row.values[path] for row in rows]) for path in (across, up)]
    x, y = (scale.places for scale in scales)
    durations = np.array([np.nan if row.duration is None else row.duration for row in rows])
    planned = np.isfinite(durations)
    scales[0].draw(axis, "x")
    scales[1].draw(axis, "y")
    if planned.any():
        drawn = axis.scatter(
            *(x[planned], y[planned]), c=durations[planned], cmap=_shades(), edgecolors="#444444"
        )
        _figure(axis).colorbar(drawn, ax=axis, label="duration [s]")
    for status in dict.fromkeys(row.status for row in rows if row.duration is None):
        of = np.array([row.status is status and row.duration is None for row in rows])
        mark, label = status_mark(status), _label(status, int(of.sum()))
        axis.plot(x[of], y[of], mark.marker, color=mark.color, label=label)
    axis.grid(alpha=0.25)
    _legend_above(axis)


class _Ticks:
    """The values along one side of a map: numbers from small to large, others as they come."""

    def __init__(self, rows: Sequence[StudyRow], path: str) -> None:
        self._path = path
        by_text = {value_text(row.values[path]): row.values[path] for row in rows}
        self.scale = ValueScale.of(path, list(by_text.values()))
        order = np.argsort(self.scale.places, kind="stable")
        self.values = [self.scale.values[k] for k in order]
        self._places = {value_text(value): k for k, value in enumerate(self.values)}

    def place(self, row: StudyRow) -> int:
        """Return which of the values a row has."""
        return self._places[value_text(row.values[self._path])]

    @property
    def labels(self) -> tuple[list[int], list[str]]:
        """Where labels stand, and what they say: not more than fit."""
        step = -(-len(self.values) // _MOST_TICKS)
        shown = list(range(0, len(self.values), step))
        return shown, [value_label(self.values[k]) for k in shown]

    @property
    def is_long(self) -> bool:
        """Whether labels are too long to stand side by side."""
        return sum(map(len, self.labels[1])) > _MOST_UPRIGHT


def _write_durations(axis: "Axes", durations: FloatArray, image: Any) -> None:
    for cell in np.argwhere(np.isfinite(durations)):
        value = durations[tuple(cell)]
        brightness = np.dot(image.to_rgba(value)[:3], (0.3, 0.6, 0.1))
        color = "white" if brightness < _DARK else "black"
        line, column = cell.tolist()
        style: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 7, "color": color}
        axis.text(column, line, f"{value:.3f}", **style)


def _hatch(axis: "Axes", status: PlanStatus, cells: Sequence[tuple[int, int]]) -> None:
    from matplotlib.patches import Rectangle

    mark = status_mark(status)
    for number, (line, column) in enumerate(cells):
        label = _label(status, len(cells)) if number == 0 else None
        style: dict[str, Any] = {"facecolor": "#F4F4F4", "edgecolor": mark.color, "linewidth": 0}
        place = (column - 0.5, line - 0.5)
        axis.add_patch(Rectangle(place, 1, 1, hatch=mark.hatch, label=label, **style))


def _label(status: PlanStatus, count: int) -> str:
    return f"no plan: {status_words(status)} ({count})"


def _legend_above(axis: "Axes") -> None:
    """Say what marks mean, where they hide nothing."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        axis.legend(
            handles, labels, fontsize=8, ncols=2, loc="lower left", bbox_to_anchor=(0, 1.01)
        )


def _shades() -> Any:
    """Return colours of durations: short ones light, as fast stretches are in other figures."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("duration", SPEED_COLORS[::-1])


def _figure(axis: "Axes") -> "Figure":
    figure = axis.get_figure(root=True)
    assert figure is not None
    return figure
