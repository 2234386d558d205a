"""Figures of executed trajectories and cycles: tool paths in section, margins over time."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.execution.run_verdict import (
    ExecutedLeg,
    JudgedCycle,
    JudgedRun,
    executed_legs,
    run_verdict,
)
from tubeplanner.execution.simulation import Execution
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.output.curves import cycle_timeline, segments_per_group, trajectory_curves
from tubeplanner.output.drawing import (
    EXECUTED_COLOR,
    OBSTACLE_COLOR,
    WARNING_COLOR,
    region_grid,
    rgb,
    segment_color,
    shape_points,
)
from tubeplanner.output.execution_curves import (
    Band,
    ExecutedPaths,
    ToolRuns,
    executed_paths,
    holding_band,
    obstacle_band,
    tool_runs,
)
from tubeplanner.output.figures.figure_files import new_figure, saved
from tubeplanner.output.figures.panels import LIMIT, mark_segments
from tubeplanner.output.figures.trajectory_figures import mark_moves, name_steps
from tubeplanner.robot.model import RobotModel
from tubeplanner.task.motion import CycleMotion, Motion, ProblemMotion
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

_TITLE_WIDTH = 140  # [characters]
_CYCLE_TITLE_WIDTH = 110
_LETTER = 0.0055  # width of a letter of a name, of the panel


def plot_execution(
    problem: PlanningProblem,
    trajectory: JointTrajectory,
    execution: Execution,
    judged: Sequence[JudgedRun],
    path: str | Path | None = None,
) -> "Figure":
    """Draw an executed trajectory: the tool in the tube, and margins over time.

    Left the tool's paths in one or two planes and close up, in another colour where they leave
    the tube. Right, over time, of the plan and of all runs: the tool's margin inside the tube; its
    margin inside the rotation tolerance, if there is one; the distance of links from obstacles, if
    there are any; the spare share of what contacts carry, if a part is held; the tool's distance
    from the plan; the percentage of runs with each motor at its limit.

    Args:
        problem: The planning problem.
        trajectory: The planned trajectory.
        execution: Its simulated runs.
        judged: Verdicts of `judged_runs` on them.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    motion = ProblemMotion(problem, trajectory)
    return plot_executed_motion(motion, execution, judged, path)


