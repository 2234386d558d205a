"""The figure of a comparison: a row per method with its duration, verdict and the tool's speed."""

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill, shorten
from typing import TYPE_CHECKING, Any

from tubeplanner.arrays import FloatArray
from tubeplanner.studies.comparison import Comparison, ComparisonRow
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.palette import LINE_COLORS, WARNING_COLOR
from tubeplanner.views.stretch import trajectory_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _ROW, _AROUND = 13.0, 0.56, 1.35  # all of these [inches]
_EDGE, _TITLE = 0.08, 0.4  # free at the borders, and for the title; inches too
_LETTERS, _LINES = 34, 2  # of a verdict
# Solid and hatched, so that grey print tells them apart too.
_CERTIFIED: dict[str, Any] = {"facecolor": LINE_COLORS[0], "edgecolor": LINE_COLORS[0]}
_FAILED: dict[str, Any] = {"facecolor": "white", "edgecolor": WARNING_COLOR, "hatch": "////"}
_FASTEST_SPEED: dict[str, Any] = {"color": "#D4D4D4", "linewidth": 0}


def plot_comparison(result: Comparison, path: str | Path | None = None) -> "Figure":
    """Draw what several methods make of a problem, a row for each, the fastest first.

    Bars are durations: solid if certified, hatched if not, with the conditions that fail named;
    without a motion the row says why. Beside each is the speed of its tool, over that of the
    fastest certified motion in grey.

    Args:
        result: What `compare` found.
        path: Where to save the figure, as PNG, PDF or SVG by its ending; None: nowhere.

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
    # Without space between the panels each is as high as its bar's row.
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
    """Draw bars, and beside them what is to be said of each."""
    for number, row in enumerate(rows):
        if row.duration is not None:
            axis.barh(number, row.duration, 0.6, **(_CERTIFIED if row.certified else _FAILED))
        place: dict[str, Any] = {"transform": axis.get_yaxis_transform(), "va": "center"}
        verdict = _verdict(row, is_fastest=row is fastest)
        axis.text(1.02, number, verdict, fontsize=8.5, parse_math=False, **place)
    axis.set_yticks(range(len(rows)), [row.method for row in rows])
    axis.set_ylim(len(rows) - 0.5, -0.5)
    axis.tick_params(axis="y", length=0)
    axis.set(xlabel="duration [s]")
    axis.set_xlim(0.0, None if any(row.duration for row in rows) else 1.0)
    axis.set_axisbelow(True)
    axis.grid(alpha=0.25, axis="x")


def _verdict(row: ComparisonRow, *, is_fastest: bool) -> str:
    """Return duration and verdict of a row, or why there is no motion, on few lines."""
    if row.duration is None:
        said = f"no motion: {row.message}"
    elif row.certified:
        said = f"{row.duration:.4f} s, certified{', the fastest' * is_fastest}"
    else:
        said = f"{row.duration:.4f} s, fails: {', '.join(row.failures)}"
    return fill(shorten(said, _LINES * (_LETTERS - 4), placeholder=" ..."), _LETTERS)


def _draw_speeds(
    axes: Sequence["Axes"],
    result: Comparison,
    rows: Sequence[ComparisonRow],
    fastest: ComparisonRow | None,
) -> None:
    """Draw the speed of the tool in a panel per row, all to the same scales."""
    speeds = [_speed(result, row) for row in rows]
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
    known = [speed for speed in speeds if speed is not None]
    end = max((float(time[-1]) for time, _ in known), default=1.0)
    top = max((float(speed.max()) for _, speed in known), default=1.0) or 1.0
    axes[0].set_xlim(0.0, 1.02 * end)
    axes[0].set_ylim(0.0, 1.2 * top)
    axes[0].set_yticks([_round_below(top)])
    grey = "" if fastest is None else f"; grey: {fastest.method}"
    axes[0].set_title(f"tool speed [m/s]{grey}", fontsize=9.5, loc="left")
    axes[-1].set_xlabel("time [s]")


def _speed(result: Comparison, row: ComparisonRow) -> tuple[FloatArray, FloatArray] | None:
    """Return times [s] and speeds of the tool [m/s], (N,) each; None without a motion."""
    if row.trajectory is None:
        return None
    curves = trajectory_curves(result.problem, row.trajectory)
    return curves.samples.time, curves.speed


def _round_below(value: float) -> float:
    """Return the largest number with one digit that is at most a positive value."""
    digit, power = f"{value:e}".split("e")
    return float(f"{digit[0]}e{power}")
