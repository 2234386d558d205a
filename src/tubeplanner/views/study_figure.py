"""The figure of a study: durations against what is varied."""

from pathlib import Path
from typing import TYPE_CHECKING

from tubeplanner.errors import OptionError
from tubeplanner.problem.field_paths import is_of_objective
from tubeplanner.studies.axes import Interval
from tubeplanner.studies.study_result import StudyResult
from tubeplanner.views.duration_line import draw_durations
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.panels import line_style
from tubeplanner.views.status_marks import draw_rug
from tubeplanner.views.study_map import draw_map, draw_scatter
from tubeplanner.views.value_scale import ValueScale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = {4: 2}  # of panels, for so many fields; else three


def plot_study(result: StudyResult, path: str | Path | None = None) -> "Figure":
    """Draw the durations of a study, and where there is no plan, why.

    One field: the duration against its values. Two fields of a grid: a map of its cells; of a Latin
    hypercube: points coloured by their duration. More: the durations of all points, once against
    each field. Fields that have one value alone are left out.

    Args:
        result: What `run_study` found.
        path: Where to save the figure as PNG; None: nowhere.

    Raises:
        OptionError: No point was done.
        OutputError: The file could not be written.
    """
    if not result.rows:
        raise OptionError("no point of the study was done; there is nothing to draw")
    axes = result.study.axes
    varied = [axis.path for axis in axes if isinstance(axis, Interval) or len(axis.values) > 1]
    varied = varied or [axes[0].path]
    figure = new_figure(*_size(len(varied)))
    figure.suptitle(f"{result.study.name}: duration against {_listed(varied)}")
    if len(varied) == 1:
        _draw_line(figure.add_subplot(), result, varied[0])
    elif len(varied) == 2:
        draw = draw_map if result.study.latin is None else draw_scatter
        draw(figure.add_subplot(), result.rows, *varied)
    else:
        _draw_each(figure, result, varied)
    return saved(figure, path)


def _size(count: int) -> tuple[float, float]:
    """Return the width and height of a figure of so many fields [inches]."""
    if count < 3:
        return 8.0, 4.5 if count == 1 else 5.5
    lines, columns = _panels(count)
    return 4.0 * columns, 3.2 * lines + 0.8


def _panels(count: int) -> tuple[int, int]:
    """Return in how many lines and columns panels stand."""
    columns = _COLUMNS.get(count, 3)
    return -(-count // columns), columns


def _listed(paths: list[str]) -> str:
    return " and ".join(paths) if len(paths) < 3 else f"{len(paths)} fields"


def _draw_line(axis: "Axes", result: StudyResult, path: str) -> None:
    scale = ValueScale.of(path, [row.values[path] for row in result.rows])
    draw_durations(axis, scale, result.rows, with_shortest=is_of_objective(path))


def _draw_each(figure: "Figure", result: StudyResult, paths: list[str]) -> None:
    """Draw a panel for every field, all with the same durations."""
    panels = figure.subplots(*_panels(len(paths)), sharey=True, squeeze=False)
    for axis, path in zip(panels.flat, paths, strict=False):
        scale = ValueScale.of(path, [row.values[path] for row in result.rows])
        scale.draw(axis)
        each = list(zip(scale.places.tolist(), result.rows, strict=True))
        planned = [(place, row.duration) for place, row in each if row.duration is not None]
        if planned:
            color = line_style(0)["color"]
            axis.plot(*zip(*planned, strict=True), "o", color=color, alpha=0.6, markersize=4)
        draw_rug(axis, [(place, row.status) for place, row in each if row.duration is None])
        axis.grid(alpha=0.25)
    for axis in panels.flat[len(paths) :]:
        axis.set_visible(False)
    for axis in panels[:, 0]:
        axis.set_ylabel("duration [s]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8)
