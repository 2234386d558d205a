"""The figure of a sweep over a field: the duration against its values."""

from pathlib import Path
from typing import TYPE_CHECKING

from tubeplanner.studies.field_sweep import FieldSweep
from tubeplanner.views.duration_line import draw_durations
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.value_scale import ValueScale

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
    figure.suptitle(f"{result.name}: duration against {result.path}", fontsize=13)
    scale = ValueScale.of(result.path, [row.value for row in result.rows])
    axis = figure.add_subplot()
    draw_durations(axis, scale, result.rows, with_shortest=result.varies_objective)
    return saved(figure, path)
