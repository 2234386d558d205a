"""The figure of a cycle: limits of the moves, loads, rests and names."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from cases import rest_to_rest
from shown_cycle import CARRIED, GRIP, LEFT, RELEASE, START, TAKEN, motion_of, shown_cycle
from tubeplanner import ProblemError
from tubeplanner.cycle.cycle_motion import LegMotion, cycle_motion
from tubeplanner.cycle.steps import Event
from tubeplanner.views.cycle_curves import cycle_curves
from tubeplanner.views.cycle_marks import shown_name
from tubeplanner.views.cycle_plot import plot_cycle


@pytest.fixture(scope="module")
def cycle(tmp_path_factory):
    return shown_cycle(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def motion(cycle):
    return motion_of(cycle)


@pytest.fixture(scope="module")
def axes(cycle, motion):
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


def test_a_leg_that_begins_where_it_has_no_place_is_drawn(cycle):
    ends = np.array([START, [3.5, 0.0, 0.0], LEFT, START])  # beyond a joint's limit
    names = cycle.robot.joint_names
    legs = [rest_to_rest(names, *pair, 1.0) for pair in pairwise(ends)]
    passed = ((), (0.5,), ())
    motion = cycle_motion(cycle, [LegMotion(*each) for each in zip(legs, passed, strict=True)])
    with pytest.raises(ProblemError):
        cycle.problem(1, motion.seams[:2])
    assert len(cycle_curves(cycle, motion)) == 5


def test_a_dwell_is_loaded_once_something_is_taken(cycle):
    steps = [*cycle.steps[:4], Event("settle", dwell=0.3), *cycle.steps[4:]]
    settled = replace(cycle, steps=steps)
    _, closing, settling, *_ = cycle_curves(settled, motion_of(settled))
    np.testing.assert_allclose(closing.effort[0], cycle.robot.gravity_effort(TAKEN))
    loaded = cycle.robot.with_payload(CARRIED)
    np.testing.assert_allclose(settling.effort, [loaded.gravity_effort(TAKEN)] * 2)


def test_a_rest_at_the_end_is_drawn(cycle, motion):
    longer = replace(cycle, steps=[*cycle.steps, Event("cool", dwell=0.5)])
    last = cycle_curves(longer, motion_of(longer))[-1]
    np.testing.assert_allclose(last.samples.time, motion.trajectory.duration + np.array([0, 0.5]))
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
    told = [text.get_text() for text in speed.texts]
    assert told == [
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
    crowded = replace(cycle, steps=steps)
    axes = plot_cycle(crowded, motion_of(crowded)).axes
    grip, soon, attach, *_ = (text.xy[0] for text in axes[4].texts)
    assert grip == pytest.approx(1.0)
    assert soon - grip > 0.05
    assert attach - soon > 0.05


def test_a_figure_is_saved(cycle, motion, tmp_path):
    path = tmp_path / "figure.png"
    plot_cycle(cycle, motion, path)
    assert path.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(ProblemError, match="give a Cycle"):
        plot_cycle("cycle", motion)
