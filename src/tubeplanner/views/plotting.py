"""The figure of a trajectory: against the limits of its joints, and in its tube."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.collision.convex_shape import ConvexShape
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.tube.tube import Tube
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.motor_panels import draw_motors, motor_joints
from tubeplanner.views.palette import OBSTACLE_COLOR, REFERENCE_COLOR, segment_color
from tubeplanner.views.panels import (
    draw_effort_rates,
    draw_efforts,
    draw_factor,
    draw_points,
    draw_positions,
    draw_speed,
    draw_tube_use,
    draw_velocities,
    mark_segments,
    segments_per_group,
    trajectory_curves,
)
from tubeplanner.views.surface import capsule_grid, pipe, region_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_trajectory(
    problem: PlanningProblem, trajectory: JointTrajectory, path: str | Path | None = None
) -> "Figure":
    """Draw a trajectory against limits and tube, the tube's segments marked.

    Positions, velocities, efforts, and their rates if a limit is asked, with the limits; how many
    times faster each instant could be run, `b(t)`; the tool's path in the tube, its speed, and the
    share of the tolerance it uses; the speeds of other points, if these are limited; efforts over
    velocities, inside what each motor has, of joints with friction or a torque-speed line.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        path: Where to save the figure as PNG; None: nowhere.

    Returns:
        The figure.

    Raises:
        OutputError: The file could not be written.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    curves = trajectory_curves(problem, trajectory)
    draws = [draw_positions, draw_velocities, draw_efforts]
    draws += [draw_effort_rates] if curves.effort_rate is not None else []
    draws += [draw_points] if problem.robot.limits.point_speed else []
    motors = motor_joints(problem.robot)
    rows, below = len(draws) + 1, int(len(motors) > 0)
    whole = new_figure(12.5, 2.7 * (rows + below))
    whole.suptitle(f"{problem.name}: {trajectory.duration:.4f} s", fontsize=13)
    parts = whole.subfigures(1 + below, 1, height_ratios=[rows, 1][: 1 + below], squeeze=False)
    figure = parts[0, 0]
    grid = figure.add_gridspec(rows, 2, width_ratios=(1.15, 1))
    left = [figure.add_subplot(grid[row, 0]) for row in range(rows - 1)]
    tool_axis = figure.add_subplot(grid[: rows - 2, 1], projection="3d")
    use, factor, speed = (figure.add_subplot(grid[place]) for place in ((-2, 1), (-1, 0), (-1, 1)))
    for axis, draw in zip(left, draws, strict=True):
        draw(axis, curves)
    draw_tube_use(use, curves)
    draw_speed(speed, curves)
    draw_factor(factor, curves)
    for axis in (*left, use, speed):
        mark_segments(axis, curves, labels=axis in (left[0], use))
    _draw_tool(tool_axis, problem, curves.tool)
    low, high = _draw_arm(tool_axis, problem, curves.samples.position[[0, -1]])
    _frame(tool_axis, problem, low, high)
    if below:
        draw_motors(parts[1, 0], curves, motors)
    return saved(whole, path)


def _draw_tool(axis: Any, problem: PlanningProblem, tool: FloatArray) -> None:
    tube = problem.tube
    step = segments_per_group(tube.segment_count)
    for group, first in enumerate(range(0, tube.segment_count, step)):
        _draw_segments(axis, tube, slice(first, first + step), segment_color(group))
    for obstacle in problem.obstacles:
        for shape in obstacle.shapes:
            _draw_shape(axis, shape, OBSTACLE_COLOR, 0.2)
    axis.plot(*tube.points.T, color=REFERENCE_COLOR, linewidth=1, linestyle="--", label="reference")
    axis.plot(*tool.T, color="#D55E00", linewidth=2.2, label="tool")
    axis.scatter(*tool[0], color="#009E73", s=30, label="start")
    axis.scatter(*tool[-1], color="#000000", s=30, label="goal")
    axis.legend(fontsize=8, loc="upper left")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.set_zlabel("z [m]")


def _draw_segments(axis: Any, tube: Tube, segments: slice, color: str) -> None:
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


def _draw_arm(axis: Any, problem: PlanningProblem, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Draw the links at some configurations; return the corners of the space they take [m]."""
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


def _frame(axis: Any, problem: PlanningProblem, low: FloatArray, high: FloatArray) -> None:
    """Show tube and arm whole, in equal scale; a flat tube is seen from above."""
    from matplotlib.ticker import MaxNLocator

    reach = problem.tube.reach.max() + problem.tube.tool_radius
    low = np.minimum(low, problem.tube.points.min(axis=0) - reach)
    high = np.maximum(high, problem.tube.points.max(axis=0) + reach)
    axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axis.set_box_aspect(high - low)
    for coordinate in (axis.xaxis, axis.yaxis, axis.zaxis):
        coordinate.set_major_locator(MaxNLocator(4))
    flat = np.ptp(problem.tube.points[:, 2]) < 1e-9
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
