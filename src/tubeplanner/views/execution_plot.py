"""The figure of an execution: the tool's paths in the tube, and what is left of tolerances."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.simulation.execution import Execution
from tubeplanner.simulation.judged_runs import JudgedRun
from tubeplanner.simulation.run_verdict import run_verdict
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.views.executed_planes import RING, draw_planes
from tubeplanner.views.execution_curves import Band, ToolRuns, obstacle_band, tool_runs
from tubeplanner.views.execution_panels import draw_band, draw_margin, draw_saturation
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.panels import mark_segments
from tubeplanner.views.stretch import trajectory_curves

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TITLE_WIDTH = 140  # [characters]


def plot_execution(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    execution: Execution,
    judged: Sequence[JudgedRun],
    path: str | Path | None = None,
) -> "Figure":
    """Draw how arms executed a trajectory: the tool in the tube, and what is left over time.

    Left the tool's paths in one or two planes and close up, in another colour where they leave
    the tube. Right, over time, of
    the plan and of all runs: how far inside the tube the tool is; how far inside the rotation
    tolerance, if there is one; how far links are from obstacles, if there are some; how far the
    tool is from the plan; and in what share of the runs each motor is at its limit.

    Args:
        problem: The planning problem.
        trajectory: What was to be executed.
        execution: What was.
        judged: What `judged_runs` says of that.
        path: Where to save the figure, as PNG, PDF or SVG by its ending; None: nowhere.

    Returns:
        The figure.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    tools = tool_runs(problem, trajectory, execution)
    draws = _over_time(problem, trajectory, execution, tools)
    whole = new_figure(14.0, max(2.4 + 1.75 * len(draws), 9.0))
    whole.suptitle(_title(problem, trajectory.duration, judged), fontsize=13)
    left, right = whole.subfigures(1, 2, squeeze=False, width_ratios=(1, 1.25))[0]
    draw_planes(left, problem, tools)
    heights = [1.7, *([1.0] * (len(draws) - 1))]
    axes = right.subplots(len(draws), 1, sharex=True, height_ratios=heights)
    curves = trajectory_curves(problem, trajectory)
    for axis, draw in zip(axes, draws, strict=True):
        draw(axis)
        mark_segments(axis, curves, labels=axis is axes[0], until=float(execution.time[-1]))
        axis.set_xlabel("time [s]" if axis is axes[-1] else "")
    _mark_worst(axes[0], tools, trajectory.duration)
    handles, labels = axes[0].get_legend_handles_labels()
    right.legend(handles, labels, fontsize=8, ncols=4, loc="outside upper center", frameon=False)
    return saved(whole, path)


def _mark_worst(axis: "Axes", tools: ToolRuns, duration: float) -> None:
    """Mark the run and the instant that the planes mark, and where the goal is held."""
    when = tools.tube.time[tools.worst[1]]
    axis.scatter(when, 1000 * tools.tube.runs[tools.worst], **RING)
    end = (duration + tools.tube.time[-1]) / 2
    axis.text(end, 1.01, "held", transform=axis.get_xaxis_transform(), ha="center", fontsize=7)


def _title(problem: PlanningProblem, duration: float, judged: Sequence[JudgedRun]) -> str:
    """Return what was planned, and what was seen."""
    verdict = fill(str(run_verdict(judged)), _TITLE_WIDTH)
    return f"{problem.name}: {duration:.4f} s, executed\n{verdict}"


def _over_time(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    execution: Execution,
    tools: ToolRuns,
) -> list[Callable[["Axes"], None]]:
    """Return what draws the panels over time, from top to bottom."""
    draws: list[Callable[[Axes], None]]
    draws = [partial(draw_margin, band=tools.tube, label="inside the tube [mm]")]
    if tools.rotation is not None:
        label = "inside the rotation\ntolerance [mrad]"
        draws.append(partial(draw_margin, band=tools.rotation, label=label))
    distance = obstacle_band(problem, trajectory, execution)
    if distance is not None:
        label, least = "distance from\nobstacles [mm]", problem.clearance
        draws.append(partial(draw_margin, band=distance, label=label, least=least))
    away = np.linalg.norm(tools.runs - tools.plan, axis=2)
    tracking = Band(execution.time, np.zeros(len(execution.time)), away)
    draws.append(partial(draw_band, band=tracking, label="tool from\nthe plan [mm]"))
    look = partial(draw_saturation, robot=problem.robot, time=execution.time)
    draws.append(partial(look, is_saturated=execution.is_saturated))
    return draws
