"""The tool's executed paths in the planes in which a tube extends the farthest, and close up."""

from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.tube.tube import Tube
from tubeplanner.views.executed_paths import ExecutedPaths, executed_paths
from tubeplanner.views.execution_curves import ToolRuns
from tubeplanner.views.palette import (
    EXECUTED_COLOR,
    OBSTACLE_COLOR,
    WARNING_COLOR,
    rgb,
    segment_color,
)
from tubeplanner.views.stretch import segments_per_group
from tubeplanner.views.surface import region_grid, shape_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

_STEPS = 300  # lines of a path
_FLAT = 1e-6  # [m]: a tool that moves less is not shown in that direction
_TINT = 0.3  # of a segment's colour; the rest is white
_ROOM = 0.04  # about what is shown, of its largest extent
_ASTRAY = 0.3  # beyond the tube, of its extent: what goes farther is not shown
# Half the height of the close-up, in excursions; at least, in radii; at most, of what is shown.
_CLOSE, _LEAST_CLOSE, _MOST_CLOSE = 2.0, 0.4, 0.25
_LEAST_HEIGHT, _CLOSE_HEIGHT = 0.15, 0.6  # of a row, of its width
_SIDES = 96  # of a round silhouette
_NAMES, _UP = "xyz", 2
# About the place that is farthest out.
RING: dict[str, Any] = {"facecolor": "none", "edgecolor": "#000000", "s": 90, "zorder": 5}

Plane = tuple[int, int]  # the coordinates to the right and up


def draw_planes(figure: "FigureBase", problem: PlanningProblem, tools: ToolRuns) -> None:
    """Draw the tool's paths in the two planes through the tube's longest direction, and close up.

    z points up, and else that direction to the right. An arm that moves in a plane has only that.
    The close-up is where the tool is farthest out, in the plane that shows it best.
    """
    planes = _planes(problem.tube, tools)
    low, high = _frame(problem.tube, tools)
    *axes, close = _axes(figure, planes, high - low)
    paths = executed_paths(tools, _STEPS)
    for axis, plane in zip(axes, planes, strict=True):
        _draw_plane(axis, problem, tools, paths, plane)
        _show(axis, plane, low, high)
        axis.set_aspect("equal")
    best = _telling(tools, planes)
    _draw_plane(close, problem, tools, paths, best)
    _draw_close(close, axes[planes.index(best)], problem.tube, tools, best)
    handles, labels = close.get_legend_handles_labels()
    look: dict[str, Any] = {"loc": "outside upper center", "ncols": 4, "frameon": False}
    legend = figure.legend(handles, labels, fontsize=8, **look)
    for line in legend.get_lines():
        line.set(linewidth=2.0, alpha=1.0)


def _planes(tube: Tube, tools: ToolRuns) -> list[Plane]:
    first, second, third = np.argsort(-np.ptp(tube.points, axis=0), kind="stable").tolist()
    others = [second, third] if np.ptp(tools.plan[:, third]) > _FLAT else [second]
    return [(other, _UP) if first == _UP else (first, other) for other in others]


def _axes(figure: "FigureBase", planes: list[Plane], size: FloatArray) -> list["Axes"]:
    """Return axes for planes, below each other or, if these are high, beside; and one below."""
    shape = [max(size[up] / size[across], _LEAST_HEIGHT) for across, up in planes]
    if planes[0][1] == _UP and max(shape) > 1:
        grid = figure.add_gridspec(2, len(planes), height_ratios=(1.2, _CLOSE_HEIGHT))
        cells = [grid[0, i] for i in range(len(planes))]
    else:
        grid = figure.add_gridspec(len(planes) + 1, 1, height_ratios=[*shape, _CLOSE_HEIGHT])
        cells = [grid[i, 0] for i in range(len(planes))]
    return [figure.add_subplot(cell) for cell in [*cells, grid[-1, :]]]


def _frame(tube: Tube, tools: ToolRuns) -> tuple[FloatArray, FloatArray]:
    """Return the corners of what is shown: the tube, and the runs where they do not go astray."""
    reach = tube.reach.max()
    low, high = tube.points.min(axis=0) - reach, tube.points.max(axis=0) + reach
    far = _ASTRAY * (high - low)
    runs = tools.runs.reshape(-1, 3)
    low = np.minimum(low, np.maximum(runs.min(axis=0), low - far))
    high = np.maximum(high, np.minimum(runs.max(axis=0), high + far))
    room = _ROOM * (high - low).max()
    return low - room, high + room


def _telling(tools: ToolRuns, planes: list[Plane]) -> Plane:
    """Return the plane that best shows how the tool leaves the plan where it is farthest out."""
    away = tools.runs[tools.worst] - _nearest_planned(tools)
    return max(planes, key=lambda plane: float(np.linalg.norm(away[list(plane)])))


def _nearest_planned(tools: ToolRuns) -> FloatArray:
    """Return the place of the plan (3,) [m] nearest to where the tool is farthest out."""
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
    """Show what is near the place that is farthest out, and frame it in the whole."""
    tool, margin = tools.runs[tools.worst], float(tools.tube.runs[tools.worst])
    middle = (tool + _nearest_planned(tools)) / 2
    half = max(_CLOSE * abs(margin), _LEAST_CLOSE * float(tube.effective_radius.min()))
    half = min(
        half, _MOST_CLOSE * float(np.ptp([whole.get_xlim(), whole.get_ylim()], axis=1).max())
    )
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
    axis: "Axes",
    problem: PlanningProblem,
    tools: ToolRuns,
    paths: ExecutedPaths,
    plane: Plane,
) -> None:
    from matplotlib.collections import LineCollection

    for obstacle in problem.obstacles:
        for shape in obstacle.shapes:
            outline = _outline(shape_points(shape)[:, plane])
            axis.fill(*outline.T, color=OBSTACLE_COLOR, alpha=0.25, linewidth=0, zorder=0.5)
    _draw_tube(axis, problem.tube, plane)
    looks = (
        (paths.inside, "runs", EXECUTED_COLOR, 0.35, 0.6),
        (paths.outside, "outside the tube", WARNING_COLOR, 0.8, 1.2),
    )
    for lines, label, color, alpha, width in looks:
        look: dict[str, Any] = {"color": color, "alpha": alpha, "linewidth": width}
        if len(lines):
            flat = LineCollection(list(lines[:, :, plane]), label=label, **look)
            axis.add_collection(flat, autolim=False)
    axis.plot(*tools.plan[:, plane].T, color="#000000", linewidth=1.0, label="plan")


def _draw_tube(axis: "Axes", tube: Tube, plane: Plane) -> None:
    """Draw the silhouettes of segments, small ones on large ones, an edge about all of them."""
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
