"""Figures of these pages that no command draws: python docs/gallery_figures.py NAME FILE."""

import sys
from pathlib import Path

from tubeplanner import PlanOptions, Progress, load_problem, plan, plot_convergence
from tubeplanner.output.curves import trajectory_curves
from tubeplanner.output.figures.figure_files import new_figure, saved
from tubeplanner.output.figures.panels import (
    draw_efforts,
    draw_motors,
    line_style,
    mark_segments,
    motor_joints,
)

_SHOULDER = ("shoulder_pan_joint", "shoulder_lift_joint")
_WRISTS = ("wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
# Made up: where motors stall [N m] and where they have no effort left [rad/s].
_LINES: dict[str, dict[str, float]] = {
    "saturation_effort": {
        **dict.fromkeys(_SHOULDER, 400.0),
        "elbow_joint": 200.0,
        **dict.fromkeys(_WRISTS, 80.0),
    },
    "no_load_velocity": {
        **dict.fromkeys(_SHOULDER, 4.0),
        "elbow_joint": 6.0,
        **dict.fromkeys(_WRISTS, 6.0),
    },
}


def convergence(path: Path) -> None:
    """Draw how the durations of bundled problems fall."""
    found: dict[str, list[Progress]] = {}
    for name in ("ur5/over_the_wall", "panda/between_shelves", "two_link/around_a_post"):
        steps = found.setdefault(name, [])
        plan(load_problem(f"example:{name}"), PlanOptions(slack=0.0), steps.append)
    plot_convergence(found, path)


def effort_curves(path: Path) -> None:
    """Draw the efforts of the shortest motion above those of the smooth one."""
    problem = load_problem("example:ur5/over_the_wall")
    figure = new_figure(8.0, 6.0)
    axes = figure.subplots(2, sharex=True)
    for axis, (kind, slack) in zip(axes, (("shortest", 0.0), ("smooth", None)), strict=True):
        trajectory = plan(problem, PlanOptions(slack=slack)).trajectory
        assert trajectory is not None
        curves = trajectory_curves(problem, trajectory)
        draw_efforts(axis, curves)
        mark_segments(axis, curves)
        axis.set_title(f"{kind}, {trajectory.duration:.4f} s", fontsize=9, loc="left")
    axes[0].set_xlabel("")
    for joint, name in enumerate(problem.robot.joint_names):
        axes[0].plot([], label=name, **line_style(joint))
    figure.legend(loc="outside upper center", ncols=3, fontsize=8)
    saved(figure, path)


def motor_curves(path: Path) -> None:
    """Draw what the motors of a UR10 give, and what they have."""
    changes: dict[str, object] = {f"robot.motors.{field}": lines for field, lines in _LINES.items()}
    changes |= {"robot.preset": "ur10_friction"}
    problem = load_problem("example:ur10/onto_a_conveyor", changes=changes)
    trajectory = plan(problem).trajectory
    assert trajectory is not None
    figure = new_figure(8.5, 5.0)
    curves = trajectory_curves(problem, trajectory)
    draw_motors(figure, curves, motor_joints(problem.robot), columns=3)
    saved(figure, path)


FIGURES = {each.__name__: each for each in (convergence, effort_curves, motor_curves)}

if __name__ == "__main__":
    FIGURES[sys.argv[1]](Path(sys.argv[2]))
