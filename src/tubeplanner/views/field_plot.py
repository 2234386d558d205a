"""The figure of a sweep over a field: the duration against its values."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.options import is_number
from tubeplanner.problem.field_paths import factor_of
from tubeplanner.studies.field_sweep import FieldSweep, value_text
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.palette import WARNING_COLOR
from tubeplanner.views.panels import line_style
from tubeplanner.views.study_plots import draw_gap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_LABEL = 24  # [characters] of a value below the axis
_ABOVE: dict[str, Any] = {
    "xytext": (0, 9),
    "textcoords": "offset points",
    "ha": "center",
    "fontsize": 7,
    "bbox": {"boxstyle": "square,pad=0.1", "color": "white", "alpha": 0.8},
}


def plot_field_sweep(result: FieldSweep, path: str | Path | None = None) -> "Figure":
    """Draw the duration against a field's values: numbers and factors to scale, others in a row.

    Above answers that were executed in simulation stands how many of their runs failed.

    Args:
        result: What `sweep_field` found.
        path: Where to save the figure, as PNG, PDF or SVG by its ending; None: nowhere.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    figure = new_figure(8.0, 4.5)
    axis = figure.add_subplot()
    figure.suptitle(f"{result.name}: duration against {result.path}", fontsize=13)
    places, is_scaled = _places(result)
    lines = {"certified trajectory": [row.duration for row in result.rows]}
    if result.varies_objective:
        lines["shortest that was found"] = [row.shortest_duration for row in result.rows]
    for number, (label, durations) in enumerate(lines.items()):
        values = np.array([np.nan if d is None else d for d in durations])
        order = np.argsort(places)
        order = order[np.isfinite(values[order])]
        style = {**line_style(number), "linewidth": 1.0}
        axis.plot(places[order], values[order], "o", label=label, **style)
    for row, place in zip(result.rows, places, strict=True):
        if row.duration is None:
            draw_gap(axis, place, str(row.status).replace("_", " "))
    _mark_runs(axis, result, places)
    if not is_scaled:
        axis.set_xticks(places, [value_text(row.value)[:_MAX_LABEL] for row in result.rows])
    is_factor = is_scaled and factor_of(result.rows[0].value) is not None
    name = f"factor on {result.path} [-]" if is_factor else result.path
    axis.set(xlabel=name, ylabel="duration [s]")
    axis.grid(alpha=0.25)
    axis.legend(fontsize=8)
    return saved(figure, path)


def _mark_runs(axis: "Axes", result: FieldSweep, places: FloatArray) -> None:
    """Write above answers how many of their runs failed, and mark those of which some did."""
    failed = []
    for row, place in zip(result.rows, places, strict=True):
        if row.duration is None or row.verdict is None:
            continue
        seen, at = f"{row.verdict.failed} of {row.verdict.runs} failed", (place, row.duration)
        axis.annotate(seen, at, **_ABOVE)
        if row.verdict.failed:
            failed.append(at)
    if failed:
        axis.plot(
            *np.transpose(failed),
            "X",
            label="some of its runs failed",
            color=WARNING_COLOR,
            markersize=11,
        )
    if result.is_simulated:
        axis.margins(0.1)


def _places(result: FieldSweep) -> tuple[FloatArray, bool]:
    """Return where values stand on the axis, and whether that is to scale."""
    values = [row.value for row in result.rows]
    factors = [factor_of(value) for value in values]
    for numbers in (values, factors):
        if all(is_number(number) for number in numbers):
            places = np.array(numbers, dtype=float)
            if np.isfinite(places).all():
                return places, True
    return np.arange(len(values), dtype=float), False
