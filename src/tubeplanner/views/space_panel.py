"""The panel in space: tubes, what stands still, the arm, the path of the tool."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.collision.obstacle import Obstacle
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.tube.tube import Tube
from tubeplanner.views.palette import OBSTACLE_COLOR
from tubeplanner.views.surface import capsule_grid, pipe, region_grid


def draw_segments(axis: Any, tube: Tube, segments: slice, color: str) -> None:
    """Draw some segments one after the other: a capsule, or one skin for many of one radius.

    Hundreds of translucent capsules in one another would be an opaque lump, drawn slowly.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    radii = tube.effective_radius[segments]
    if len(radii) > 1 and np.ptp(radii) == 0 and tube.cross_section is None:
        points = tube.points[segments.start : segments.start + len(radii) + 1]
        skin, _ = pipe(points, float(radii[0]))
        triangles = skin.vertices[skin.faces]
        axis.add_collection3d(Poly3DCollection(triangles, facecolor=color, alpha=0.18))
        return
    for k in range(tube.segment_count)[segments]:
        surface = region_grid(tube, k)
        axis.plot_surface(*surface, color=color, alpha=0.18, linewidth=0, shade=False)


def draw_obstacles(axis: Any, obstacles: Iterable[Obstacle]) -> None:
    """Draw what stands still."""
    for obstacle in obstacles:
        for shape in obstacle.shapes:
            _draw_shape(axis, shape, OBSTACLE_COLOR, 0.2)


def draw_path(axis: Any, tool: FloatArray) -> None:
    """Draw the tool's path through points (N, 3) [m], its ends marked, and name the axes."""
    axis.plot(*tool.T, color="#D55E00", linewidth=2.2, label="tool")
    axis.scatter(*tool[0], color="#009E73", s=30, label="start")
    axis.scatter(*tool[-1], color="#000000", s=30, label="goal")
    axis.legend(fontsize=8, loc="upper left")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.set_zlabel("z [m]")


def draw_arm(axis: Any, problem: PlanningProblem, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Draw the links of a problem's arm, and what it carries, at some configurations.

    Args:
        axis: The panel.
        problem: The planning problem.
        q: Shape (N, n).

    Returns:
        Opposite corners of the space they take, each (3,) [m].
    """
    rotation, position = problem.robot.body_poses(q)
    obstacles = {obstacle.name for obstacle in problem.obstacles}
    corners = []
    for body_shape in problem.collision.shapes:
        if body_shape.owner in obstacles:
            continue
        for i in range(len(q)):
            placement = np.eye(4)
            placement[:3, :3] = rotation[i, body_shape.body]
            placement[:3, 3] = position[i, body_shape.body]
            shape = body_shape.shape.transformed(placement)
            _draw_shape(axis, shape, "#0072B2", 0.08)
            corners.append(shape.vertices)
    points = np.vstack(corners) if corners else problem.tube.points
    return points.min(axis=0), points.max(axis=0)


def frame_panel(axis: Any, tubes: Sequence[Tube], low: FloatArray, high: FloatArray) -> None:
    """Show tubes and arm whole, in equal scale; what is flat is seen from above.

    Args:
        axis: The panel.
        tubes: All tubes in it.
        low: Least corner of what else must be seen, shape (3,) [m].
        high: The opposite corner.
    """
    from matplotlib.ticker import MaxNLocator

    for tube in tubes:
        reach = tube.reach.max() + tube.tool_radius
        low = np.minimum(low, tube.points.min(axis=0) - reach)
        high = np.maximum(high, tube.points.max(axis=0) + reach)
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axis.set_box_aspect(high - low)
    for coordinate in (axis.xaxis, axis.yaxis, axis.zaxis):
        coordinate.set_major_locator(MaxNLocator(4))
    flat = np.ptp(np.concatenate([tube.points[:, 2] for tube in tubes])) < 1e-9
    axis.view_init(elev=90 if flat else 22, azim=-90 if flat else -55)
    if flat:
        axis.set_proj_type("ortho")
        axis.set_zticks([])
        axis.set_zlabel("")


def _draw_shape(axis: Any, shape: ConvexShape, color: str, alpha: float) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if len(shape.vertices) <= 2:
        surface = capsule_grid(shape.vertices[0], shape.vertices[-1], shape.radius)
        axis.plot_surface(*surface, color=color, alpha=alpha, linewidth=0)
        return
    triangles = shape.vertices[shape.faces]
    axis.add_collection3d(Poly3DCollection(triangles, facecolor=color, alpha=alpha))
