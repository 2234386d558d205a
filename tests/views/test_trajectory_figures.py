"""plot_trajectory, plot_cycle."""

import io
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from cases import SHORTEST, changed, rest_to_rest
from matplotlib.figure import Figure
from PIL import Image
from shown_cycle import CARRIED, GRIP, LEFT, RELEASE, START, TAKEN, motion_of, shown_cycle

from tubeplanner import (
    LimitOverrides,
    OutputError,
    PointSpeed,
    ProblemError,
    Tube,
    load_problem,
    load_robot,
    plan,
    plot_convergence,
    plot_sweep,
    plot_trajectory,
    sweep,
)
from tubeplanner.cycle.cycle_motion import LegMotion, cycle_motion
from tubeplanner.cycle.steps import Event
from tubeplanner.views.cycle_curves import cycle_curves
from tubeplanner.views.cycle_marks import name_steps, shown_name
from tubeplanner.views.cycle_plot import plot_cycle
from tubeplanner.views.cycle_timeline import cycle_timeline
from tubeplanner.views.figure_files import figure_file
from tubeplanner.views.panels import draw_factor, draw_speed, draw_tube_use, draw_velocities
from tubeplanner.views.stretch import segments_per_group, size_of, trajectory_curves


@pytest.mark.dear("draws all panels and, of one motion, pixels")
@pytest.mark.parametrize("name", ["two_link/around_a_post", "ur5/level_tray"])
def test_a_figure_shows_every_joint_against_its_limits(name, stored, tmp_path):
    problem, trajectory = stored(name)
    figure = plot_trajectory(problem, trajectory)
    strip, position, velocity, effort, speed, use, clearance, space = figure.axes
    n = problem.robot.joint_count
    labels = [label.get_text() for label in strip.get_yticklabels()]
    assert labels == [*problem.robot.joint_names, "tool", "links"]
    visits = trajectory_curves(problem, trajectory).visits
    switching_samples = len(visits) - 1
    assert len(effort.lines) == n + 2 + switching_samples
    shares = np.array([line.get_ydata() for line in effort.lines[:n]])
    assert abs(shares).max() == pytest.approx(100, abs=3)
    limited = np.isfinite(problem.robot.limits.velocity).all()
    assert len(velocity.lines) == n + 2 * limited + switching_samples
    for axis in (position, velocity, effort, use, speed, clearance):
        assert "[" in axis.get_ylabel()
    assert speed.get_xlabel() == clearance.get_xlabel() == "time [s]"  # below their columns
    assert use.lines[0].get_ydata().max() <= 100.1
    assert (problem.tube.rotation is not None) == (len(use.lines) - switching_samples == 3)
    assert speed.lines[0].get_ydata().max() > 0.1
    named = [text.get_text() for text in space.get_legend().get_texts()]
    assert ("carried" in named) == bool(problem.attached)
    assert ("obstacles" in named) == bool(problem.obstacles)
    if problem.attached:
        pixels = np.asarray(Image.open(io.BytesIO(figure_file(figure, Path("a.png")))))
        assert len(np.unique(pixels[..., :3] @ [1 << 16, 1 << 8, 1])) > 1000  # not blank
    else:
        with pytest.raises(OutputError, match=r"the folder .*nowhere does not exist"):
            plot_trajectory(problem, trajectory, tmp_path / "nowhere" / "figure.png")


def test_the_tube_use_is_that_of_the_segment_the_tool_is_in(stored):
    """Round a corner, the segment left behind may be the nearer one; its radius holds no more."""
    problem, trajectory = stored("ur5/over_the_wall", "branch-and-bound")
    curves = trajectory_curves(problem, trajectory)
    assert (curves.tube_use <= 1.001).all()
    assert [segment for segment, _, _ in curves.visits] == [0, 1, 2]
    assert curves.visits[0][1] == 0
    assert curves.visits[-1][2] == pytest.approx(trajectory.duration)


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
    strip, position, *_ = plot_trajectory(*dense).axes
    assert len(position.patches) == 6
    labels = [text.get_text() for text in strip.texts]
    groups = [label.removeprefix("segments ").split(":")[0] for label in labels if label]
    for group in ("0-49", "50-99", "100-149", "150-199", "200-249", "250-298"):
        assert group in groups


