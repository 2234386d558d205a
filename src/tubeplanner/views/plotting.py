"""The figure of a trajectory: what binds when, curves against their limits, the tool in space."""

from pathlib import Path
from typing import TYPE_CHECKING

from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.views.binding_strip import binding_strip, limited_motion
from tubeplanner.views.clearance_panel import draw_clearance
from tubeplanner.views.figure_files import saved
from tubeplanner.views.figure_grid import figure_grid
from tubeplanner.views.motor_panels import draw_motors, motor_joints
from tubeplanner.views.panels import mark_segments
from tubeplanner.views.space_panel import SpaceContent, draw_space
from tubeplanner.views.stretch import trajectory_curves
from tubeplanner.views.strip_panel import draw_strip
from tubeplanner.views.time_panels import time_panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_trajectory(
    problem: PlanningProblem, trajectory: JointTrajectory, path: str | Path | None = None
) -> "Figure":
    """Draw a trajectory: which limit binds when, and against limits and tube, segments marked.

    First a strip with a row per joint, one of the tool and one of the links: where a limit is used
    to 98 % it binds, and the motion is not faster there, or takes no other way. Below it positions,
    velocities, efforts and, where limits of them exist, accelerations, jerks and effort rates; the
    speed of the tool and of other points that are limited, and the share of the tube that the tool
    uses; the clearance, where any is judged; the arm at start and goal, the tool's path in the
    tube; efforts over velocities, inside what each motor has, of joints with friction or a
    torque-speed line.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints, in any order.
        path: Where to save the figure, as PNG, PDF or SVG by its ending; None: nowhere.

    Returns:
        The figure.

    Raises:
        OptionError: The file has another ending.
        OutputError: The file could not be written.
    """
    trajectory = trajectory.reordered(problem.robot.joint_names)
    curves, motion = trajectory_curves(problem, trajectory), limited_motion(problem, trajectory)
    strip = binding_strip([motion], trajectory.duration)
    draws = time_panels([curves])
    has_clearance = len(motion.closest) > 0
    motors = motor_joints(problem.robot)
    grid = figure_grid(len(strip.rows), len(draws) + has_clearance, has_motors=len(motors) > 0)
    grid.figure.suptitle(f"{problem.name}: {trajectory.duration:.4f} s", fontsize=13)
    draw_strip(grid.strip, strip)
    mark_segments(grid.strip, curves, labels=True)
    for axis, draw in zip(grid.panels, draws, strict=False):
        draw(axis, curves)
    if has_clearance:
        draw_clearance(grid.panels[-1], [motion])
    for axis in grid.panels:
        mark_segments(axis, curves)
    grid.name_time()
    ends = curves.samples.position[[0, -1]]
    carried, tubes = [problem.attached] * 2, [(problem.tube, None)]
    content = SpaceContent(problem.robot, ends, carried, 1, curves.tool, tubes, problem.obstacles)
    draw_space(grid.space, content)
    if grid.motors is not None:
        draw_motors(grid.motors, curves, motors)
    return saved(grid.figure, path)
