"""Figures 3, 7, 8, 9 of Suh & Bishop (1988) from our trajectories."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.output.curves import TrajectoryCurves, trajectory_curves
from tubeplanner.output.drawing import LINE_COLORS, REFERENCE_COLOR
from tubeplanner.output.figures.figure_files import new_figure
from tubeplanner.output.figures.panels import LIMIT, draw_factor, line_style
from tubeplanner.planning.options import REFINEMENT, SUH_BISHOP
from tubeplanner.studies.reproduction import (
    CONVENTIONAL,
    FIGURE_SEVEN,
    NO_TUBE,
    TABLE_FOUR,
    TABLE_THREE,
    PrintedLine,
    ReproducedCell,
    Reproduction,
)
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TUBE: dict[str, Any] = {"facecolor": LINE_COLORS[5], "alpha": 0.25, "linewidth": 0}
METHOD_TITLES = {SUH_BISHOP: "as published", REFINEMENT: "default method"}
_FIGURE_THREE = (5, 0.03)  # example and tolerance [m]
_SCHEMES = {
    CONVENTIONAL: "straight lines, stops",
    "bounded-deviation": "bounded deviation (Taylor)",
    "arc-corners": "arcs at corners",
}


def schemes_figure(reproduction: Reproduction) -> "Figure":
    """Draw figure 3: the paths of the earlier schemes and of our methods, in the tube."""
    example, radius = _FIGURE_THREE
    cell = reproduction.cells[example, radius]
    figure = new_figure(7.5, 7.5)
    axis = figure.add_subplot()
    _draw_tube(axis, cell.problem.tube)
    paths = reproduction.paths[example]
    drawn: dict[str, JointTrajectory | str]
    drawn = {title: paths[scheme] for scheme, title in _SCHEMES.items()}
    for method, title in METHOD_TITLES.items():
        drawn[title] = cell.result(method).trajectory or cell.result(method).message
    for number, (name, trajectory) in enumerate(drawn.items()):
        if isinstance(trajectory, JointTrajectory):
            tool = trajectory_curves(cell.problem, trajectory).tool[:, :2]
            axis.plot(*tool.T, label=f"{name}: {trajectory.duration:.2f} s", **line_style(number))
    axis.set_title(f"Figure 3: example {example}, tolerance {1000 * radius:.0f} mm")
    _finish_plane(axis)
    axis.set_aspect("equal")
    axis.legend(fontsize=8, loc="center left")
    return figure


def speeds_figure(reproduction: Reproduction) -> "Figure":
    """Draw figure 7: the speed of the tool over time, for several tolerances."""
    figure = new_figure(11.0, 4.5)
    figure.suptitle("Figure 7: speed of the tool on example 1")
    axes = figure.subplots(1, 2, sharey=True)
    for axis, (method, title) in zip(axes, METHOD_TITLES.items(), strict=True):
        for number, radius in enumerate(FIGURE_SEVEN):
            curves = _curves(reproduction.cells[1, radius], method)
            if curves is not None:
                label = f"{1000 * radius:.0f} mm: {curves.samples.time[-1]:.2f} s"
                axis.plot(curves.samples.time, curves.speed, label=label, **line_style(number))
        conventional = reproduction.paths[1][CONVENTIONAL]
        if isinstance(conventional, JointTrajectory):
            problem = reproduction.cells[1, 0.01].problem
            slow = trajectory_curves(problem, conventional)
            label = f"conventional: {conventional.duration:.2f} s"
            axis.plot(slow.samples.time, slow.speed, label=label, **{**LIMIT, "linewidth": 1.4})
        axis.set(title=title, xlabel="time [s]")
        axis.grid(alpha=0.25)
        axis.legend(fontsize=8)
    axes[0].set_ylabel("tool speed [m/s]")
    return figure


def line_figure(reproduction: Reproduction, table: PrintedLine, name: str) -> "Figure":
    """Draw figure 8 or 9: tool paths, b(t) and torques for several tolerances."""
    figure = new_figure(17.0, 8.6)
    figure.suptitle(f"{name}: example {table.example}'s line at several tolerances")
    axes = figure.subplots(2, 4, width_ratios=(1.1, 1, 1, 1))
    radii = [radius for radius in (*table.shown, NO_TUBE) if radius in table.durations]
    for row, (method, title) in zip(axes, METHOD_TITLES.items(), strict=True):
        widest = reproduction.cells[table.example, table.shown[-1]]
        _draw_tube(row[0], widest.problem.tube)
        for number, radius in enumerate(radii):
            curves = _curves(reproduction.cells[table.example, radius], method)
            if curves is not None:
                tolerance = "no tube" if radius == NO_TUBE else f"{1000 * radius:.0f} mm"
                label = f"{tolerance}: {curves.samples.time[-1]:.2f} s"
                _draw_trajectory(row, curves, label, number)
        row[0].set_title(f"{title} (x and y to different scales)", fontsize=10)
        _finish_plane(row[0])
        row[1].legend(fontsize=8, loc="upper center")
    return figure


def _draw_trajectory(
    row: Sequence["Axes"], curves: TrajectoryCurves, label: str, number: int
) -> None:
    style = line_style(number)
    row[0].plot(*curves.tool[:, :2].T, label=label, **style)
    draw_factor(row[1], curves, label, number)
    for j, axis in enumerate(row[2:]):
        axis.plot(curves.samples.time, curves.effort[:, j], **style)
        limit = curves.problem.robot.limits.effort[j]
        for bound in (-limit, limit):
            axis.axhline(bound, **LIMIT)
        axis.set(xlabel="time [s]", ylabel=f"torque of joint {j + 1} [N m]")
        axis.grid(alpha=0.25)


def _finish_plane(axis: "Axes") -> None:
    axis.set(xlabel="x [m]", ylabel="y [m]")
    axis.grid(alpha=0.25)


def _draw_tube(axis: "Axes", tube: Tube) -> None:
    """Draw the outline of a tube in the plane, and its reference path."""
    from matplotlib.patches import FancyBboxPatch
    from matplotlib.transforms import Affine2D

    ends = zip(tube.points[:-1, :2], tube.points[1:, :2], tube.effective_radius, strict=True)
    for begin, end, radius in ends:
        line = end - begin
        length = float(np.linalg.norm(line))
        rotation = Affine2D().rotate(np.arctan2(line[1], line[0])).translate(*begin)
        options = {"transform": rotation + axis.transData, **_TUBE}
        corner, style = (-radius, -radius), f"round,pad=0,rounding_size={radius}"
        capsule = FancyBboxPatch(corner, length + 2 * radius, 2 * radius, style, **options)
        axis.add_patch(capsule)
    axis.plot(*tube.points[:, :2].T, color=REFERENCE_COLOR, linewidth=1, linestyle="--")


def _curves(cell: ReproducedCell, method: str) -> TrajectoryCurves | None:
    trajectory = cell.result(method).trajectory
    return None if trajectory is None else trajectory_curves(cell.problem, trajectory)


# By file name: caption and drawing function.
FIGURES: dict[str, tuple[str, Callable[[Reproduction], "Figure"]]] = {
    "figure_3": ("Figure 3: the tool's paths by the earlier schemes, and freer", schemes_figure),
    "figure_7": ("Figure 7: the speed of the tool", speeds_figure),
    "figure_8": (
        "Figure 8: tool paths, b(t) and torques on the first line",
        partial(line_figure, table=TABLE_THREE, name="Figure 8"),
    ),
    "figure_9": (
        "Figure 9: tool paths, b(t) and torques on the second line",
        partial(line_figure, table=TABLE_FOUR, name="Figure 9"),
    ),
}
