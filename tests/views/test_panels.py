"""Efforts over velocities: every motion inside what its motor has, limits where they are."""

from dataclasses import replace

import numpy as np
import pytest
from cases import SHORTEST, with_motors
from matplotlib.figure import Figure

from tubeplanner import load_problem, plan, plot_trajectory
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.views.motor_panels import draw_motor, draw_motors, motor_joints
from tubeplanner.views.panels import draw_efforts
from tubeplanner.views.stretch import trajectory_curves

MOTORS = {
    "robot.limits.effort": {"joint1": [70, 95], "joint2": 27},
    "robot.motors.coulomb_friction": {"joint1": [4, 8]},
    "robot.motors.viscous_friction": {"joint1": 1.5},
    "robot.motors.saturation_effort": {"joint2": 40},
    "robot.motors.no_load_velocity": {"joint2": 12},
}


@pytest.fixture(scope="module")
def motion():
    problem = load_problem("example:two_link/paper_3_50mm", changes=MOTORS)
    return problem, plan(problem, SHORTEST).trajectory


@pytest.fixture(scope="module")
def curves(motion):
    return trajectory_curves(*motion)


@pytest.fixture(scope="module")
def panels(curves):
    """Return the panels of both motors."""
    axes = Figure().subplots(1, 2)
    for joint, axis in enumerate(axes):
        draw_motor(axis, curves, joint)
    return axes


def lines(axis):
    """Return what is drawn: the motor's limits, those of velocity, friction, motion."""
    *limits, backwards, forwards, friction, motion = axis.lines
    return limits, (backwards, forwards), friction, motion


def test_a_motor_has_its_own_effort_each_way_and_friction_by_direction(panels, curves):
    (forwards, backwards), _, friction, motion = lines(panels[0])
    assert set(forwards.get_ydata()) == {95.0}
    assert set(backwards.get_ydata()) == {-70.0}
    assert motion.get_ydata().max() == pytest.approx(95, rel=1e-3)
    assert motion.get_ydata().min() == pytest.approx(-70, rel=1e-3)
    np.testing.assert_array_equal(motion.get_xdata(), curves.samples.velocity[:, 0])
    np.testing.assert_array_equal(motion.get_ydata(), curves.effort[:, 0])
    x, y = friction.get_data()
    np.testing.assert_allclose(y, 1.5 * x + np.where(x > 0, 8.0, -4.0))
    assert (x[1:] > x[:-1]).all()
    assert abs(x).min() < 1e-6  # it jumps at zero, and nowhere else


def test_a_torque_speed_line_cuts_the_corners(panels):
    """Driving, 40 (1 - |v| / 12) is left; braking, the limit."""
    (forwards, backwards), _, friction, motion = lines(panels[1])
    v = forwards.get_xdata()
    np.testing.assert_allclose(forwards.get_ydata(), np.minimum(27, 40 * (1 - v / 12)))
    np.testing.assert_allclose(backwards.get_ydata(), -np.minimum(27, 40 * (1 + v / 12)))
    assert not friction.get_ydata().any()
    x, y = motion.get_data()
    used = np.maximum(y / 40 + x / 12, -y / 40 - x / 12)
    assert used.max() == pytest.approx(1.0, abs=2e-3)  # it binds, and is kept
    assert abs(y).max() <= 27 * (1 + 1e-6)


def test_limits_of_velocity_end_what_a_motor_has(stored):
    problem, trajectory = stored("ur5/over_the_wall", "refinement")
    problem = replace(problem, robot=with_motors(problem.robot, forwards_friction=3.0))
    draw_motor(axis := Figure().subplots(), trajectory_curves(problem, trajectory), 2)
    _, ends, _, _ = lines(axis)
    most = problem.robot.limits.velocity[2]
    assert [end.get_xdata()[0] for end in ends] == [-most, most]
    (shade,) = axis.collections
    low, high = shade.get_datalim(axis.transData).intervalx
    assert -most <= low < -0.95 * most
    assert 0.95 * most < high <= most
    assert axis.get_xlim() == pytest.approx((-1.12 * most, 1.12 * most))


def test_only_joints_whose_motors_are_known_have_a_panel(motion):
    problem, trajectory = motion
    robot = problem.robot
    none, second = np.zeros(2), np.array([0.0, 1.0])
    for kind in ("viscous_friction", "backwards_friction", "forwards_friction"):
        assert motor_joints(with_motors(robot, **{kind: second})).tolist() == [1]
    assert motor_joints(with_motors(robot, armature=1.0)).tolist() == []
    lines_of_one = {"saturation_effort": [5.0, np.inf], "no_load_velocity": [5.0, np.inf]}
    assert motor_joints(with_motors(robot, forwards_friction=none, **lines_of_one)).tolist() == [0]
    titles = [axis.get_title() for axis in plot_trajectory(problem, trajectory).axes]
    assert titles[-2:] == ["joint1", "joint2"]


def test_motors_are_drawn_in_rows_and_explained_once(curves):
    figure = Figure(layout="constrained")
    draw_motors(figure, curves, np.array([0, 1, 0]), columns=2)
    assert [bool(axis.get_ylabel()) for axis in figure.axes] == [True, False, True]
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["friction alone", "motion"]


def test_efforts_by_position_have_their_most_and_least(motion):
    problem, trajectory = motion
    table = EffortRange(1, np.array([-2.0, 0.0]), np.array([20.0, 27.0]), np.array([20.0, 27.0]))
    robot = with_motors(problem.robot, [table], viscous_friction=1.0)
    curves = trajectory_curves(replace(problem, robot=robot), trajectory)
    draw_motor(axis := Figure().subplots(), curves, 1)
    limits, _, _, _ = lines(axis)
    assert [set(line.get_ydata()) for line in limits] == [{27.0}, {-27.0}, {20.0}, {-20.0}]


def test_limits_by_direction_are_drawn_over_time_where_they_are_less(curves):
    draw_efforts(axis := Figure().subplots(), curves)
    forwards, backwards = (line.get_ydata() for line in axis.lines[-2:])
    assert np.isnan(forwards).all()  # as the limit of 100 %
    np.testing.assert_allclose(backwards, -100 * 70 / 95)
