"""The figure of a comparison: durations with their certificates, and the hand's speed over time."""

from pathlib import Path
from typing import TYPE_CHECKING

from tubeplanner.comparison import Comparison, ComparisonRow
from tubeplanner.figure_files import new_figure, saved
from tubeplanner.palette import LINE_COLORS
from tubeplanner.panels import line_style, motion_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROOM = 1.9  # of the longest bar: what is said beside it needs as much


def plot_comparison(result: Comparison, path: str | Path | None = None) -> "Figure":
    """Draw what several methods make of a problem: durations, certificates, the hand's speed.

    Bars of motions that failed their certificate are hatched.

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
    for number, row in enumerate(rows):
        if row.trajectory is not None:
            curves = motion_curves(result.problem, row.trajectory)
            time, style = curves.samples.time, line_style(number)
            speed.plot(time, curves.speed, label=row.method, **style)
    speed.set(xlabel="time [s]", ylabel="hand speed [m/s]", xlim=(0, None), ylim=(0, None))
    speed.grid(alpha=0.25)
    if speed.lines:
        speed.legend(fontsize=8, handlelength=3.5)
    return saved(figure, path)


def _draw_durations(axis: "Axes", rows: list[ComparisonRow]) -> None:
    longest = max((row.duration or 0.0 for row in rows), default=0.0) or 1.0
    for number, row in enumerate(rows):
        color = LINE_COLORS[number % len(LINE_COLORS)]
        if row.duration is None:
            said = f"no motion: {str(row.status).replace('_', ' ')}"
        else:
            how = {"color": color} if row.certified else {"facecolor": "none", "edgecolor": color}
            axis.barh(
                number, row.duration, height=0.65, hatch="" if row.certified else "///", **how
            )
            failed = ", ".join(row.failures)
            verdict = "certified" if row.certified else f"fails: {failed}"
            said = f"{row.duration:.3f} s, {verdict}"
        axis.text((row.duration or 0.0) + 0.02 * longest, number, said, va="center", fontsize=8)
    axis.set_yticks(range(len(rows)), [row.method for row in rows])
    axis.invert_yaxis()
    axis.set(xlabel="duration [s]", xlim=(0, _ROOM * longest))
    axis.grid(alpha=0.25, axis="x")