def plot_cycle_execution(
    motion: CycleMotion, execution: Execution, judged: JudgedCycle, path: str | Path | None = None
) -> "Figure":
    """Draw an executed cycle: margins over time.

    Of the plan and of all runs: the tool's margin inside the tube of its move; its margin inside
    the rotation tolerance, if there is one; the distance of links from obstacles beyond the
    required clearance, if there are any; the tool's distance from the plan; the percentage of runs
    with each motor at its limit. Lines and names mark the steps at rest.

    Args:
        motion: The planned motion.
        execution: Its simulated runs.
        judged: Verdict of `judged_cycle` on them.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    return plot_executed_motion(motion, execution, judged.runs, path)


def plot_executed_motion(
    motion: Motion,
    execution: Execution,
    judged: Sequence[JudgedRun],
    path: str | Path | None = None,
) -> "Figure":
    """Draw an executed motion as `plot_execution` or `plot_cycle_execution`."""
    legs = executed_legs(motion, execution)
    tools = [tool_runs(leg.problem, leg.trajectory, leg.execution) for leg in legs]
    draws, is_cycle = _over_time(execution, legs, tools), bool(motion.marks)
    count, duration, end = len(draws), motion.trajectory.duration, float(execution.time[-1])
    whole = new_figure(14.0, 2.0 + 1.9 * count if is_cycle else max(2.4 + 1.75 * count, 9.0))
    verdict = fill(str(run_verdict(judged)), _CYCLE_TITLE_WIDTH if is_cycle else _TITLE_WIDTH)
    title = f"{motion.task.name}: {duration:.4f} s, executed\n{verdict}"
    whole.suptitle(title, fontsize=13)
    figure: FigureBase = whole
    heights = [1.0] * count
    if not is_cycle:
        left, figure = whole.subfigures(1, 2, squeeze=False, width_ratios=(1, 1.25))[0]
        draw_planes(left, legs[0].problem, tools[0])
        heights[0] = 1.7
    axes = figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
    for axis, draw in zip(axes, draws, strict=True):
        draw(axis)
    if isinstance(motion, CycleMotion):
        timeline = cycle_timeline(motion)
        for axis in axes:
            mark_moves(axis, timeline, end, names=axis is axes[0], letter=_LETTER)
        name_steps(axes[-2], timeline, end)  # where curves are low at rest: the tool from the plan
    else:
        curves = trajectory_curves(legs[0].problem, motion.trajectory)
        for axis in axes:
            mark_segments(axis, curves, labels=axis is axes[0], until=end)
        # The panel of the tube marks the run and the instant that the planes mark.
        tube, worst = tools[0].tube, tools[0].worst
        axes[0].scatter(tube.time[worst[1]], 1000 * tube.runs[worst], **RING)
        options = {"transform": axes[0].get_xaxis_transform(), "ha": "center", "fontsize": 7}
        axes[0].text((duration + tube.time[-1]) / 2, 1.01, "held", **options)
    for axis in axes:
        axis.set_xlabel("time [s]" if axis is axes[-1] else "")
    handles, labels = axes[0].get_legend_handles_labels()
    options = {"loc": f"outside {'lower' if is_cycle else 'upper'} center", "frameon": False}
    figure.legend(handles, labels, fontsize=8, ncols=4, **options)
    return saved(whole, path)


def _over_time(
    execution: Execution, legs: Sequence[ExecutedLeg], tools: Sequence[ToolRuns]
) -> list[Callable[["Axes"], None]]:
    """Return the functions that draw the panels over time, from top to bottom."""
    is_cycle, problem = legs[0].leg is not None, legs[0].problem
    distances: list[Band | None] = []
    spare: list[Band | None] = []
    for leg in legs:
        share = holding_band(leg.problem, leg.trajectory, leg.execution)
        # Panels are in thousandths; these are percent.
        spare.append(share and Band(share.time, share.plan / 10, share.runs / 10))
        band = obstacle_band(leg.problem, leg.trajectory, leg.execution)
        if band is not None and is_cycle:  # each leg requires a clearance of its own
            required = leg.problem.clearance
            band = Band(band.time, band.plan - required, band.runs - required)
        distances.append(band)
    word = "clearance beyond\nthe required" if is_cycle else "distance from\nobstacles"
    least = 0.0 if is_cycle else problem.clearance
    margins: tuple[tuple[str, float, list[Band | None]], ...] = (
        ("inside the tube [mm]", 0.0, [tool.tube for tool in tools]),
        ("inside the rotation\ntolerance [mrad]", 0.0, [tool.rotation for tool in tools]),
        (f"{word} [mm]", least, distances),
        ("spare of what\ncontacts carry [%]", 0.0, spare),
    )
    draws: list[Callable[[Axes], None]] = [
        partial(draw_margin, band=_joined(legs, bands), label=label, least=bound)
        for label, bound, bands in margins
        if any(band is not None for band in bands)
    ]
    tracking = [
        Band(leg.execution.time, 0 * leg.execution.time, away)
        for leg, tool in zip(legs, tools, strict=True)
        for away in [np.linalg.norm(tool.runs - tool.plan, axis=2)]
    ]
    draws.append(partial(draw_band, band=_joined(legs, tracking), label="tool from\nthe plan [mm]"))
    options = partial(draw_saturation, robot=problem.robot, time=execution.time)
    return [*draws, partial(options, is_saturated=execution.is_saturated)]


def _joined(legs: Sequence[ExecutedLeg], bands: Sequence[Band | None]) -> Band:
    """Return the bands of all legs, joined in times of the motion with gaps between legs."""
    runs = len(legs[0].execution.plants)
    parts = [(leg.begin, band) for leg, band in zip(legs, bands, strict=True) if band is not None]
    if legs[0].leg is None:
        return parts[0][1]
    return Band(
        np.concatenate([begin + np.append(band.time, band.time[-1]) for begin, band in parts]),
        np.concatenate([np.append(band.plan, np.nan) for _, band in parts]),
        np.hstack([np.column_stack([band.runs, np.full(runs, np.nan)]) for _, band in parts]),
    )


# ---- The tool's paths in planes, and close up.

_STEPS = 300  # lines of a path
_FLAT = 1e-6  # [m]: a tool that moves less is not shown in that direction
_TINT = 0.3  # of a segment's colour; the rest is white
_MARGIN = 0.04  # around the drawing, of its largest extent
_ASTRAY = 0.3  # beyond the tube, of its extent: runs that go farther are cut off
# Half the height of the close-up, in excursions; at least, in radii; at most, of the whole panel.
_CLOSE, _MIN_CLOSE, _MAX_CLOSE = 2.0, 0.4, 0.25
_MIN_HEIGHT, _CLOSE_HEIGHT = 0.15, 0.6  # of a row, of its width
_SIDES = 96  # of a round silhouette
_NAMES, _UP = "xyz", 2
# Marks the place farthest out of the tube.
RING: dict[str, Any] = {"facecolor": "none", "edgecolor": "#000000", "s": 90, "zorder": 5}

Plane = tuple[int, int]  # the coordinates to the right and up


def draw_planes(figure: "FigureBase", problem: PlanningProblem, tools: ToolRuns) -> None:
    """Draw the tool's paths in the two planes through the tube's longest direction, and a close-up.

    z points up, otherwise the longest direction points to the right. An arm that moves in a plane
    has that plane only. The close-up is where the tool is farthest out, in the plane that shows it
    best.
    """
    tube = problem.tube
    first, second, third = np.argsort(-np.ptp(tube.points, axis=0), kind="stable").tolist()
    others = [second, third] if np.ptp(tools.plan[:, third]) > _FLAT else [second]
    planes: list[Plane] = [(other, _UP) if first == _UP else (first, other) for other in others]
    low, high = _frame(tube, tools)
    *axes, close = _axes(figure, planes, high - low)
    paths = executed_paths(tools, _STEPS)
    for axis, plane in zip(axes, planes, strict=True):
        _draw_plane(axis, problem, tools, paths, plane)
        _show(axis, plane, low, high)
        axis.set_aspect("equal")
    away = tools.runs[tools.worst] - _nearest_planned(tools)
    best = max(planes, key=lambda plane: float(np.linalg.norm(away[list(plane)])))
    _draw_plane(close, problem, tools, paths, best)
    _draw_close(close, axes[planes.index(best)], tube, tools, best)
    handles, labels = close.get_legend_handles_labels()
    options: dict[str, Any] = {"loc": "outside upper center", "ncols": 4, "frameon": False}
    legend = figure.legend(handles, labels, fontsize=8, **options)
    for line in legend.get_lines():
        line.set(linewidth=2.0, alpha=1.0)


def _axes(figure: "FigureBase", planes: list[Plane], size: FloatArray) -> list["Axes"]:
    """Return axes of the planes, stacked or, if high, side by side; below, of the close-up."""
    shape = [max(size[up] / size[across], _MIN_HEIGHT) for across, up in planes]
    if planes[0][1] == _UP and max(shape) > 1:
        grid = figure.add_gridspec(2, len(planes), height_ratios=(1.2, _CLOSE_HEIGHT))
        cells = [grid[0, i] for i in range(len(planes))]
    else:
        grid = figure.add_gridspec(len(planes) + 1, 1, height_ratios=[*shape, _CLOSE_HEIGHT])
        cells = [grid[i, 0] for i in range(len(planes))]
    return [figure.add_subplot(cell) for cell in [*cells, grid[-1, :]]]


def _frame(tube: Tube, tools: ToolRuns) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner of the drawing: the tube, and runs that are not astray."""
    reach = tube.reach.max()
    low, high = tube.points.min(axis=0) - reach, tube.points.max(axis=0) + reach
    far = _ASTRAY * (high - low)
    runs = tools.runs.reshape(-1, 3)
    low = np.minimum(low, np.maximum(runs.min(axis=0), low - far))
    high = np.maximum(high, np.minimum(runs.max(axis=0), high + far))
    space = _MARGIN * (high - low).max()
    return low - space, high + space


