"""The figure of a cycle: all joints against their limits, what happens when, use of the tubes."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.cycle.cycle_motion import CycleMotion
from tubeplanner.cycle.steps import Attach
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.views.binding_strip import binding_strip
from tubeplanner.views.clearance_panel import draw_clearance
from tubeplanner.views.cycle_curves import cycle_curves, limited_motions
from tubeplanner.views.cycle_marks import mark_moves, name_steps
from tubeplanner.views.cycle_timeline import cycle_timeline
from tubeplanner.views.figure_files import saved
from tubeplanner.views.figure_grid import figure_grid
from tubeplanner.views.palette import segment_color
from tubeplanner.views.panels import draw_speed
from tubeplanner.views.space_panel import SpaceContent, draw_space
from tubeplanner.views.stretch import TrajectoryCurves
from tubeplanner.views.strip_panel import draw_strip
from tubeplanner.views.time_panels import time_panels

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_POSES, _SAME_PLACE = 3, 0.01  # poses of the arm; tools this near are at one place [m]


def plot_cycle(cycle: Cycle, motion: CycleMotion, path: str | Path | None = None) -> "Figure":
    """Draw the motion of a cycle against limits and tubes, its moves and rests marked.

    Positions, velocities, efforts with what is carried then, and their rates if a limit is asked,
    with the limits of each move; the speed of the tool, and what happens at rest; the tubes of all
    moves, and what share of the tolerance the tool uses.

    Args:
        cycle: The cycle.
        motion: Its motion.
        path: Where to save the figure, as PNG, PDF or SVG by its ending; None: nowhere.

    Returns:
        The figure.

    Raises:
        ProblemError: The cycle is none.
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    Cycle.require(cycle)
    runs, timeline = cycle_curves(cycle, motion), cycle_timeline(motion)
    motions, duration = limited_motions(cycle, motion), motion.trajectory.duration
    strip = binding_strip(motions, duration)
    draws = time_panels(runs)
    has_clearance = any(each.closest for each in motions)
    grid = figure_grid(len(strip.rows), len(draws) + has_clearance, has_motors=False)
    grid.figure.suptitle(f"{cycle.name}: {duration:.4f} s", fontsize=13)
    draw_strip(grid.strip, strip)
    for axis, draw in zip(grid.panels, draws, strict=False):
        _draw_runs(axis, draw, runs)
    if has_clearance:
        draw_clearance(grid.panels[-1], motions)
    for axis in (grid.strip, *grid.panels):
        mark_moves(axis, timeline, duration, names=axis is grid.strip)
    grid.name_time()
    name_steps(grid.panels[draws.index(draw_speed)], timeline, duration)
    _draw_space(grid.space, cycle, motion, runs, [each.problem for each in motions])
    return saved(grid.figure, path)


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


def _draw_space(
    axis: "Axes",
    cycle: Cycle,
    motion: CycleMotion,
    runs: Sequence[TrajectoryCurves],
    problems: Sequence[PlanningProblem],
) -> None:
    """Draw tubes in the colours of their moves, what stands there at first, the arm at seams."""
    moves = [move for leg in cycle.legs for move in leg.moves]
    tubes = [(move.tube, segment_color(k)) for k, move in enumerate(moves)]
    handed_over = {step.name for step in cycle.steps if isinstance(step, Attach)}
    path = np.vstack([run.tool for run in runs])
    seams = np.array(motion.seams)
    shown = _far_apart(cycle.robot, seams)
    # At a seam the arm has what it carries afterwards; at the end, what it carried there.
    carried = [problems[min(k, len(problems) - 1)].attached for k in shown]
    draw_space(
        axis,
        SpaceContent(
            cycle.robot, seams[shown], carried, 0, path, tubes, cycle.obstacles, handed_over
        ),
    )


def _far_apart(robot: RobotModel, q: FloatArray) -> list[int]:
    """Return which of configurations (N, n) are a few with the tool far apart, the first first."""
    tool, chosen = robot.tool_position(q), [0]
    while len(chosen) < _MAX_POSES:
        away = np.linalg.norm(tool[:, None] - tool[chosen], axis=2).min(axis=1)
        if away.max() < _SAME_PLACE:
            break
        chosen.append(int(away.argmax()))
    return chosen
