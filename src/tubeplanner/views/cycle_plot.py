"""The figure of a cycle: all joints against their limits, what happens when, use of the tubes."""

from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.views.cycle_curves import cycle_curves
from tubeplanner.views.cycle_timeline import Timeline, cycle_timeline
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.palette import segment_color
from tubeplanner.views.panels import (
    TrajectoryCurves,
    draw_effort_rates,
    draw_efforts,
    draw_points,
    draw_positions,
    draw_speed,
    draw_tube_use,
    draw_velocities,
)
from tubeplanner.views.space_panel import (
    draw_arm,
    draw_obstacles,
    draw_path,
    draw_segments,
    frame_panel,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STOP_COLOR = "#888888"
_LETTER = 0.009  # of the panel: what a letter of a name is wide
_FEWEST_LETTERS = 5
_LINE = 0.02  # of the panel: what a line of text is high


def plot_cycle(cycle: Cycle, motion: CycleMotion, path: str | Path | None = None) -> "Figure":
    """Draw the motion of a cycle against limits and tubes, its moves and rests marked.

    Positions, velocities, efforts with what is carried then, and their rates if a limit is asked,
    with the limits of each move; the speed of the tool, and what happens at rest; the tubes of all
    moves, and what share of the tolerance the tool uses.

    Args:
        cycle: The cycle.
        motion: Its motion.
        path: Where to save the figure as PNG; None: nowhere.

    Returns:
        The figure.

    Raises:
        ProblemError: The cycle is none.
        OutputError: The file could not be written.
    """
    Cycle.require(cycle)
    runs, timeline = cycle_curves(cycle, motion), cycle_timeline(motion)
    draws = [draw_positions, draw_velocities, draw_efforts]
    draws += [draw_effort_rates] if any(run.effort_rate is not None for run in runs) else []
    draws += [draw_points] if any(run.points.size for run in runs) else []
    draws.append(draw_speed)
    rows = len(draws)
    figure = new_figure(13.5, 2.7 * rows)
    duration = motion.trajectory.duration
    figure.suptitle(f"{cycle.name}: {duration:.4f} s", fontsize=13)
    grid = figure.add_gridspec(rows, 2, width_ratios=(1.25, 1))
    left = [figure.add_subplot(grid[row, 0]) for row in range(rows)]
    space = figure.add_subplot(grid[: rows - 1, 1], projection="3d")
    use = figure.add_subplot(grid[-1, 1])
    for axis, draw in zip([*left, use], [*draws, draw_tube_use], strict=True):
        _draw_runs(axis, draw, runs)
        _mark_moves(axis, timeline, duration, names=axis in (left[0], left[-1], use))
    _name_steps(left[-1], timeline, duration)
    _draw_space(space, cycle, motion, runs)
    return saved(figure, path)


def _draw_runs(
    axis: "Axes",
    draw: Callable[["Axes", TrajectoryCurves], None],
    runs: Sequence[TrajectoryCurves],
) -> None:
    """Draw curves one after the other, all in sight."""
    seen = []
    for run in runs:
        draw(axis, run)
        seen.append(axis.get_ylim())
    axis.set_ylim(min(low for low, _ in seen), max(high for _, high in seen))


def _mark_moves(axis: "Axes", timeline: Timeline, duration: float, *, names: bool) -> None:
    """Shade a panel over time by moves, name them if asked, and mark what happens at rest."""
    for band in timeline.bands:
        axis.axvspan(band.begin, band.end, color=band.color, alpha=0.10, linewidth=0, zorder=0)
        if names:
            place = axis.get_xaxis_transform()
            middle, share = (band.begin + band.end) / 2, (band.end - band.begin) / duration
            name = shown_name(band.name, int(share / _LETTER))
            axis.text(middle, 1.01, name, transform=place, ha="center", fontsize=7)
    for stop in timeline.stops:
        axis.axvspan(stop.begin, stop.end, color=_STOP_COLOR, alpha=0.25, linewidth=0, zorder=0)
        for time, _ in stop.ticks:
            axis.axvline(time, color="#333333", linewidth=0.8)
    axis.set_xlim(0.0, duration)
    axis.set_xlabel("time [s]")
    axis.grid(alpha=0.25)


def _name_steps(axis: "Axes", timeline: Timeline, duration: float) -> None:
    """Name what happens at rest in a panel whose lines are at zero then."""
    before = -duration
    for stop in timeline.stops:
        for time, ticks in groupby(stop.ticks, lambda tick: tick[0]):
            is_last = time > 0.97 * duration  # its name goes before it
            before = time if is_last else max(time, before + _LINE * duration)
            axis.annotate(
                ", ".join(text for _, text in ticks),
                (before, 0.97),
                (-2 if is_last else 2, 0),
                xycoords=axis.get_xaxis_transform(),
                textcoords="offset points",
                rotation=90,
                fontsize=7,
                ha="right" if is_last else "left",
                va="top",
            )


def shown_name(name: str, letters: int) -> str:
    """Return a name in at most so many letters: whole, cut, or nothing if little is left."""
    if len(name) <= letters:
        return name
    return f"{name[: letters - 2]}..." if letters >= _FEWEST_LETTERS else ""


def _draw_space(
    axis: Any, cycle: Cycle, motion: CycleMotion, runs: Sequence[TrajectoryCurves]
) -> None:
    """Draw tubes in the colours of their moves, what stands there at first, the arm at seams."""
    moves = [move for leg in cycle.legs for move in leg.moves]
    for k, move in enumerate(moves):
        color = segment_color(k)
        draw_segments(axis, move.tube, slice(0, move.tube.segment_count), color)
        style: dict[str, Any] = {"color": color, "linewidth": 1, "linestyle": "--"}
        axis.plot(*move.tube.points.T, label=move.name, **style)
    draw_obstacles(axis, cycle.obstacles)
    draw_path(axis, np.vstack([run.tool for run in runs]))
    low, high = draw_arm(axis, runs[0].problem, np.array(motion.seams))
    frame_panel(axis, [move.tube for move in moves], low, high)
