"""Figures of studies, lines and maps over fields, and of comparisons of methods."""

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill, shorten
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.errors import OptionError
from tubeplanner.outcome import PlanStatus
from tubeplanner.output.curves import trajectory_curves
from tubeplanner.output.drawing import LINE_COLORS, WARNING_COLOR
from tubeplanner.output.figures.figure_files import new_figure, saved
from tubeplanner.output.figures.panels import line_style
from tubeplanner.output.figures.sweep_figures import (
    ValueScale,
    draw_durations,
    draw_empty_cells,
    draw_rug,
    duration_shades,
    gap_label,
    status_mark,
    value_label,
)
from tubeplanner.studies.comparison import Comparison, ComparisonRow
from tubeplanner.studies.study import Interval, StudyResult, StudyRow
from tubeplanner.task.field_changes import is_of_objective
from tubeplanner.text import value_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = {4: 2}  # of panels, by the number of fields; else three


def plot_study(result: StudyResult, path: str | Path | None = None) -> "Figure":
    """Draw the durations of a study, and the reasons where there is no plan.

    One field: the duration against its values. Two fields of a grid: a map of its cells; of a Latin
    hypercube: points coloured by their duration. More: the durations of all points, once against
    each field. Fields with a single value are left out.

    Args:
        result: Result of `run_study`.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

    Raises:
        OptionError: No point was planned, or the file has another ending.
        OutputError: The file could not be written.
    """
    if not result.rows:
        raise OptionError("no point of the study was done; there is nothing to draw")
    axes = result.study.axes
    varied = [axis.path for axis in axes if isinstance(axis, Interval) or len(axis.values) > 1]
    varied = varied or [axes[0].path]
    size = 8.0, 4.5 if len(varied) == 1 else 5.5
    if len(varied) > 2:
        lines, columns = _panels(len(varied))
        size = 4.0 * columns, 3.2 * lines + 0.8
    figure = new_figure(*size)
    names = " and ".join(varied) if len(varied) < 3 else f"{len(varied)} fields"
    figure.suptitle(f"{result.study.name}: duration against {names}")
    if len(varied) == 1:
        scale = ValueScale.of(varied[0], [row.values[varied[0]] for row in result.rows])
        with_shortest = is_of_objective(varied[0])
        draw_durations(figure.add_subplot(), scale, result.rows, with_shortest=with_shortest)
    elif len(varied) == 2:
        draw = draw_map if result.study.latin is None else draw_scatter
        draw(figure.add_subplot(), result.rows, *varied)
    else:
        _draw_each(figure, result, varied)
    return saved(figure, path)


