"""Figures of a trajectory: against the limits of its joints, and in its tube.

matplotlib is imported when first drawn with.
"""

import io
import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.convex_shape import ConvexShape
from tubeplanner.output_files import write_files
from tubeplanner.palette import LINE_COLORS, OBSTACLE_COLOR, REFERENCE_COLOR, segment_color
from tubeplanner.problem import PlanningProblem
from tubeplanner.surface import capsule_grid
from tubeplanner.trajectory import JointTrajectory, TrajectorySamples
from tubeplanner.tube_membership import current_segments

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DASHES = ("-", "--")
_LIMIT: dict[str, Any] = {"color": "#444444", "linewidth": 1.0, "linestyle": (0, (4, 3))}
_SAMPLES = 800


def plot_trajectory(
    problem: PlanningProblem, trajectory: JointTrajectory, path: str | Path | None = None
) -> "Figure":
    """Draw positions, velocities and efforts against limits, and the hand's path in the tube.

    Args:
        problem: What was asked.
        trajectory: Of the problem's joints, in any order.
        path: Where to save the figure as PNG; None: nowhere.

    Returns:
        The figure.

    Raises:
        OutputError: The file could not be written.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # its font cache is its own affair
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    trajectory = trajectory.reordered(problem.robot.joint_names)
    figure = Figure(figsize=(12.5, 8.5), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(f"{problem.name}: {trajectory.duration:.4f} s", fontsize=13)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.15, 1))
    axes = [figure.add_subplot(grid[row, 0]) for row in range(3)]
    _draw_joints(axes, problem, trajectory)
    hand_axes = figure.add_subplot(grid[:2, 1], projection="3d")
    use_axes = figure.add_subplot(grid[2, 1])
    samples = trajectory.at(np.linspace(0.0, trajectory.duration, _SAMPLES))
    hand = problem.robot.tool_position(samples.position)
    _draw_hand(hand_axes, problem, hand)
    low, high = _draw_arm(hand_axes, problem, samples.position[[0, -1]])
    _frame(hand_axes, problem, low, high)
    _draw_tube_use(use_axes, problem, samples, hand)
    if path is not None:
        write_files({Path(path): figure_png(figure)})
    return figure


def figure_png(figure: "Figure") -> bytes:
    """Return a figure as the contents of a PNG file."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    return stream.getvalue()


def _draw_joints(axes: "list[Axes]", problem: PlanningProblem, trajectory: JointTrajectory) -> None:
    robot = problem.robot
    samples = trajectory.per_piece(max(4, _SAMPLES // len(trajectory.widths)))
    effort = robot.inverse_dynamics(samples.position, samples.velocity, samples.acceleration)
    turning = bool(robot.revolute.all())
    unit = "rad" if turning else "rad, m"
    rate, effort_unit = ("rad/s", "N m") if turning else ("rad/s, m/s", "N m, N")
    for j, name in enumerate(robot.joint_names):
        style = _line_style(j)
        axes[0].plot(samples.time, samples.position[:, j], label=name, **style)
    axes[0].set_ylabel(f"position [{unit}]")
    speed, limits = samples.velocity, robot.limits
    _draw_shares(axes[1], samples.time, speed, limits.velocity, "velocity", rate)
    _draw_shares(axes[2], samples.time, effort, limits.effort, "effort", effort_unit)
    axes[2].set_xlabel("time [s]")
    axes[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8, frameon=False)
    for axis in axes:
        axis.set_xlim(0.0, trajectory.duration)
        axis.grid(alpha=0.25)


def _draw_shares(
    axis: "Axes",
    time: FloatArray,
    values: FloatArray,
    limit: FloatArray,
    quantity: str,
    unit: str,
) -> None:
    """Draw values as percent of their limits, or in their unit where a joint has no limit."""
    limited = bool(np.isfinite(limit).all())
    shown = 100 * values / limit if limited else values
    for j in range(values.shape[1]):
        axis.plot(time, shown[:, j], **_line_style(j))
    if limited:
        for bound in (-100, 100):
            axis.axhline(bound, **_LIMIT)
        axis.set_ylim(-112, 112)
        axis.set_ylabel(f"{quantity} [% of limit]")
        return
    axis.set_ylabel(f"{quantity} [{unit}]")
    axis.set_title(f"not every joint has a {quantity} limit", fontsize=8, loc="right")


def _line_style(joint: int) -> dict[str, Any]:
    dashes = _DASHES[(joint // len(LINE_COLORS)) % len(_DASHES)]
    return {"color": LINE_COLORS[joint % len(LINE_COLORS)], "linewidth": 1.5, "linestyle": dashes}


def _draw_hand(axis: Any, problem: PlanningProblem, hand: FloatArray) -> None:
    tube = problem.tube
    for k in range(tube.segment_count):
        color = segment_color(k)
        surface = capsule_grid(tube.points[k], tube.points[k + 1], tube.effective_radius[k])
        axis.plot_surface(*surface, color=color, alpha=0.18, linewidth=0, shade=False)
    for obstacle in problem.obstacles:
        for shape in obstacle.shapes:
            _draw_shape(axis, shape, OBSTACLE_COLOR, 0.2)
    axis.plot(*tube.points.T, color=REFERENCE_COLOR, linewidth=1, linestyle="--", label="reference")
    axis.plot(*hand.T, color="#D55E00", linewidth=2.2, label="hand")
    axis.scatter(*hand[0], color="#009E73", s=30, label="start")
    axis.scatter(*hand[-1], color="#000000", s=30, label="goal")
    axis.legend(fontsize=8, loc="upper left")
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.set_zlabel("z [m]")


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

    reach = problem.tube.radius.max()
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


def _draw_tube_use(
    axis: "Axes", problem: PlanningProblem, samples: TrajectorySamples, hand: FloatArray
) -> None:
    """Draw the distance to the segment that the hand is in, and that segment's radius."""
    tube, time = problem.tube, samples.time
    segment = current_segments(problem, samples.position)
    distance = tube.distance(hand)[np.arange(len(hand)), segment]
    axis.plot(time, 1000 * distance, color="#D55E00", label="hand")
    axis.plot(time, 1000 * tube.effective_radius[segment], label="radius", **_LIMIT)
    axis.set_xlim(0.0, time[-1])
    axis.set_ylim(0.0, 1100 * tube.effective_radius.max())
    axis.set_xlabel("time [s]")
    axis.set_ylabel("distance from reference [mm]")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.25)
