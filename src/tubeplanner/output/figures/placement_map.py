"""Map of durations over base positions, seen from above."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import ConvexHull

from tubeplanner.arrays import FloatArray
from tubeplanner.geometry.convex_shapes import ConvexShape
from tubeplanner.outcome import PlanStatus
from tubeplanner.output.drawing import OBSTACLE_COLOR, WARNING_COLOR, shape_points
from tubeplanner.output.figures.figure_files import new_figure, saved
from tubeplanner.output.figures.sweep_figures import (
    StatusMark,
    draw_empty_cells,
    duration_shades,
    status_mark,
    status_words,
)
from tubeplanner.studies.base_regions import BasePlacement
from tubeplanner.studies.placement import BASE_IN_OBSTACLE, KINDS, Placement, PlacementRow, grouped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BASE_MARK = StatusMark(OBSTACLE_COLOR, "s", "oo")
_WIDTH, _MIN_HEIGHT, _MAX_HEIGHT = 8.0, 4.5, 10.0  # of the figure [inches]
_MARGIN = 0.1  # around the map, as a fraction of its size
_NARROW = 0.15  # of the size: sides of a cell without spacing
_ARROW = 0.13  # length of arrows, as a fraction of the size
_GIVEN, _BEST, _PATH = "#000000", WARNING_COLOR, "#CC79A7"


def plot_placement(result: Placement, path: str | Path | None = None) -> "Figure":
    """Draw the cell from above, with the shortest durations over the region of base positions.

    A rectangle has the grid's position in its middle, at the best of the angles and heights. Where
    there is no motion, its reason is that of the angle or height at which planning came farthest.

    Args:
        result: Result of `location`.
        path: File to save the figure to, as PNG, PDF or SVG by its ending; None: none.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    # The map has the region, the path and the robot in it, but not the floor.
    region, base_placements = result.region, [result.given.base_placement]
    base_placements += [] if result.best is None else [result.best.base_placement]
    corners = [
        region.low[:2],
        region.high[:2],
        *(base_placement[:2] for base_placement in base_placements),
    ]
    shown = np.vstack([np.array(corners), result.problem.tube.points[:, :2]])
    low, high = shown.min(axis=0), shown.max(axis=0)
    margin = _MARGIN * max(float((high - low).max()), 1e-3)
    low, high = low - margin, high + margin
    height = _WIDTH * float((high - low)[1] / (high - low)[0])
    figure = new_figure(_WIDTH, min(max(height, _MIN_HEIGHT), _MAX_HEIGHT))
    axis = figure.add_subplot()
    figure.suptitle(f"{result.problem.name}: duration by where the robot stands")
    size = float((high - low).max())
    _draw_cells(figure, axis, result, _NARROW * size)
    _draw_obstacles(axis, result, low, high)
    points = result.problem.tube.points[:, :2]
    line: dict[str, Any] = {"color": _PATH, "linewidth": 2.2, "zorder": 4}
    axis.plot(*points.T, label="reference path of the tool", **line)
    axis.plot(*points[0], "o", markersize=6, **line)
    grid = set(result.grid.base_placements)
    dots = np.array(
        [row.base_placement[:2] for row in result.rows if row.base_placement not in grid]
    )
    if len(dots):
        edge: dict[str, Any] = {"markeredgecolor": "#333333", "markeredgewidth": 0.4}
        options = {"color": "#FFFFFF", "markersize": 2.6, "zorder": 5, **edge}
        axis.plot(*dots.T, "o", label="pattern search", **options)
    _draw_base(
        axis, result.given.base_placement, _ARROW * size, _GIVEN, _label("as given", result.given)
    )
    if result.best is not None:
        _draw_base(axis, result.best.base_placement, _ARROW * size, _BEST, _label("best", result))
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x [m]", ylabel="y [m]")
    axis.set_aspect("equal")
    figure.legend(fontsize=8, ncols=3, loc="outside lower center")
    return saved(figure, path)


def _label(name: str, answer: Any) -> str:
    return name if answer.duration is None else f"{name}: {answer.duration:.3f} s"


