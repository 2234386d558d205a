"""The figure of a trajectory: against the limits of its joints, and in its tube."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.views.figure_files import new_figure, saved
from tubeplanner.views.motor_panels import draw_motors, motor_joints
from tubeplanner.views.palette import REFERENCE_COLOR, segment_color
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
from tubeplanner.views.space_panel import (
    draw_arm,
    draw_obstacles,
    draw_path,
    draw_segments,
    frame_panel,
)

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
    low, high = draw_arm(tool_axis, problem, curves.samples.position[[0, -1]])
    frame_panel(tool_axis, [problem.tube], low, high)
    if below:
        draw_motors(parts[1, 0], curves, motors)
    return saved(whole, path)


def _draw_tool(axis: Any, problem: PlanningProblem, tool: FloatArray) -> None:
    tube = problem.tube
    step = segments_per_group(tube.segment_count)
    for group, first in enumerate(range(0, tube.segment_count, step)):
        draw_segments(axis, tube, slice(first, first + step), segment_color(group))
    draw_obstacles(axis, problem.obstacles)
    axis.plot(*tube.points.T, color=REFERENCE_COLOR, linewidth=1, linestyle="--", label="reference")
    draw_path(axis, tool)
