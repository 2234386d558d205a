"""The figure of a comparison: durations with their certificates, and the tool's speed over time."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.studies.comparison import Comparison, ComparisonRow
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.palette import LINE_COLORS
from tubeplanner.views.panels import line_style, trajectory_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OTHERS = "#888888"  # of bars whose speed is not drawn
_LABEL_SPACE = 1.9  # of the longest bar: space for the text beside it


def plot_comparison(result: Comparison, path: str | Path | None = None) -> "Figure":
    """Draw what several methods make of a problem: durations, certificates, the tool's speed.

    Bars of trajectories that failed their certificate are hatched; the speeds are those of the
    fastest.

    Args:
        result: What `compare` found.
        path: Where to save the figure as PNG; None: nowhere.

    Raises:
        OutputError: The file could not be written.
    """
    rows = sorted(result.rows, key=lambda row: row.duration or float("inf"))
    figure = new_figure(13.0, 1.6 + 0.4 * max(len(rows), 7))
    figure.suptitle(f"{result.problem.name}: methods compared")
    bars, speed = figure.subplots(1, 2, width_ratios=(1.25, 1))
    _draw_durations(bars, rows)
    _draw_speeds(speed, result.problem, rows[: len(LINE_COLORS)])
    return saved(figure, path)


def _draw_durations(axis: "Axes", rows: list[ComparisonRow]) -> None:
    """Draw bars, hatched where the certificate failed, and say what it says."""
    from matplotlib.ticker import MaxNLocator

    longest = max((row.duration or 0.0 for row in rows), default=0.0) or 1.0
    for number, row in enumerate(rows):
        color = LINE_COLORS[number] if number < len(LINE_COLORS) else _OTHERS
        message = f"no trajectory: {str(row.status).replace('_', ' ')}"
        if row.duration is not None:
            (bar,) = axis.barh(number, row.duration, height=0.65, edgecolor=color)
            bar.set_facecolor(color if row.certified else "none")
            bar.set_hatch("" if row.certified else "///")
            verdict = "certified" if row.certified else f"fails: {', '.join(row.failures)}"
            message = f"{row.duration:.3f} s, {verdict}"
        axis.text((row.duration or 0.0) + 0.02 * longest, number, message, va="center", fontsize=8)
    axis.set_yticks(range(len(rows)), [row.method for row in rows])
    axis.invert_yaxis()
    axis.set_xticks([tick for tick in MaxNLocator(6).tick_values(0, longest) if tick <= longest])
    axis.set(xlabel="duration [s]", xlim=(0, _LABEL_SPACE * longest))
    axis.grid(alpha=0.25, axis="x")


def _draw_speeds(axis: "Axes", problem: PlanningProblem, rows: list[ComparisonRow]) -> None:
    """Draw the speed of the tool, as many trajectories as there are colours."""
    for number, row in enumerate(rows):
        if row.trajectory is not None:
            curves = trajectory_curves(problem, row.trajectory)
            style = line_style(number)
            axis.plot(curves.samples.time, curves.speed, label=row.method, **style)
    axis.set(xlabel="time [s]", ylabel="tool speed [m/s]", xlim=(0, None), ylim=(0, None))
    axis.grid(alpha=0.25)
    if axis.lines:
        above: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "ncols": 3}
        axis.legend(**above, fontsize=8, frameon=False, handlelength=2.8, columnspacing=1.2)
