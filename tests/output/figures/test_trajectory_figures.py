"""plot_trajectory, plot_cycle."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from cases import SHORTEST, rest_to_rest
from matplotlib.figure import Figure
from shown_cycle import CARRIED, GRIP, LEFT, RELEASE, START, TAKEN, motion_of, shown_cycle

from tubeplanner import (
    LimitOverrides,
    OutputError,
    PointSpeed,
    ProblemError,
    Tube,
    load_robot,
    plan,
    plot_convergence,
    plot_sweep,
    plot_trajectory,
    sweep,
)
from tubeplanner.output.curves import motion_curves, segments_per_group, size_of, trajectory_curves
from tubeplanner.output.figures.panels import draw_speed, draw_tube_use, draw_velocities
from tubeplanner.output.figures.trajectory_figures import plot_cycle, shown_name
from tubeplanner.task.motion import LegMotion, cycle_motion
from tubeplanner.task.steps import Event


@pytest.mark.dear("draws all panels")
def test_a_figure_shows_every_joint_against_its_limits(stored, tmp_path):
    problem, trajectory = stored("ur5/level_tray")
    figure = plot_trajectory(problem, trajectory)
    assert f"{trajectory.duration:.4f} s; nothing is faster than 0." in figure.get_suptitle()
    strip, position, velocity, effort, speed, use, clearance, space = figure.axes
    n = problem.robot.joint_count
    labels = [label.get_text() for label in strip.get_yticklabels()]
    assert labels == [*problem.robot.joint_names, "tool", "links"]
    switching = len(trajectory_curves(problem, trajectory).visits) - 1
    fractions = np.array([line.get_ydata() for line in effort.lines[:n]])
    assert abs(fractions).max() == pytest.approx(100, abs=3)
    drawn = [len(axis.lines) - switching for axis in (velocity, effort, use)]
    assert drawn == [n + 2, n + 2, 3]  # with limits; rotation too is bounded
    for axis in (position, velocity, effort, use, speed, clearance):
        assert "[" in axis.get_ylabel()
    named = [text.get_text() for text in space.get_legend().get_texts()]
    assert {"carried", "obstacles"} <= set(named)
    with pytest.raises(OutputError, match=r"the folder .*nowhere does not exist"):
        plot_trajectory(problem, trajectory, tmp_path / "nowhere" / "figure.png")


def test_the_tube_use_is_that_of_the_segment_the_tool_is_in_and_rotation_not_beyond(stored):
    """Round a corner, the segment left behind may be the nearer one; its radius holds no more."""
    use = trajectory_curves(*stored("ur5/level_tray", "refinement")).rotation_use
    assert 0.9 < use.max() <= 1 + 1e-5
    problem, trajectory = stored("ur5/over_the_wall", "branch-and-bound")
    curves = trajectory_curves(problem, trajectory)
    assert (curves.tube_use <= 1.001).all()
    assert [segment for segment, _, _ in curves.visits] == [0, 1, 2]


@pytest.fixture(scope="module")
def dense(stored):
    """Return a motion and its problem, the tube 300 points 1.9 mm beside the path, 2 mm wide."""
    problem, trajectory = stored("two_link/around_a_post", "refinement")
    time = np.linspace(0, trajectory.duration, 3000)
    path = problem.robot.tool_position(trajectory.position(time))
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    even = np.linspace(0, along[-1], 300)
    points = np.column_stack([np.interp(even, along, values) for values in path.T])
    return problem.with_tube(Tube(points + np.array([0, 0, 0.0019]), 0.002)), trajectory


def test_a_dense_path_is_never_used_beyond_its_radius_and_marked_as_a_few_groups(dense):
    """Far fewer samples than switching times could tell which segment the tool is in."""
    curves = trajectory_curves(*dense)
    assert 0.9 < curves.tube_use.max() <= 1 + 1e-4
    assert (np.diff(curves.segment) >= 0).all()
    assert len(plot_trajectory(*dense).axes[1].patches) == 6
    groups = {1: 1, 24: 1, 25: 5, 40: 5, 41: 10, 299: 50}
    assert {count: segments_per_group(count) for count in groups} == groups


def test_the_tool_speed_is_the_slope_of_its_path(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    curves, step = trajectory_curves(problem, trajectory), 1e-6
    time = np.clip(curves.samples.time, step, trajectory.duration - step)
    q = trajectory.position
    before, after = (problem.robot.tool_position(q(time + s)) for s in (-step, step))
    np.testing.assert_allclose(
        curves.speed, np.linalg.norm(after - before, axis=1) / (2 * step), atol=1e-3
    )


def test_where_the_factor_is_one_a_limit_is_met(stored):
    """Run as many times faster as the smallest says, and one limit is met, none exceeded."""
    problem, trajectory = stored("ur5/over_the_wall", "refinement")
    slow = trajectory_curves(problem, trajectory.scaled(1.5))
    fast = trajectory_curves(problem, trajectory)
    assert slow.factor.min() == pytest.approx(1.5 * fast.factor.min())
    assert np.quantile(fast.factor, 0.9) < 1.02


def test_convergence_ends_at_the_shortest_that_was_found(bundled):
    steps = []
    plan(bundled("two_link/paper_1_30mm"), SHORTEST, progress=steps.append)
    (axis,) = plot_convergence({"paper": steps, "nothing was told": []}).axes
    (line,) = axis.lines
    durations = [step.best_duration for step in steps if step.best_duration is not None]
    assert len(line.get_ydata()) == len(durations) > 5
    assert line.get_ydata().min() == 0


def test_a_sweep_is_drawn_with_its_slopes(bundled, tmp_path, undrawn):
    result, path = sweep(bundled("two_link/paper_1_30mm"), [0.01, 0.03]), tmp_path / "sweep.png"
    (axis,) = plot_sweep(result, path).axes
    assert path.read_bytes() == undrawn
    line, *tangents = axis.lines
    np.testing.assert_allclose(line.get_xdata(), [10, 30])
    np.testing.assert_allclose(line.get_ydata(), [row.duration for row in result.rows])
    for row, tangent in zip(result.rows, tangents, strict=True):
        x, y = tangent.get_data()
        assert y[1] == pytest.approx(row.duration)
        assert (y[2] - y[0]) / (x[2] - x[0]) * 1000 == pytest.approx(row.slope)


def test_the_speeds_limit_is_drawn_where_there_is_one(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    fastest = trajectory_curves(problem, trajectory).speed.max()
    tube = replace(problem.tube, tool_speed=[None, 1.2 * fastest, 9 * fastest])
    curves = trajectory_curves(problem.with_tube(tube), trajectory)
    expected = np.array([np.inf, 1.2, 9.0])[curves.segment] * fastest
    np.testing.assert_allclose(curves.speed_limit, expected)
    axis = Figure().subplots()
    draw_speed(axis, curves)
    _, limit = (line.get_ydata() for line in axis.lines)
    np.testing.assert_allclose(limit[curves.segment == 1], 1.2 * fastest)
    assert np.isnan(limit[curves.segment != 1]).all()  # free, or out of sight
    assert axis.get_ylim()[1] == pytest.approx(1.1 * 1.2 * fastest)
    draw_speed(axis := Figure().subplots(), trajectory_curves(problem, trajectory))
    assert axis.get_ylim()[1] == pytest.approx(1.1 * fastest)


def test_what_else_is_limited_has_its_panel(stored):
    """Effort rates, accelerations, jerks, speeds of points."""
    problem, trajectory = stored("two_link/around_a_post")
    assert "effort_rate" not in trajectory_curves(problem, trajectory).fractions
    limits = LimitOverrides(
        effort_rate={"joint1": 1e4, "joint2": 2e4},
        acceleration={"joint2": 200.0},
        jerk={"joint1": 5000.0},
        point_speed=[PointSpeed("link2", (0, 0, 0), 2.0), PointSpeed("hand", (0, 0, 0), 4.0)],
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    limited = replace(problem, robot=robot)
    curves = trajectory_curves(limited, trajectory)
    axes = plot_trajectory(limited, trajectory).axes
    panels = {axis.get_ylabel().split(" [")[0]: axis for axis in axes}

    rates = panels["effort rate"].lines
    step = np.diff(rates[0].get_xdata()) > 0
    duration = np.diff(rates[0].get_xdata())[step]
    numeric = np.diff(curves.effort, axis=0)[step] / duration[:, None]
    rate = curves.fractions["effort_rate"] * [1e4, 2e4]
    middle = (rate[1:] + rate[:-1])[step] / 2
    np.testing.assert_allclose(middle, numeric, atol=2e-2 * abs(rate).max())
    for joint, limit in enumerate((1e4, 2e4)):
        np.testing.assert_allclose(rates[joint].get_ydata(), 100 * rate[:, joint] / limit)

    fraction = panels["acceleration"].lines[0].get_ydata()
    np.testing.assert_allclose(fraction, curves.samples.acceleration[:, 1] / 2)
    drawn = panels["jerk"].lines[0].get_ydata()
    np.testing.assert_allclose(drawn[np.isfinite(drawn)], curves.jerk[:, 0] / 50)
    np.testing.assert_allclose(curves.points[:, 1], curves.speed / 4.0, atol=1e-12)
    (points,) = (axis for name, axis in panels.items() if name.startswith("speed of points"))
    np.testing.assert_allclose(points.lines[0].get_ydata(), 100 * curves.points[:, 0])


def test_velocity_limits_by_position_are_drawn_where_they_are_less(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    law = {"deceleration": 2.0, "offset": 0.1, "lower": -9.0, "upper": 2.2}
    limits = LimitOverrides(velocity_by_position={"elbow_joint": law})
    robot = load_robot("example:ur5", "tool0", limits=limits)
    curves = trajectory_curves(replace(problem, robot=robot), trajectory)
    draw_velocities(plain := Figure().subplots(), trajectory_curves(problem, trajectory))
    draw_velocities(axis := Figure().subplots(), curves)
    upper, lower = (line.get_ydata() for line in axis.lines[len(plain.lines) :])
    most = robot.limits.velocity[2]
    allowed = np.sqrt(4.0 * (2.2 - curves.samples.position[:, 2])) - 0.1
    np.testing.assert_allclose(upper, np.where(allowed < most, 100 * allowed / most, np.nan))
    assert np.isnan(lower).all()


def test_boxes_are_called_by_their_sides(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    tube = problem.tube
    sections = [None, {"box": [0.3, 2 * tube.radius[1] + 0.02], "up": [0, 0, 1]}, None]
    radii = [tube.radius[0], None, tube.radius[2]]
    signs = tube.joint_signs
    boxes = problem.with_tube(Tube(tube.points, radii, cross_section=sections, joint_signs=signs))
    curves = trajectory_curves(boxes, trajectory)
    assert curves.tube_use.max() <= 1.0
    axis = Figure().subplots()
    draw_tube_use(axis, curves)
    assert axis.get_legend().get_texts()[0].get_text() == "distance / radius or half side"
    height = f"{1000 * boxes.tube.cross_section[1, 1]:.3g}"
    assert size_of(boxes.tube, 1) == f"300 x {height} mm"
    thick = replace(boxes.tube, tool_radius=0.005)
    assert size_of(thick, 1).startswith("290 x ")


@pytest.fixture(scope="module")
def cycle(tmp_path_factory):
    return shown_cycle(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def motion(cycle):
    return motion_of(cycle)


@pytest.fixture(scope="module")
def axes(cycle, motion):
    with pytest.raises(ProblemError, match="give a Cycle"):
        plot_cycle("cycle", motion)
    return plot_cycle(cycle, motion).axes


def test_curves_follow_each_other_without_gaps(cycle, motion):
    runs = motion_curves(motion)
    times = [(run.samples.time[0], run.samples.time[-1]) for run in runs]
    rest, second = 1 + GRIP, 2 + GRIP
    expected = [(0, 1), (1, rest), (rest, second), (second, second + RELEASE)]
    np.testing.assert_allclose(times, [*expected, (second + RELEASE, 3 + GRIP + RELEASE)])
    for before, after in pairwise(runs):
        np.testing.assert_allclose(before.samples.position[-1], after.samples.position[0])
        np.testing.assert_allclose(before.tool[-1], after.tool[0])


def test_efforts_are_those_of_what_is_carried(cycle, motion):
    """The part is carried while the gripper opens, and not yet while it closes."""
    _, closing, carrying, opening, back = motion_curves(motion)
    loaded = cycle.robot.with_payload(CARRIED)
    np.testing.assert_allclose(closing.effort[0], cycle.robot.gravity_effort(TAKEN))
    np.testing.assert_allclose(opening.effort[0], loaded.gravity_effort(LEFT))
    np.testing.assert_allclose(carrying.effort[0], loaded.gravity_effort(TAKEN), atol=1e-9)
    np.testing.assert_allclose(back.effort[0], cycle.robot.gravity_effort(LEFT), atol=1e-9)
    assert not closing.samples.velocity.any()


@pytest.mark.dear("makes a figure of a cycle")
def test_a_leg_that_begins_where_it_has_no_place_is_drawn(cycle, tmp_path, undrawn):
    ends = np.array([START, [3.5, 0.0, 0.0], LEFT, START])  # beyond a joint's limit
    names = cycle.robot.joint_names
    legs = [rest_to_rest(names, *pair, 1.0) for pair in pairwise(ends)]
    passed = ((), (0.5,), ())
    motion = cycle_motion(cycle, [LegMotion(*each) for each in zip(legs, passed, strict=True)])
    with pytest.raises(ProblemError):
        cycle.problem(1, motion.junctions[:2])
    assert len(motion_curves(motion)) == 5
    plot_cycle(cycle, motion, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes() == undrawn


def test_a_rest_at_the_end_is_drawn(cycle):
    cooled = replace(cycle, steps=[*cycle.steps, Event("cool", dwell=0.5)])
    motion = motion_of(cooled)
    last, end = motion_curves(motion)[-1], motion.trajectory.duration
    np.testing.assert_allclose(last.samples.time, [end - 0.5, end])
    np.testing.assert_allclose(last.samples.position[0], motion.junctions[-1])


def test_every_panel_has_all_of_the_cycle(axes, motion):
    _, position, velocity, effort, speed, use, clearance, space = axes
    for axis in (position, velocity, effort, speed, use, clearance):
        assert axis.get_xlim() == (0, pytest.approx(motion.trajectory.duration))
        curves = [line for line in axis.lines if len(line.get_xdata()) > 2]
        last = max(np.max(line.get_xdata()) for line in curves)
        assert last == pytest.approx(motion.trajectory.duration)
    assert "carried" in [text.get_text() for text in space.get_legend().get_texts()]


def test_moves_and_what_happens_at_rest_are_named(axes):
    strip, _, _, _, speed, *_ = axes
    assert [text.get_text() for text in strip.texts[-4:]] == ["reach", "carry", "on", "back"]
    assert [text.get_text() for text in speed.texts] == [
        "grip 'close' (0.1 s)",
        "attach part, attach cap",
        "grip 'open' (0.2 s)",
        "detach part, detach cap",
    ]


def test_a_name_is_cut_where_a_move_is_short():
    shown = [shown_name("into_the_chuck", slack) for slack in (14, 8, 4)]
    assert [*shown, shown_name("back", 4)] == ["into_the_chuck", "into_t...", "", "back"]