def _panels(count: int) -> tuple[int, int]:
    """Return the numbers of lines and columns of a number of panels."""
    columns = _COLUMNS.get(count, 3)
    return -(-count // columns), columns


def _draw_each(figure: "Figure", result: StudyResult, paths: list[str]) -> None:
    """Draw a panel for each field, all with the same durations."""
    panels = figure.subplots(*_panels(len(paths)), sharey=True, squeeze=False)
    for axis, path in zip(panels.flat, paths, strict=False):
        scale = ValueScale.of(path, [row.values[path] for row in result.rows])
        scale.draw(axis)
        each = list(zip(scale.positions.tolist(), result.rows, strict=True))
        planned = [
            (coordinates, row.duration) for coordinates, row in each if row.duration is not None
        ]
        if planned:
            color = line_style(0)["color"]
            axis.plot(*zip(*planned, strict=True), "o", color=color, alpha=0.6, markersize=4)
        draw_rug(
            axis, [(coordinates, row.status) for coordinates, row in each if row.duration is None]
        )
        axis.grid(alpha=0.25)
    for axis in panels.flat[len(paths) :]:
        axis.set_visible(False)
    for axis in panels[:, 0]:
        axis.set_ylabel("duration [s]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8)


_WIDTH, _ROW, _AROUND = 13.0, 0.56, 1.35  # all of these [inches]
_EDGE, _TITLE = 0.08, 0.4  # free at the borders, and for the title; inches too
_LETTERS, _LINES = 34, 2  # of a verdict
# Solid and hatched, to be told apart in grey print.
_CERTIFIED: dict[str, Any] = {"facecolor": LINE_COLORS[0], "edgecolor": LINE_COLORS[0]}
_FAILED: dict[str, Any] = {"facecolor": "white", "edgecolor": WARNING_COLOR, "hatch": "////"}
_FASTEST_SPEED: dict[str, Any] = {"color": "#D4D4D4", "linewidth": 0}


def plot_comparison(result: Comparison, path: str | Path | None = None) -> "Figure":
    """Draw the motions of several methods for a problem, a row each, the fastest first.

    Bars are durations: solid if certified, hatched if not, with the conditions that fail named;
    without a motion the row says why. Beside each is the speed of its tool, over that of the
    fastest certified motion in grey.

    Args:
        result: Result of `compare`.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    rows = sorted(result.rows, key=lambda row: row.duration or float("inf"))
    fastest = next((row for row in rows if row.certified), None)
    height = _AROUND + _ROW * len(rows)
    figure = new_figure(_WIDTH, height)
    title = f"{result.problem.name}: methods compared"
    figure.suptitle(title, y=1 - _EDGE / height, va="top", fontsize=13)
    # Without space between them the panels are as high as the bars' rows.
    page = (_EDGE / _WIDTH, _EDGE / height, 1 - 2 * _EDGE / _WIDTH, 1 - (_EDGE + _TITLE) / height)
    figure.set_layout_engine("constrained", hspace=0.0, h_pad=0.0, w_pad=0.12, rect=page)
    grid = figure.add_gridspec(len(rows), 2, width_ratios=(1, 1.1))
    _draw_durations(figure.add_subplot(grid[:, 0]), rows, fastest)
    first = figure.add_subplot(grid[0, 1])
    others = [
        figure.add_subplot(grid[k, 1], sharex=first, sharey=first) for k in range(1, len(rows))
    ]
    _draw_speeds([first, *others], result, rows, fastest)
    return saved(figure, path)


def _draw_durations(
    axis: "Axes", rows: Sequence[ComparisonRow], fastest: ComparisonRow | None
) -> None:
    """Draw bars, with the verdicts beside the bars."""
    for number, row in enumerate(rows):
        if row.duration is not None:
            axis.barh(number, row.duration, 0.6, **(_CERTIFIED if row.certified else _FAILED))
        coordinates: dict[str, Any] = {"transform": axis.get_yaxis_transform(), "va": "center"}
        if row.duration is None:
            verdict = f"no motion: {row.message}"
        elif row.certified:
            verdict = f"{row.duration:.4f} s, certified{', the fastest' * (row is fastest)}"
        else:
            verdict = f"{row.duration:.4f} s, fails: {', '.join(row.failures)}"
        short = shorten(verdict, _LINES * (_LETTERS - 4), placeholder=" ...")
        verdict = fill(short, _LETTERS)
        axis.text(1.02, number, verdict, fontsize=8.5, parse_math=False, **coordinates)
    axis.set_yticks(range(len(rows)), [row.method for row in rows])
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.tick_params(axis="y", length=0)
    axis.set(xlabel="duration [s]")
    axis.set_xlim(0.0, None if any(row.duration for row in rows) else 1.0)
    axis.set_axisbelow(True)
    axis.grid(alpha=0.25, axis="x")


def _draw_speeds(
    axes: Sequence["Axes"],
    result: Comparison,
    rows: Sequence[ComparisonRow],
    fastest: ComparisonRow | None,
) -> None:
    """Draw the speed of the tool in a panel per row, all to the same scales."""
    # Times [s] and speeds [m/s], (N,) each; None without a motion.
    speeds: list[tuple[FloatArray, FloatArray] | None] = []
    for row in rows:
        if row.trajectory is None:
            speeds.append(None)
        else:
            curves = trajectory_curves(result.problem, row.trajectory)
            speeds.append((curves.samples.time, curves.speed))
    behind = None if fastest is None else speeds[rows.index(fastest)]
    for axis, row, speed in zip(axes, rows, speeds, strict=True):
        if behind is not None:
            axis.fill_between(*behind, **_FASTEST_SPEED)
        if speed is not None:
            color, dashes = (LINE_COLORS[0], "-") if row.certified else (WARNING_COLOR, (0, (5, 2)))
            axis.plot(*speed, color=color, linestyle=dashes, linewidth=1.5)
        axis.grid(alpha=0.25)
        axis.yaxis.tick_right()
        axis.tick_params(labelsize=8, labelbottom=axis is axes[-1], bottom=axis is axes[-1])
    drawn = [speed for speed in speeds if speed is not None]
    end = max((float(time[-1]) for time, _ in drawn), default=1.0)
    top = max((float(speed.max()) for _, speed in drawn), default=1.0) or 1.0
    axes[0].set_xlim(0.0, 1.02 * end)
    axes[0].set_ylim(0.0, 1.2 * top)
    digit, power = f"{top:e}".split("e")
    axes[0].set_yticks([float(f"{digit[0]}e{power}")])  # the one tick has one digit, rounded down
    grey = "" if fastest is None else f"; grey: {fastest.method}"
    axes[0].set_title(f"tool speed [m/s]{grey}", fontsize=9.5, loc="left")
    axes[-1].set_xlabel("time [s]")


# ---- Durations over two fields: a map of a grid's cells, or scattered points.

_MAX_WRITTEN = 150  # cells with their durations in them
_MAX_TICKS = 12
_MAX_UPRIGHT = 70  # [characters] of all upright labels together
_DARK = 0.5  # brightness below which white letters are easier to read


def draw_map(axis: "Axes", rows: Sequence[StudyRow], across: str, up: str) -> None:
    """Draw a cell for each pair of values: its duration, or the reason for none.

    Args:
        axis: Of the panel.
        rows: Of a grid.
        across: The field along the horizontal axis.
        up: The field along the vertical axis.
    """
    style: dict[str, Any]
    columns, lines = _Ticks(rows, across), _Ticks(rows, up)
    durations = np.full((len(lines.values), len(columns.values)), np.nan)
    gaps: dict[PlanStatus, list[tuple[float, float]]] = {}
    for row in rows:
        cell = lines.number(row), columns.number(row)
        if row.duration is None:
            gaps.setdefault(row.status, []).append((cell[1] - 0.5, cell[0] - 0.5))
        else:
            durations[cell] = row.duration
    image = axis.imshow(durations, cmap=duration_shades(), origin="lower", aspect="auto")
    if np.isfinite(durations).any():
        _figure(axis).colorbar(image, ax=axis, label="duration [s]")
    if durations.size <= _MAX_WRITTEN:
        for line, column in np.argwhere(np.isfinite(durations)).tolist():
            value = durations[line, column]
            brightness = np.dot(image.to_rgba(value)[:3], (0.3, 0.6, 0.1))
            color = "white" if brightness < _DARK else "black"
            style = {"ha": "center", "va": "center", "fontsize": 7, "color": color}
            axis.text(column, line, f"{value:.3f}", **style)
    for status, corners in gaps.items():
        label = gap_label(status, len(corners))
        draw_empty_cells(axis, corners, (1, 1), status_mark(status), label)
    axis.set(xlabel=columns.scale.label, ylabel=lines.scale.label)
    axis.set_xticks(*columns.labels, rotation=20 if columns.is_long else 0)
    axis.set_yticks(*lines.labels)
    _legend_above(axis)


def draw_scatter(axis: "Axes", rows: Sequence[StudyRow], across: str, up: str) -> None:
    """Draw a point for each row: its duration as a colour, or a mark for the reason for none.

    Arguments as of `draw_map`, but for any rows.
    """
    scales = [ValueScale.of(path, [row.values[path] for row in rows]) for path in (across, up)]
    x, y = (scale.positions for scale in scales)
    durations = np.array([np.nan if row.duration is None else row.duration for row in rows])
    is_planned = np.isfinite(durations)
    scales[0].draw(axis, "x")
    scales[1].draw(axis, "y")
    if is_planned.any():
        options = {"cmap": duration_shades(), "edgecolors": "#444444"}
        drawn = axis.scatter(x[is_planned], y[is_planned], c=durations[is_planned], **options)
        _figure(axis).colorbar(drawn, ax=axis, label="duration [s]")
    for status in dict.fromkeys(row.status for row in rows if row.duration is None):
        of = np.array([row.status is status and row.duration is None for row in rows])
        mark, label = status_mark(status), gap_label(status, int(of.sum()))
        axis.plot(x[of], y[of], mark.marker, color=mark.color, label=label)
    axis.grid(alpha=0.25)
    _legend_above(axis)


class _Ticks:
    """The values along one side of a map: numbers in increasing order, others in their own."""

    def __init__(self, rows: Sequence[StudyRow], path: str) -> None:
        self._path = path
        by_text = {value_text(row.values[path]): row.values[path] for row in rows}
        self.scale = ValueScale.of(path, list(by_text.values()))
        order = np.argsort(self.scale.positions, kind="stable")
        self.values = [self.scale.values[k] for k in order]
        self._numbers = {value_text(value): k for k, value in enumerate(self.values)}

    def number(self, row: StudyRow) -> int:
        """Return the index of a row's value."""
        return self._numbers[value_text(row.values[self._path])]

    @property
    def labels(self) -> tuple[list[int], list[str]]:
        """Positions and texts of labels, as many as fit."""
        step = -(-len(self.values) // _MAX_TICKS)
        numbers = list(range(0, len(self.values), step))
        return numbers, [value_label(self.values[k]) for k in numbers]

    @property
    def is_long(self) -> bool:
        """True if labels are too long to stand side by side."""
        return sum(map(len, self.labels[1])) > _MAX_UPRIGHT


def _legend_above(axis: "Axes") -> None:
    """Draw the legend of marks above the panel, where nothing is hidden."""
    handles, labels = axis.get_legend_handles_labels()
    if handles:
        axis.legend(
            handles, labels, fontsize=8, ncols=2, loc="lower left", bbox_to_anchor=(0, 1.01)
        )


def _figure(axis: "Axes") -> "Figure":
    figure = axis.get_figure(root=True)
    assert figure is not None
    return figure