@pytest.mark.parametrize(
    ("count", "together"), [(1, 1), (24, 1), (25, 5), (40, 5), (41, 10), (299, 50)]
)
def test_segments_are_marked_by_round_numbers(count, together):
    assert segments_per_group(count) == together


def test_the_rotation_tolerance_is_used_but_not_beyond(stored):
    problem, trajectory = stored("ur5/level_tray", "refinement")
    use = trajectory_curves(problem, trajectory).rotation_use
    assert 0.9 < use.max() <= 1 + 1e-5


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


def test_convergence_ends_at_the_shortest_that_was_found():
    steps = []
    result = plan(load_problem("example:two_link/paper_1_30mm"), SHORTEST, progress=steps.append)
    (axis,) = plot_convergence({"paper": steps, "nothing was told": []}).axes
    (line,) = axis.lines
    durations = [step.best_duration for step in steps if step.best_duration is not None]
    assert len(line.get_ydata()) == len(durations) > 5
    assert line.get_ydata().min() == 0
    assert min(durations) == pytest.approx(result.duration, rel=0.01)


def test_a_sweep_is_drawn_with_its_slopes_and_its_gaps(tmp_path, undrawn):
    problem = load_problem("example:two_link/paper_1_30mm")
    result = sweep(problem.with_tube(problem.tube), [0.01, 0.03])
    path = tmp_path / "sweep.png"
    (axis,) = plot_sweep(result, path).axes
    assert path.read_bytes() == undrawn
    line, *tangents = axis.lines
    np.testing.assert_allclose(line.get_xdata(), [10, 30])
    np.testing.assert_allclose(line.get_ydata(), [row.duration for row in result.rows])
    assert len(tangents) == 2
    for row, tangent in zip(result.rows, tangents, strict=True):
        x, y = tangent.get_data()
        assert y[1] == pytest.approx(row.duration)
        assert (y[2] - y[0]) / (x[2] - x[0]) * 1000 == pytest.approx(row.slope)


def test_several_trajectories_share_an_axis(stored):
    problem, trajectory = stored("two_link/around_a_post")
    axis = Figure().subplots()
    curves = trajectory_curves(problem, trajectory)
    for number, label in enumerate(("one", "two")):
        draw_factor(axis, curves, label, number)
    dashes = {line.get_linestyle() for line in axis.lines if line.get_label() in ("one", "two")}
    assert len(dashes) == 2  # told apart in grey


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


