"""Panels of motors: the efforts of a joint over its velocities, inside what its motor has."""

from typing import TYPE_CHECKING, Any

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.views.palette import LINE_COLORS, REFERENCE_COLOR
from tubeplanner.views.panels import LIMIT
from tubeplanner.views.stretch import TrajectoryCurves

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

_MOTION: dict[str, Any] = {"color": LINE_COLORS[1], "linewidth": 1.4}
_SHADE: dict[str, Any] = {"color": LINE_COLORS[0], "alpha": 0.08, "linewidth": 0}
_LOOKS = 201  # velocities at which a motor's limits are drawn
_MARGIN = 1.12  # how far beyond limits, or motions where there are none, the panel shows


def motor_joints(robot: RobotModel) -> IntArray:
    """Return the joints whose motors a panel has something to say of: friction, or a line."""
    motors = robot.motors
    friction = motors.viscous_friction + motors.backwards_friction + motors.forwards_friction
    return np.flatnonzero((friction > 0) | motors.has_curve)


def draw_motors(
    figure: "FigureBase", curves: TrajectoryCurves, joints: IntArray, columns: int | None = None
) -> None:
    """Draw the motors of some joints beside each other, in so many columns; None: in one row."""
    columns = columns or len(joints)
    grid = figure.add_gridspec(-(-len(joints) // columns), columns)
    axes = [figure.add_subplot(grid[divmod(place, columns)]) for place in range(len(joints))]
    for place, (axis, joint) in enumerate(zip(axes, joints.tolist(), strict=True)):
        draw_motor(axis, curves, joint)
        if place % columns:
            axis.set_ylabel("")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, fontsize=8, frameon=False)


def draw_motor(axis: "Axes", curves: TrajectoryCurves, joint: int) -> None:
    """Draw a joint's efforts over its velocities, what friction takes, and the motor's limits.

    Where its limits depend on the position, the most and the least that it has anywhere.
    """
    robot = curves.problem.robot
    velocity, effort = curves.samples.velocity[:, joint], curves.effort[:, joint]
    shown = _shown_velocities(robot, joint, velocity)
    _draw_limits(axis, robot, joint, shown)
    coulomb = robot.motors.coulomb_effort(np.tile(shown[:, None], robot.joint_count))[:, joint]
    friction = robot.motors.viscous_friction[joint] * shown + coulomb
    axis.plot(shown, friction, color=REFERENCE_COLOR, linewidth=1.0, label="friction alone")
    axis.plot(velocity, effort, **_MOTION, label="motion")
    most = robot.limits.effort[joint]
    top = _MARGIN * float(most if np.isfinite(most) else abs(effort).max())
    axis.set(xlim=(shown[0], shown[-1]), ylim=(-top, top))
    units = ("rad/s", "N m") if robot.revolute[joint] else ("m/s", "N")
    axis.set_title(robot.joint_names[joint], fontsize=8)
    axis.set_xlabel(f"velocity [{units[0]}]", fontsize=8)
    axis.set_ylabel(f"effort [{units[1]}]", fontsize=8)
    axis.tick_params(labelsize=7)
    axis.grid(alpha=0.25)


def _draw_limits(axis: "Axes", robot: RobotModel, joint: int, velocity: FloatArray) -> None:
    """Shade what a motor has at velocities (N,), and draw its limits as lines."""
    most = robot.limits.velocity[joint]
    for forwards, backwards in _limits(robot, joint, velocity):
        within = abs(velocity) <= most
        axis.fill_between(velocity, -backwards, forwards, where=within, **_SHADE)
        for bound in (forwards, -backwards):
            axis.plot(velocity, bound, **LIMIT)
    for bound in (-most, most):
        axis.axvline(bound, **LIMIT)


def _shown_velocities(robot: RobotModel, joint: int, velocity: FloatArray) -> FloatArray:
    """Return velocities, increasing, over all that a joint may have, or else has."""
    most = robot.limits.velocity[joint]
    end = _MARGIN * float(most if np.isfinite(most) else max(abs(velocity).max(), 1e-3))
    # Friction jumps at zero: one look on either side.
    positive = np.linspace(0, end, _LOOKS // 2 + 1)
    positive[0] = 1e-9 * end
    return np.concatenate([-positive[::-1], positive])


def _limits(robot: RobotModel, joint: int, velocity: FloatArray) -> list[FloatArray]:
    """Return what a motor has forwards and backwards at velocities (N,), (2, N) each.

    The most, and the least if that is another.
    """
    own = robot.limits.effort[joint]
    sides = [
        (each.side(1.0), each.side(-1.0))
        for each in robot.limits.effort_ranges
        if each.joint == joint
    ]
    pairs = [(own, own)]
    if sides:
        ((forwards, backwards),) = sides
        pairs = [(forwards.max(), backwards.max()), (forwards.min(), backwards.min())]
    left = _left_by_the_line(robot, joint, velocity)
    found = [np.minimum(np.array(pair)[:, None], left) for pair in dict.fromkeys(pairs)]
    return [reserve for reserve in found if np.isfinite(reserve).all()]


def _left_by_the_line(robot: RobotModel, joint: int, velocity: FloatArray) -> FloatArray:
    """Return what a torque-speed line leaves forwards and backwards, (2, N); inf without one."""
    if not robot.motors.has_curve[joint]:
        return np.full((2, len(velocity)), np.inf)
    stall, no_load = robot.motors.saturation_effort[joint], robot.motors.no_load_velocity[joint]
    return np.array([stall * (1 - way * velocity / no_load) for way in (1.0, -1.0)])
