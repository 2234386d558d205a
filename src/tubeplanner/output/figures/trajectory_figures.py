"""Figures of the motion of a trajectory and of a cycle."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.limits.lower_bound import lower_bound
from tubeplanner.limits.process_stretches import passed_marks, stretch_runs
from tubeplanner.output.curves import (
    Timeline,
    TrajectoryCurves,
    binding_strip,
    cycle_timeline,
    limited_sections,
    motion_curves,
)
from tubeplanner.output.drawing import segment_color
from tubeplanner.output.figures.figure_files import figure_grid, saved
from tubeplanner.output.figures.panels import (
    draw_clearance,
    draw_motors,
    draw_speed,
    draw_strip,
    mark_process,
    mark_segments,
    motor_joints,
    time_panels,
)
from tubeplanner.output.figures.space_panel import SpaceContent, draw_space
from tubeplanner.output.link_visuals import solids_at_tool
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.cycle import Cycle
from tubeplanner.task.motion import CycleMotion, Motion, ProblemMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.task.steps import Attach
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MAX_POSES, _SAME_PLACE = 3, 0.01  # poses of the arm; tools this near are at one place [m]


def plot_trajectory(
    problem: PlanningProblem, trajectory: JointTrajectory, path: str | Path | None = None
) -> "Figure":
    """Draw a trajectory against limits and tube, with the limits that bind and segments marked.

    First a strip with a row per joint, one of the tool and one of the links: a limit that is used
    to 98 % binds; the motion is not faster there, or takes no other way. Below it positions,
    velocities, efforts and, where limited, accelerations, jerks and effort rates; the speed of the
    tool, with the bands of stretches, and of other points with a limit, and the percentage of the
    tube that the tool uses; in all, stretches are shaded, and marks on the way are lines; the
    clearance, where any is judged; the arm at start and goal, and the tool's path in the tube;
    efforts over velocities, inside each motor's limits, of joints with friction or a torque-speed
    line.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    return plot_motion(ProblemMotion(problem, trajectory), path)