def _nearest_planned(tools: ToolRuns) -> FloatArray:
    """Return the point of the plan (3,) [m] nearest to the tool where that is farthest out."""
    distance = np.linalg.norm(tools.plan - tools.runs[tools.worst], axis=1)
    nearest: FloatArray = tools.plan[distance.argmin()]
    return nearest


def _show(axis: "Axes", plane: Plane, low: FloatArray, high: FloatArray) -> None:
    across, up = plane
    axis.set(xlim=(low[across], high[across]), ylim=(low[up], high[up]))
    axis.set(xlabel=f"{_NAMES[across]} [m]", ylabel=f"{_NAMES[up]} [m]")
    if plane == (1, 0):
        axis.invert_yaxis()  # seen from above, not from below
    axis.grid(alpha=0.25)


def _draw_close(axis: "Axes", whole: "Axes", tube: Tube, tools: ToolRuns, plane: Plane) -> None:
    """Show the surroundings of the place farthest out, and frame this area in the whole panel."""
    tool, margin = tools.runs[tools.worst], float(tools.tube.runs[tools.worst])
    middle = (tool + _nearest_planned(tools)) / 2
    half = max(_CLOSE * abs(margin), _MIN_CLOSE * float(tube.effective_radius.min()))
    half = min(half, _MAX_CLOSE * float(np.ptp([whole.get_xlim(), whole.get_ylim()], axis=1).max()))
    sides = np.full(3, half)
    sides[plane[0]] /= _CLOSE_HEIGHT
    low, high = middle - sides, middle + sides
    _show(axis, plane, low, high)
    axis.set_aspect("equal")
    axis.locator_params(nbins=6)
    side = "outside" if margin < 0 else "inside"
    label = f"run {tools.worst[0]}, {1000 * abs(margin):.3g} mm {side}"
    axis.scatter(*tool[list(plane)], **RING, label=label)
    x, y = np.array([low, high])[:, plane].T
    whole.plot(x[[0, 1, 1, 0, 0]], y[[0, 0, 1, 1, 0]], color="#000000", linewidth=0.8)