def test_effort_rates_have_a_panel_where_they_are_limited(stored):
    problem, trajectory = stored("two_link/around_a_post")
    assert trajectory_curves(problem, trajectory).effort_rate is None
    limits = LimitOverrides(
        velocity=dict.fromkeys(problem.robot.joint_names, np.inf),
        effort_rate=dict(zip(problem.robot.joint_names, (1e4, 2e4), strict=True)),
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    limited = changed(problem, robot=robot)
    figure = plot_trajectory(limited, trajectory)
    assert len(figure.axes) == 9  # one more than without
    (axis,) = (axis for axis in figure.axes if axis.get_ylabel() == "effort rate [% of limit]")
    rate = trajectory_curves(limited, trajectory).effort_rate
    effort = trajectory_curves(limited, trajectory).effort
    time = axis.lines[0].get_xdata()
    step = np.diff(time) > 0
    numeric = np.diff(effort, axis=0)[step] / np.diff(time)[step, None]
    middle = (rate[1:] + rate[:-1])[step] / 2
    np.testing.assert_allclose(middle, numeric, atol=2e-2 * abs(rate).max())
    for joint, limit in enumerate((1e4, 2e4)):
        np.testing.assert_allclose(axis.lines[joint].get_ydata(), 100 * rate[:, joint] / limit)


def test_accelerations_jerks_and_points_have_panels_where_they_are_limited(stored):
    problem, trajectory = stored("two_link/around_a_post")
    limits = LimitOverrides(
        velocity=dict.fromkeys(problem.robot.joint_names, np.inf),
        acceleration={"joint2": 200.0},
        jerk={"joint1": 5000.0},
        point_speed=[PointSpeed("link2", (0, 0, 0), 2.0), PointSpeed("hand", (0, 0, 0), 4.0)],
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    limited = replace(problem, robot=robot)
    curves = trajectory_curves(limited, trajectory)
    axes = plot_trajectory(limited, trajectory).axes
    assert len(axes) == 11  # three more than without
    panels = {axis.get_ylabel().split(" [")[0]: axis for axis in axes}
    share = panels["acceleration"].lines[0].get_ydata()
    np.testing.assert_allclose(share, curves.samples.acceleration[:, 1] / 2)
    np.testing.assert_allclose(panels["jerk"].lines[0].get_ydata(), curves.jerk[:, 0] / 50)
    assert panels["jerk"].get_title(loc="right") == "no limit: joint2"
    np.testing.assert_allclose(curves.points[:, 1], curves.speed / 4.0, atol=1e-12)
    (points,) = (axis for name, axis in panels.items() if name.startswith("speed of points"))
    labels = [text.get_text() for text in points.get_legend().get_texts()]
    assert labels == ["0: link2", "1: hand"]
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
    assert np.isfinite(upper).any()


def in_boxes(problem):
    """Return a problem with a flat box about its second segment."""
    tube = problem.tube
    sections = [None] * tube.segment_count
    sections[1] = {"box": [0.3, 2 * tube.radius[1] + 0.02], "up": [0, 0, 1]}
    radii = [None if k == 1 else radius for k, radius in enumerate(tube.radius)]
    boxes = Tube(tube.points, radii, cross_section=sections, joint_signs=tube.joint_signs)
    return problem.with_tube(boxes)


def test_boxes_are_called_by_their_sides(stored):
    problem, trajectory = stored("ur5/over_the_wall")
    boxes = in_boxes(problem)
    curves = trajectory_curves(boxes, trajectory)
    assert curves.tube_use.max() <= 1.0
    axis = Figure().subplots()
    draw_tube_use(axis, curves)
    assert axis.get_legend().get_texts()[0].get_text() == "distance / radius or half side"
    height = f"{1000 * boxes.tube.cross_section[1, 1]:.3g}"
    assert size_of(boxes.tube, 1) == f"300 x {height} mm"
    assert size_of(boxes.tube, 0) == size_of(problem.tube, 0)
    section = {"box": [0.3, 0.1], "up": [1, 1, 3]}
    thick = Tube(boxes.tube.points, None, cross_section=section, tool_radius=0.01)
    assert size_of(thick, 0) == "280 x 80 mm"


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
    runs = cycle_curves(cycle, motion)
    times = [(run.samples.time[0], run.samples.time[-1]) for run in runs]
    rest, second = 1 + GRIP, 2 + GRIP
    expected = [(0, 1), (1, rest), (rest, second), (second, second + RELEASE)]
    np.testing.assert_allclose(times, [*expected, (second + RELEASE, 3 + GRIP + RELEASE)])
    for before, after in pairwise(runs):
        np.testing.assert_allclose(before.samples.position[-1], after.samples.position[0])
        np.testing.assert_allclose(before.tool[-1], after.tool[0])


def test_efforts_are_those_of_what_is_carried(cycle, motion):
    """The part is carried while the gripper opens, and not yet while it closes."""
    _, closing, carrying, opening, back = cycle_curves(cycle, motion)
    loaded = cycle.robot.with_payload(CARRIED)
    np.testing.assert_allclose(closing.effort[0], cycle.robot.gravity_effort(TAKEN))
    np.testing.assert_allclose(opening.effort[0], loaded.gravity_effort(LEFT))
    np.testing.assert_allclose(carrying.effort[0], loaded.gravity_effort(TAKEN), atol=1e-9)
    np.testing.assert_allclose(back.effort[0], cycle.robot.gravity_effort(LEFT), atol=1e-9)
    assert abs(closing.effort[0] - carrying.effort[0]).max() > 5
    assert not closing.samples.velocity.any()


def test_the_problem_of_a_leg_is_that_which_the_judge_has(cycle, motion):
    """Its start and cell count where the tool goes over from segment to segment."""
    legs = [run for run in cycle_curves(cycle, motion) if len(run.samples.time) > 2]
    for k, run in enumerate(legs):
        np.testing.assert_array_equal(run.problem.start, motion.seams[k])
        names = {solid.name for solid in run.problem.attached}
        assert names == ({"part", "cap"} if k == 1 else set())


def test_a_leg_that_begins_where_it_has_no_place_is_drawn(cycle, tmp_path, undrawn):
    ends = np.array([START, [3.5, 0.0, 0.0], LEFT, START])  # beyond a joint's limit
    names = cycle.robot.joint_names
    legs = [rest_to_rest(names, *pair, 1.0) for pair in pairwise(ends)]
    passed = ((), (0.5,), ())
    motion = cycle_motion(cycle, [LegMotion(*each) for each in zip(legs, passed, strict=True)])
    with pytest.raises(ProblemError):
        cycle.problem(1, motion.seams[:2])
    assert len(cycle_curves(cycle, motion)) == 5
    plot_cycle(cycle, motion, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes() == undrawn


def test_a_dwell_is_loaded_once_something_is_taken_and_a_rest_at_the_end_drawn(cycle):
    steps = [
        *cycle.steps[:4],
        Event("settle", dwell=0.3),
        *cycle.steps[4:],
        Event("cool", dwell=0.5),
    ]
    settled = replace(cycle, steps=steps)
    motion = motion_of(settled)
    _, closing, settling, *_, last = cycle_curves(settled, motion)
    np.testing.assert_allclose(closing.effort[0], cycle.robot.gravity_effort(TAKEN))
    loaded = cycle.robot.with_payload(CARRIED)
    np.testing.assert_allclose(settling.effort, [loaded.gravity_effort(TAKEN)] * 2)
    end = motion.trajectory.duration
    np.testing.assert_allclose(last.samples.time, [end - 0.5, end])
    np.testing.assert_allclose(last.samples.position[0], motion.seams[-1])


def test_every_panel_has_all_of_the_cycle(axes, cycle, motion):
    strip, position, velocity, effort, speed, use, clearance, space = axes
    labels = [label.get_text() for label in strip.get_yticklabels()]
    assert labels[: cycle.robot.joint_count] == list(cycle.robot.joint_names)
    for axis in (position, velocity, effort, speed, use, clearance):
        assert axis.get_xlim() == (0, pytest.approx(motion.trajectory.duration))
        curves = [line for line in axis.lines if len(line.get_xdata()) > 2]
        last = max(np.max(line.get_xdata()) for line in curves)
        assert last == pytest.approx(motion.trajectory.duration)
        drawn = np.concatenate([line.get_ydata() for line in curves])
        low, high = axis.get_ylim()
        assert low <= np.nanmin(drawn)
        assert np.nanmax(drawn) < high or axis is use
    names = [text.get_text() for text in space.get_legend().get_texts()]
    assert "carried" in names


def test_moves_and_what_happens_at_rest_are_named(axes):
    strip, _, _, _, speed, *_ = axes
    assert [text.get_text() for text in strip.texts[-4:]] == ["reach", "carry", "on", "back"]
    assert [text.get_text() for text in speed.texts] == [
        "grip 'close' (0.1 s)",
        "attach part, attach cap",
        "grip 'open' (0.2 s)",
        "detach part, detach cap",
    ]
    assert speed.get_ylim()[0] == 0


def test_a_name_is_cut_where_a_move_is_short():
    assert shown_name("into_the_chuck", 14) == "into_the_chuck"
    assert shown_name("into_the_chuck", 8) == "into_t..."
    assert shown_name("into_the_chuck", 4) == ""
    assert shown_name("back", 4) == "back"


def test_names_that_would_be_on_each_other_are_moved_aside(cycle):
    steps = [*cycle.steps[:2], Event("soon", dwell=0.001), *cycle.steps[2:]]
    steps[1] = Event("grip", dwell=0.001)
    motion = motion_of(replace(cycle, steps=steps))
    name_steps(axis := Figure().subplots(), cycle_timeline(motion), motion.trajectory.duration)
    grip, soon, attach, *_ = (text.xy[0] for text in axis.texts)
    assert grip == pytest.approx(1.0)
    assert soon - grip > 0.05
    assert attach - soon > 0.05