def plot_cycle(cycle: Cycle, motion: CycleMotion, path: str | Path | None = None) -> "Figure":
    """Draw the motion of a cycle against limits and tubes, with moves and rests marked.

    Positions, velocities, efforts with the carried parts, and their rates if limited, with the
    limits of each move; the speed of the tool, and the steps at rest; the tubes of all moves, and
    the percentage of the tolerance that the tool uses.

    Args:
        cycle: The cycle.
        motion: Its motion.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

    Raises:
        ProblemError: `cycle` is no Cycle.
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    Cycle.require(cycle)
    return plot_motion(replace(motion, cycle=cycle), path)


def plot_motion(motion: Motion, path: str | Path | None = None) -> "Figure":
    """Draw a motion as `plot_trajectory` or `plot_cycle`."""
    task, duration, is_cycle = motion.task, motion.trajectory.duration, bool(motion.marks)
    runs, sections = motion_curves(motion), limited_sections(motion)
    strip = binding_strip(sections, duration)
    draws = time_panels(runs)
    has_clearance = any(each.closest for each in sections)
    motors, rows = motor_joints(task.robot), len(strip.rows)
    has_motors = len(motors) > 0 and not is_cycle
    grid = figure_grid(rows, len(draws) + has_clearance, has_motors=has_motors)
    words = f"{duration:.4f} s", lower_bound(task).beside(duration)
    grid.figure.suptitle(f"{task.name}: {'; '.join(filter(None, words))}", fontsize=13)
    draw_strip(grid.strip, strip)
    for axis, draw in zip(grid.panels, draws, strict=False):
        spans = []
        for run in runs:
            draw(axis, run)
            spans.append(axis.get_ylim())
        if is_cycle:
            axis.set_ylim(min(low for low, _ in spans), max(high for _, high in spans))
    if has_clearance:
        draw_clearance(grid.panels[-1], sections)
    timeline = cycle_timeline(motion) if isinstance(motion, CycleMotion) else None
    for axis in (grid.strip, *grid.panels):
        if timeline is None:
            mark_segments(axis, runs[0], labels=axis is grid.strip)
        else:
            mark_moves(axis, timeline, duration, names=axis is grid.strip)
    stretches, passed = stretch_runs(motion.sections), passed_marks(motion.sections)
    for axis in (grid.strip, *grid.panels):
        is_speed = axis is grid.panels[draws.index(draw_speed)]
        mark_process(axis, stretches, passed, names=is_speed)
    grid.name_time()
    if timeline is not None:
        name_steps(grid.panels[draws.index(draw_speed)], timeline, duration)
    draw_space(grid.space, _space_content(motion, runs))
    if grid.motors is not None:
        draw_motors(grid.motors, runs[0], motors)
    return saved(grid.figure, path)


def _space_content(motion: Motion, runs: Sequence[TrajectoryCurves]) -> SpaceContent:
    """Return the arm at start and goal in the tube; of a cycle at junctions, in all tubes."""
    task, problems = motion.task, [each.problem for each in motion.sections]
    path = np.vstack([run.tool for run in runs])
    if not isinstance(motion, CycleMotion):
        ends, tubes = runs[0].samples.position[[0, -1]], [(problems[0].tube, None)]
        carried = [solids_at_tool(problems[0])] * 2
        return SpaceContent(task.robot, ends, carried, 1, path, tubes, task.obstacles)
    moves = [move for leg in motion.cycle.legs for move in leg.moves]
    of_moves = [(move.tube, segment_color(k)) for k, move in enumerate(moves)]
    handed_over = {step.name for step in motion.cycle.steps if isinstance(step, Attach)}
    junctions = np.array(motion.junctions)
    drawn = _far_apart(task.robot, junctions)
    # At a junction the arm has the parts of the next leg; at the end, those of the last.
    carried = [solids_at_tool(problems[min(k, len(problems) - 1)]) for k in drawn]
    content = task.robot, junctions[drawn], carried, 0, path, of_moves
    return SpaceContent(*content, task.obstacles, handed_over)


def _far_apart(robot: RobotModel, q: FloatArray) -> list[int]:
    """Return indices of a few configurations (N, n) with the tool far apart, the first first."""
    tool, indices = robot.tool_position(q), [0]
    while len(indices) < _MAX_POSES:
        away = np.linalg.norm(tool[:, None] - tool[indices], axis=2).min(axis=1)
        if away.max() < _SAME_PLACE:
            break
        indices.append(int(away.argmax()))
    return indices


# ---- Marks in the panels of a cycle's figures: its moves, and its steps at rest.

_STOP_COLOR = "#888888"
_LETTER = 0.009  # width of a letter of a name, of the panel
_MIN_LETTERS = 5
_LINE = 0.02  # height of a line of text, of the panel


def mark_moves(
    axis: "Axes", timeline: Timeline, duration: float, *, names: bool, letter: float = _LETTER
) -> None:
    """Shade a panel until a time [s] by moves, name moves on request, and mark stops and steps.

    A letter of a name is as wide as a fraction of the panel.
    """
    for band in timeline.bands:
        axis.axvspan(band.begin, band.end, color=band.color, alpha=0.10, linewidth=0, zorder=0)
        if names:
            transform = axis.get_xaxis_transform()
            middle, fraction = (band.begin + band.end) / 2, (band.end - band.begin) / duration
            name = shown_name(band.name, int(fraction / letter))
            axis.text(middle, 1.01, name, transform=transform, ha="center", fontsize=7)
    for stop in timeline.stops:
        axis.axvspan(stop.begin, stop.end, color=_STOP_COLOR, alpha=0.25, linewidth=0, zorder=0)
        for time, _ in stop.ticks:
            axis.axvline(time, color="#333333", linewidth=0.8)
    axis.set_xlim(0.0, duration)
    axis.set_xlabel("time [s]")
    axis.grid(alpha=0.25)


def name_steps(axis: "Axes", timeline: Timeline, duration: float) -> None:
    """Name the steps at rest in a panel whose lines are at zero there."""
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
    """Return a name in at most a number of letters: whole, cut, or empty if little would remain."""
    if len(name) <= letters:
        return name
    return f"{name[: letters - 2]}..." if letters >= _MIN_LETTERS else ""
