"""Panels: what binds when, clearance, efforts over velocities."""

from dataclasses import replace

import numpy as np
import pytest
from cases import SHORTEST, with_motors
from matplotlib.figure import Figure

from tubeplanner import load_problem, plan, plot_trajectory
from tubeplanner.limits.binding_limits import Span
from tubeplanner.output.curves import BindingStrip, LimitedSection, binding_strip, trajectory_curves
from tubeplanner.output.figures.panels import (
    draw_clearance,
    draw_efforts,
    draw_holding,
    draw_motor,
    draw_strip,
    motor_joints,
    percent,
    time_panels,
)
from tubeplanner.robot.joint_limits import EffortRange
from tubeplanner.robot.pinocchio_model import Payload
from tubeplanner.task.holding import Holding, Liquid, Tray

MOTORS = {
    "robot.limits.effort": {"joint1": [70, 95], "joint2": 27},
    "robot.motors.coulomb_friction": {"joint1": [4, 8]},
    "robot.motors.viscous_friction": {"joint1": 1.5},
    "robot.motors.saturation_effort": {"joint2": 40},
    "robot.motors.no_load_velocity": {"joint2": 12},
}


@pytest.fixture(scope="module")
def fast(stored):
    """A fast motion over a wall, and its limits."""
    return LimitedSection(*stored("ur5/over_the_wall", "refinement"))


def test_a_fast_motion_is_at_some_limit_nearly_all_the_time(fast, stored):
    problem, trajectory = stored("ur5/over_the_wall", "refinement")
    strip = binding_strip([fast], fast.trajectory.duration)
    assert list(strip.rows) == [*problem.robot.joint_names, "tool", "links"]
    assert strip.joint_count == problem.robot.joint_count
    assert 0.98 < strip.speed_fraction <= 1.0
    slow = LimitedSection(problem, trajectory.scaled(2.0))
    assert slow.trajectory.duration == pytest.approx(2 * fast.trajectory.duration)
    assert binding_strip([slow], slow.trajectory.duration).speed_fraction == 0.0


def test_motions_one_after_the_other_share_the_time(fast):
    duration = fast.trajectory.duration
    once = binding_strip([fast], duration)
    twice = binding_strip([fast, replace(fast, begin=2 * duration)], 4 * duration)
    assert twice.speed_fraction == pytest.approx(once.speed_fraction / 2)
    for kind, fraction in once.fractions.items():
        assert twice.fractions[kind] == pytest.approx(fraction / 2)
    for name, spans in once.rows.items():
        later = [Span(s.kind, s.begin + 2 * duration, s.end + 2 * duration) for s in spans]
        assert twice.rows[name] == [*spans, *later]


def test_the_strip_has_a_bar_for_every_stretch_and_names_its_kind():
    rows = {"joint1": [Span("effort", 0.0, 0.5)], "tool": [Span("tube", 0.5, 0.502)], "links": []}
    strip = BindingStrip(rows, {"tube": 0.002, "effort": 0.5, "new": 0.01}, 0.5, 1.0, 1)
    draw_strip(axis := Figure().subplots(), strip)
    bars = [patch for patch in axis.patches if patch.get_zorder() == 2]
    spans = [(bar.get_x(), bar.get_width()) for bar in bars]
    assert spans == [(0.0, 0.5), (0.5, pytest.approx(0.002))]
    texts = [text.get_text() for text in axis.texts]
    assert "effort" in texts and "tube" not in texts  # in its bar; the other one is too short
    assert any("50 % of the time" in text for text in texts)
    legend = [text.get_text() for text in axis.get_legend().get_texts()]
    assert legend == ["effort 50 %", "new 1 %", "tube 0.2 %"]  # "new": a kind that is not known
    shown = [percent(fraction) for fraction in (0.0, 0.0003, 0.234, 0.9996, 1.0)]
    assert shown == ["0 %", "0.1 %", "23 %", "99.9 %", "100 %"]


def test_the_clearance_panel_names_the_nearest_pairs(fast):
    draw_clearance(axis := Figure().subplots(), [replace(fast, begin=1.0)])
    obstacles, links = fast.closest
    drawn = axis.lines[0]
    np.testing.assert_allclose(drawn.get_xdata(), 1.0 + obstacles.time)
    np.testing.assert_allclose(drawn.get_ydata(), 1000 * obstacles.distance)
    np.testing.assert_allclose(axis.lines[1].get_ydata(), 1000 * fast.problem.clearance)
    texts = [text.get_text() for text in axis.get_legend().get_texts()]
    for pairs, text in zip((obstacles, links), texts, strict=True):
        k = pairs.margin.argmin()
        assert " - ".join(pairs.names[k]) in text
        assert f"{1000 * pairs.distance[k]:.3g} mm" in text


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
    return [lines(axis) for axis in axes]