def _draw_plane(
    axis: "Axes", problem: PlanningProblem, tools: ToolRuns, paths: ExecutedPaths, plane: Plane
) -> None:
    from matplotlib.collections import LineCollection

    for obstacle in problem.obstacles:
        for shape in obstacle.shapes:
            outline = _outline(shape_points(shape)[:, plane])
            axis.fill(*outline.T, color=OBSTACLE_COLOR, alpha=0.25, linewidth=0, zorder=0.5)
    _draw_tube(axis, problem.tube, plane)
    option_sets = (
        (paths.inside, "runs", EXECUTED_COLOR, 0.35, 0.6),
        (paths.outside, "outside the tube", WARNING_COLOR, 0.8, 1.2),
    )
    for lines, label, color, alpha, width in option_sets:
        options: dict[str, Any] = {"color": color, "alpha": alpha, "linewidth": width}
        if len(lines):
            flat = LineCollection(list(lines[:, :, plane]), label=label, **options)
            axis.add_collection(flat, autolim=False)
    axis.plot(*tools.plan[:, plane].T, color="#000000", linewidth=1.0, label="plan")


def _draw_tube(axis: "Axes", tube: Tube, plane: Plane) -> None:
    """Draw the silhouettes of segments, small on large, with a common edge around all."""
    step = segments_per_group(tube.segment_count)
    outlines = [
        _outline(np.stack(region_grid(tube, k, sides=_SIDES), axis=-1).reshape(-1, 3)[:, plane])
        for k in range(tube.segment_count)
    ]
    for outline in outlines:
        axis.fill(*outline.T, facecolor="none", edgecolor="#888888", linewidth=1.4, zorder=0.6)
    sizes = [float(np.ptp(outline, axis=0).prod()) for outline in outlines]
    for k in sorted(range(len(outlines)), key=lambda k: -sizes[k]):
        tint = 1 - _TINT * (1 - rgb(segment_color(k // step)))
        axis.fill(*outlines[k].T, color=tint, linewidth=0, zorder=0.7)


def _outline(points: FloatArray) -> FloatArray:
    """Return the corners of the hull of points (N, 2) in a plane."""
    from scipy.spatial import ConvexHull

    return points[ConvexHull(points).vertices]


# ---- The panels: a quantity of the plan and of all runs over time.

_PLAN: dict[str, Any] = {"color": "#000000", "linewidth": 1.3}
_BANDS = (((0.0, 1.0), 0.28, "all runs"), ((0.25, 0.75), 0.5, "half of the runs"))
_MILLI = 1e3
_MIN_SPACE = 0.1  # [mm or mrad]
_COLUMNS = 250  # of the saturation panel


def draw_margin(axis: "Axes", band: Band, label: str, least: float = 0.0) -> None:
    """Draw the margin [m or rad] to a tolerance, in another colour where a run exceeds it.

    The label is in mm or mrad. The panel ends where the margin is large.
    """
    draw_band(axis, band, label, least)
    bound = _MILLI * least
    axis.axhline(bound, **{**LIMIT, "linewidth": 1.4}, label="limit")
    values = _MILLI * np.vstack([band.runs, band.plan]) - bound
    low, top = float(np.nanmin(values)), float(np.nanmax(values))
    nearest = float(np.nanmin(values[-1]))  # of the plan: its nearest point is always in sight
    space = min(top, max(-3 * low, 2 * nearest, 0.25 * top))
    space = max(space, 0.1 * abs(low), _MIN_SPACE)
    axis.set_ylim(bound + min(1.25 * low, -0.12 * space), bound + 1.1 * space)


def draw_band(axis: "Axes", band: Band, label: str, least: float = -np.inf) -> None:
    """Draw the plan as a line, all runs and half of the runs as bands [m or rad].

    The label is in mm or mrad. Values below the least have another colour.
    """
    bound = _MILLI * least
    for fractions, alpha, name in _BANDS:
        # NaN are left out; where all runs are NaN, so are their quantiles.
        quantiles = np.full((len(fractions), band.runs.shape[1]), np.nan)
        has_values = ~np.isnan(band.runs).all(axis=0)
        quantiles[:, has_values] = np.nanquantile(band.runs[:, has_values], fractions, axis=0)
        low, high = _MILLI * quantiles
        options: dict[str, Any] = {"alpha": alpha, "linewidth": 0.7}
        above, below = (np.maximum(low, bound), high), (low, np.minimum(high, bound))
        options |= {"where": high >= bound, "color": EXECUTED_COLOR}
        axis.fill_between(band.time, *above, **options, label=name)
        if np.nanmin(low) < bound:
            options |= {"where": low < bound, "color": WARNING_COLOR, "alpha": alpha + 0.2}
            axis.fill_between(band.time, *below, **options)
    axis.plot(band.time, _MILLI * band.plan, **_PLAN, label="plan")
    axis.set_ylabel(label)


def draw_saturation(
    axis: "Axes", robot: RobotModel, time: FloatArray, is_saturated: BoolArray
) -> None:
    """Draw the percentage of R runs with a motor at its limit, (R, K, n), a row per joint."""
    from matplotlib.colors import LinearSegmentedColormap

    colors = LinearSegmentedColormap.from_list("white to red", ["#FFFFFF", WARNING_COLOR])
    first = np.arange(0, len(time), -(-len(time) // _COLUMNS))
    count = np.diff(first, append=len(time))
    fraction = 100 * np.add.reduceat(is_saturated.mean(axis=0), first).T / count
    rows = np.arange(robot.joint_count + 1) - 0.5
    edges = np.append(time[first], time[-1])
    image = axis.pcolormesh(edges, rows, fraction, cmap=colors, vmin=0, vmax=100, rasterized=True)
    axis.set_yticks(range(robot.joint_count), robot.joint_names, fontsize=7)
    axis.invert_yaxis()
    bar = axis.figure.colorbar(image, ax=axis, pad=0.01, aspect=12)
    bar.set_label("at the limit\n[% of runs]", fontsize=8)