def _draw_cells(figure: "Figure", axis: "Axes", result: Placement, narrow: float) -> None:
    """Draw the rectangles of the grid: filled with a motion, hatched without."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    grid, rows_by_base = result.grid, {row.base_placement: row for row in result.rows}
    width, depth = (side or narrow for side in grid.spacing[:2])
    columns: dict[tuple[float, float], list[PlacementRow]] = {}
    for base_placement in grid.base_placements:
        if base_placement in rows_by_base:
            columns.setdefault((base_placement.x, base_placement.y), []).append(
                rows_by_base[base_placement]
            )

    def corner(row: PlacementRow) -> tuple[float, float]:
        return row.base_placement.x - width / 2, row.base_placement.y - depth / 2

    # The row whose planning came farthest, of equal rows the shortest.
    best = [
        max(rows, key=lambda row: (KINDS.index(row.status), -(row.duration or 0.0)))
        for rows in columns.values()
    ]
    planned = [row for row in best if row.is_feasible]
    rectangles = [Rectangle(corner(row), width, depth) for row in planned]
    cells = PatchCollection(rectangles, cmap=duration_shades(), zorder=1)
    cells.set_array(np.array([row.duration for row in planned]))
    axis.add_collection(cells)
    if planned:
        figure.colorbar(cells, ax=axis, label="duration, quality fast [s]", shrink=0.8)
    others = [row for row in best if not row.is_feasible]
    for status, rows in grouped(others, lambda row: row.status):
        is_base = status == BASE_IN_OBSTACLE
        mark = _BASE_MARK if is_base else status_mark(PlanStatus(status))
        words = "base in obstacle" if is_base else status_words(PlanStatus(status))
        label = f"no motion: {words} ({len(rows)})"
        corners = list(map(corner, rows))
        draw_empty_cells(axis, corners, (width, depth), mark, label, zorder=1)


def _draw_obstacles(axis: "Axes", result: Placement, low: FloatArray, high: FloatArray) -> None:
    """Draw the outlines of the obstacles from above, dashed for obstacles under the robot.

    Names are at the upper left corner of the part inside the map.
    """
    for on, words in ((False, "obstacle"), (True, "what it stands on")):
        label = words
        for obstacle in result.problem.obstacles:
            if (obstacle.name in result.stands_on) is not on:
                continue
            for shape in obstacle.shapes:
                line: dict[str, Any] = {"linestyle": "--" if on else "-", "linewidth": 1.6}
                axis.plot(*_outline(shape).T, color="#333333", label=label, zorder=3, **line)
                label = f"_{words}"
            outline = np.vstack([_outline(shape) for shape in obstacle.shapes])
            seen = np.clip(outline, low, high)
            if (np.ptp(seen, axis=0) > 0).all():
                corner = float(seen[:, 0].min()), float(seen[:, 1].max())
                box = {"boxstyle": "square,pad=0.1", "color": "white", "alpha": 0.7, "linewidth": 0}
                text: dict[str, Any] = {"fontsize": 8, "ha": "left", "va": "top", "clip_on": True}
                text |= {"textcoords": "offset points", "zorder": 6}
                axis.annotate(obstacle.name, corner, (3, -3), bbox=box, **text)


def _outline(shape: ConvexShape) -> FloatArray:
    """Return the closed outline of a shape from above, (N, 2) [m]."""
    points = shape_points(shape)[:, :2]
    corners = points[ConvexHull(points).vertices]
    return np.vstack([corners, corners[:1]])


def _draw_base(
    axis: "Axes", base_placement: BasePlacement, length: float, color: str, label: str
) -> None:
    """Draw the base position of a robot, and its yaw as an arrow."""
    ahead = (
        base_placement.x + length * np.cos(base_placement.yaw),
        base_placement.y + length * np.sin(base_placement.yaw),
    )
    arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 2.0, "shrinkA": 0, "shrinkB": 0}
    axis.annotate("", ahead, (base_placement.x, base_placement.y), arrowprops=arrow, zorder=7)
    options: dict[str, Any] = {"color": color, "markeredgecolor": "white", "markersize": 8}
    axis.plot(base_placement.x, base_placement.y, "o", label=label, zorder=8, **options)