def lines(axis):
    """Return the lines of a panel: the motor's limits, velocity limits, friction, motion."""
    *limits, backwards, forwards, friction, motion = axis.lines
    return limits, (backwards, forwards), friction, motion


def test_a_motor_has_its_own_effort_each_way_and_friction_by_direction(panels, curves):
    (forwards, backwards), _, friction, motion = panels[0]
    assert set(forwards.get_ydata()) == {95.0}
    assert set(backwards.get_ydata()) == {-70.0}
    np.testing.assert_array_equal(motion.get_xdata(), curves.samples.velocity[:, 0])
    np.testing.assert_array_equal(motion.get_ydata(), curves.effort[:, 0])
    x, y = friction.get_data()
    np.testing.assert_allclose(y, 1.5 * x + np.where(x > 0, 8.0, -4.0))
    assert (x[1:] > x[:-1]).all()
    assert abs(x).min() < 1e-6  # it jumps at zero, and nowhere else


def test_a_torque_speed_line_cuts_the_corners(panels):
    """Driving, 40 (1 - |v| / 12) is left; braking, the limit."""
    (forwards, backwards), _, friction, _ = panels[1]
    v = forwards.get_xdata()
    np.testing.assert_allclose(forwards.get_ydata(), np.minimum(27, 40 * (1 - v / 12)))
    np.testing.assert_allclose(backwards.get_ydata(), -np.minimum(27, 40 * (1 + v / 12)))
    assert not friction.get_ydata().any()


def test_limits_of_velocity_end_what_a_motor_has(stored):
    problem, trajectory = stored("ur5/over_the_wall", "refinement")
    problem = replace(problem, robot=with_motors(problem.robot, forwards_friction=3.0))
    draw_motor(axis := Figure().subplots(), trajectory_curves(problem, trajectory), 2)
    _, ends, _, _ = lines(axis)
    most = problem.robot.limits.velocity[2]
    assert [end.get_xdata()[0] for end in ends] == [-most, most]


def test_only_joints_whose_motors_are_known_have_a_panel(motion):
    problem, trajectory = motion
    robot = problem.robot
    for kind in ("viscous_friction", "backwards_friction", "forwards_friction"):
        assert motor_joints(with_motors(robot, **{kind: np.array([0.0, 1.0])})).tolist() == [1]
    assert motor_joints(with_motors(robot, armature=1.0)).tolist() == []
    first = {"saturation_effort": [5.0, np.inf], "no_load_velocity": [5.0, np.inf]}
    assert motor_joints(with_motors(robot, **first)).tolist() == [0]
    titles = [axis.get_title() for axis in plot_trajectory(problem, trajectory).axes]
    assert titles[-2:] == ["joint1", "joint2"]


def test_efforts_by_position_have_their_most_and_least(motion):
    problem, trajectory = motion
    table = EffortRange(1, np.array([-2.0, 0.0]), np.array([20.0, 27.0]), np.array([20.0, 27.0]))
    robot = with_motors(problem.robot, [table], viscous_friction=1.0)
    curves = trajectory_curves(replace(problem, robot=robot), trajectory)
    draw_motor(axis := Figure().subplots(), curves, 1)
    limits, _, _, _ = lines(axis)
    assert [set(line.get_ydata()) for line in limits] == [{27.0}, {-27.0}, {20.0}, {-20.0}]


def test_efforts_by_direction_are_drawn_over_time_where_they_are_less(curves):
    draw_efforts(axis := Figure().subplots(), curves)
    forwards, backwards = (line.get_ydata() for line in axis.lines[-2:])
    assert np.isnan(forwards).all()  # as the limit of 100 %
    np.testing.assert_allclose(backwards, -100 * 70 / 95)


def test_the_panel_of_held_parts_shows_what_each_contact_carries(stored):
    problem, trajectory = stored("ur5/level_tray", "refinement")
    contacts = (
        Holding(Tray(0.6, 0.03), Payload(0.5, (0, 0, 0.06))),
        Holding(Liquid(0.3)),
    )
    held = replace(problem, holding=contacts)
    fast, slow = (trajectory_curves(held, trajectory.scaled(factor)) for factor in (1.0, 6.0))
    assert draw_holding not in time_panels([trajectory_curves(problem, trajectory)])
    assert draw_holding in time_panels([slow])
    for curves, holds in ((fast, False), (slow, True)):
        draw_holding(axis := Figure().subplots(), curves)
        lines = {line.get_label(): line.get_ydata() for line in axis.lines[:-1]}
        assert list(lines) == [
            f"{kind}, {when}" for kind in ("tray", "liquid") for when in ("at speed", "at rest")
        ]
        for kind in ("tray", "liquid"):
            assert (lines[f"{kind}, at speed"].max() <= 100) == holds
            assert lines[f"{kind}, at rest"].max() <= 100
        assert {text.get_text() for text in axis.texts} >= {"spills", "tips"}
