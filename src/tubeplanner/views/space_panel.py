"""The panel in space: tubes, what stands still, the arm at some places, the path of the tool."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import convex_hull
from tubeplanner.collision.obstacle import AttachedSolid, Obstacle
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.tube.tube import Tube
from tubeplanner.views.palette import (
    ARM_COLOR,
    CARRIED_COLOR,
    GRIPPER_COLOR,
    OBSTACLE_COLOR,
    REFERENCE_COLOR,
    rgb,
)
from tubeplanner.views.rendered_solids import RenderedSolid, rendered
from tubeplanner.views.space_frame import draw_frame
from tubeplanner.views.space_solids import arm_solids, obstacle_solids, tube_solids
from tubeplanner.views.space_view import SpaceView
from tubeplanner.views.surface import coarse_hull_points
from tubeplanner.views.viewpoint import best_direction

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TOOL_COLOR = "#D55E00"
_AROUND = 0.25  # of the size of arm and tube: how far around them obstacles are drawn
_FLAT = 0.25  # of an arm's size: what moves in a plane is not higher
_FROM_ABOVE = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class SpaceContent:
    """What the panel shows.

    Attributes:
        robot: The arm.
        q: Configurations in which it is drawn, shape (N, n).
        carried: What it carries in each.
        strong: Which of them is drawn in full colour.
        path: Of the tool, shape (M, 3) [m].
        tubes: Tubes, and the colour of each; None: those of its segments.
        obstacles: What stands still.
        handed_over: Names of those that the arm takes.
    """

    robot: RobotModel
    q: FloatArray
    carried: Sequence[Sequence[AttachedSolid]]
    strong: int
    path: FloatArray
    tubes: Sequence[tuple[Tube, str | None]]
    obstacles: Sequence[Obstacle]
    handed_over: Collection[str] = ()


def draw_space(axis: "Axes", content: SpaceContent) -> None:
    """Draw all of it, from where the path is seen well; what is flat from above."""
    arm = arm_solids(content.robot, content.q, content.carried, content.strong)
    tubes: list[RenderedSolid] = []
    for tube, color in content.tubes:
        colors = None if color is None else [color] * len(tube_solids(tube))
        tubes += tube_solids(tube, colors)
    low, high = _extent([*arm, *tubes])
    around = _AROUND * float((high - low).max())
    view = SpaceView(_direction(content, arm, low, high))
    # Nothing is drawn below the floor that the arm stands on.
    below = np.array([around, around, 0.02 * around])
    standing = obstacle_solids(content.obstacles, content.handed_over, low - below, high + around)
    solids = [*arm, *tubes, *standing]
    picture = rendered(solids, view)
    (left, bottom), (right, top) = picture.low, picture.high
    # Filtered after its colours are made: so no pixel is mixed with what is not there.
    shown: dict[str, Any] = {"interpolation": "antialiased", "interpolation_stage": "rgba"}
    extent = (left, right, bottom, top)
    axis.imshow(picture.pixels, origin="lower", extent=extent, zorder=2, **shown)
    draw_frame(axis, view, *_extent(solids))
    _draw_lines(axis, view, content)
    _draw_legend(axis, content, solids)


def _extent(solids: Sequence[RenderedSolid]) -> tuple[FloatArray, FloatArray]:
    """Return opposite corners of a box about solids, each (3,) [m]."""
    points = np.vstack([solid.surface.vertices for solid in solids if len(solid.surface.vertices)])
    return points.min(axis=0), points.max(axis=0)


def _direction(
    content: SpaceContent, arm: Sequence[RenderedSolid], low: FloatArray, high: FloatArray
) -> FloatArray:
    """Return from where to look, unit vector (3,)."""
    heights = np.concatenate([tube.points[:, 2] for tube, _ in content.tubes])
    size = high - low
    if np.ptp(heights) < 1e-9 and size[2] < _FLAT * size.max():
        return _FROM_ABOVE
    points = np.vstack([content.path, *(tube.points for tube, _ in content.tubes)])
    shapes = [shape for obstacle in content.obstacles for shape in obstacle.shapes]
    hulls = [convex_hull(coarse_hull_points(solid.surface.vertices)) for solid in arm]
    return best_direction(points, shapes, [hulls])


def _draw_lines(axis: "Axes", view: SpaceView, content: SpaceContent) -> None:
    """Draw the path of the tool, its ends marked, and the lines of the tubes."""
    for tube, color in content.tubes:
        style: dict[str, Any] = {"color": color or REFERENCE_COLOR, "linewidth": 1.0}
        axis.plot(*view.on_page(tube.points).T, linestyle="--", zorder=3, **style)
    page = view.on_page(content.path)
    axis.plot(*page.T, color="white", linewidth=4.0, alpha=0.8, zorder=3)
    axis.plot(*page.T, color=_TOOL_COLOR, linewidth=2.2, zorder=4, label="path of the tool")
    ends: dict[str, Any] = {"color": _TOOL_COLOR, "zorder": 5, "markersize": 7}
    axis.plot(*page[0], "o", markerfacecolor="white", markeredgewidth=1.8, label="start", **ends)
    axis.plot(*page[-1], "o", markeredgecolor="white", label="goal", **ends)


def _draw_legend(axis: "Axes", content: SpaceContent, solids: Sequence[RenderedSolid]) -> None:
    """Name what is drawn, below the panel."""
    from matplotlib.patches import Patch

    handles, _ = axis.get_legend_handles_labels()
    names = {
        ARM_COLOR: f"arm, strong {'at the goal' if content.strong else 'at the start'}",
        GRIPPER_COLOR: "gripper",
        CARRIED_COLOR: "carried",
        OBSTACLE_COLOR: "obstacles",
    }
    drawn = {tuple(solid.color) for solid in solids}
    if any(content.carried):
        drawn.add(tuple(rgb(CARRIED_COLOR)))
    handles += [
        Patch(color=color, label=name)
        for color, name in names.items()
        if tuple(rgb(color)) in drawn
    ]
    below = -0.16 if axis.axison else 0.0  # the numbers of its axes
    axis.legend(
        handles=handles,
        loc="upper center",
        bbox_to_anchor=(0.5, below),
        ncols=4,
        fontsize=8,
        frameon=False,
    )
