"""Executed runs: paths inside and outside the tube, tolerance left over time, figures."""

import numpy as np
import pytest
from cases import followed, quintic
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from simulated_cycle import DURATION, DWELL, followed_cycle, motion_of, picking
from stored_trajectories import REFINEMENT

from tubeplanner import OptionError, OutputError, judged_runs, plot_execution, verify
from tubeplanner.execution.run_verdict import judged_cycle
from tubeplanner.output.drawing import EXECUTED_COLOR, WARNING_COLOR
from tubeplanner.output.execution_curves import (
    executed_paths,
    motion_paths,
    obstacle_band,
    tool_runs,
)
from tubeplanner.output.figures import figure_files
from tubeplanner.output.figures.execution_figures import plot_cycle_execution
from tubeplanner.output.page.viewer import view_cycle

ASIDE = 0.012  # [m]


def test_a_plan_that_is_followed_has_the_margins_of_the_plan(stored):
    problem, motion = stored("ur5/level_tray", REFINEMENT)
    result = tool_runs(problem, motion, followed(problem, motion, np.zeros((2, 3)), 0.0005))
    for band, condition in ((result.tube, "tube"), (result.rotation, "rotation")):
        np.testing.assert_array_equal(band.runs, [band.plan, band.plan])
        judged = verify(problem, motion).conditions[condition]
        assert band.plan.min() == pytest.approx(judged.margin, abs=1e-3)
    np.testing.assert_array_equal(result.runs[0], result.plan)


def test_a_base_that_stands_aside_takes_as_much_from_the_margin(slider):
    """The cart runs along the axis of a straight tube."""
    problem, motion = slider, quintic(0.6, joint="slide")
    bases = [[0, 0, 0], [0, ASIDE, 0], [0, 0, -2 * ASIDE], [0, 9 * ASIDE, 0]]
    result = tool_runs(problem, motion, followed(problem, motion, bases))
    for margin, less in zip(result.tube.runs, (0, ASIDE, 2 * ASIDE, 9 * ASIDE), strict=True):
        assert margin == pytest.approx(result.tube.plan - less, abs=1e-9)
    assert result.worst[0] == 3
    assert result.rotation is None


def test_the_distance_of_obstacles_is_the_judges_and_moves_with_the_base(stored, slider):
    problem, motion = stored("ur5/over_the_wall", REFINEMENT)
    band = obstacle_band(problem, motion, followed(problem, motion, [[0, 0, 0], [0, 0, 0.01]]))
    np.testing.assert_array_equal(band.runs[0], band.plan)
    judged = verify(problem, motion).conditions["obstacles"].margin
    assert band.plan.min() == pytest.approx(judged + problem.clearance, abs=1e-3)
    assert 0.003 < band.runs[1].min() - band.plan.min() < 0.011  # higher above the wall
    motion = quintic(0.6, joint="slide")  # without obstacles there is none
    assert obstacle_band(slider, motion, followed(slider, motion, np.zeros((1, 3)))) is None


def test_lines_join_to_whole_paths_and_those_outside_the_tube_are_told_apart(slider):
    """A base that stands 0.15 m ahead takes the tool 0.05 m out of the tube's round end."""
    motion = quintic(0.6, joint="slide")

    def paths(bases, steps):
        return executed_paths(tool_runs(slider, motion, followed(slider, motion, bases)), steps)

    whole = paths(np.zeros((1, 3)), 50)
    assert len(whole.outside) == 0
    assert 50 <= len(whole.inside) <= 101
    np.testing.assert_array_equal(whole.inside[1:, 0], whole.inside[:-1, 1])
    assert whole.inside[0, 0, 0] == 0
    assert whole.inside[-1, 1, 0] == pytest.approx(0.6)
    ahead = paths([[0.15, 0, 0]], 1000)
    assert ahead.inside[:, :, 0].max() == pytest.approx(0.7, abs=0.01)
    assert ahead.outside[:, :, 0].min() == pytest.approx(0.7, abs=0.01)
    assert ahead.outside[:, :, 0].max() == pytest.approx(0.75)
    aside = np.zeros((230, 3))  # of very many, those farthest out are shown
    aside[:, 1] = np.linspace(0, 0.2, 230)
    many = paths(aside, 10)
    assert (many.shown, many.total) == (200, 230)
    shown = np.unique(np.concatenate([many.inside, many.outside])[:, 0, 1])
    np.testing.assert_allclose(shown, aside[30:, 1])


def test_paths_of_cycles_leave_the_tube_of_the_move_that_runs_and_pages_show_them(tmp_path):
    motion = motion_of(picking(tmp_path))
    execution = followed_cycle(motion, 2)
    # In the middle of the second move.
    then = abs(execution.time - (DURATION + 2 * DWELL + DURATION / 2)) < 0.05
    execution.position[1, then, 1] += 0.7
    paths, tool = motion_paths(motion, execution), motion.cycle.robot.tool_position
    assert (paths.shown, paths.total) == (2, 2)
    out = tool(execution.position[1, then])
    far = np.linalg.norm(paths.outside[:, :, None] - out, axis=3).min(axis=2)
    assert len(paths.outside) > 10
    assert far.min(axis=1).max() < 1e-9  # each with an end that was put out

    with_runs = view_cycle(motion.cycle, [motion], ["plan"], execution=execution)
    alone = view_cycle(motion.cycle, [motion], ["plan"])
    (label,) = (e["label"] for e in with_runs.panel["layers"] if e["name"] == "executed")
    assert label == "Executed paths of the tool: 2 runs"
    assert "executed" not in [layer["name"] for layer in alone.panel["layers"]]
    with pytest.raises(OptionError, match="execution goes with one motion, not 2; give one"):
        view_cycle(motion.cycle, [motion, motion], execution=execution)


def figure_of(problem, motion, bases, path=None):
    execution = followed(problem, motion, bases)
    judged = judged_runs(problem, motion, execution)
    return plot_execution(problem, motion, execution, judged, path)


def drawn(axis, color):
    """Return the corners of the bands of a colour."""
    bands = [band for band in axis.collections if isinstance(band, PolyCollection)]
    bands = [band for band in bands if to_hex(band.get_facecolor()[0]) == color.lower()]
    return np.vstack([path.vertices for band in bands for path in band.get_paths()])


def line(axis, label="plan"):
    """Return times and values of the line of a label."""
    (one,) = [line for line in axis.get_lines() if line.get_label() == label]
    return one.get_xdata(), one.get_ydata()


def panels(figure):
    return {axis.get_ylabel().replace("\n", " "): axis for axis in figure.axes}


@pytest.fixture(scope="module")
def shifted(stored):
    """The plan over the wall, followed by three arms: one stands 20 mm too far ahead."""
    return figure_of(
        *stored("ur5/over_the_wall", REFINEMENT), [[0, 0, 0], [0, 0, 0.001], [0.02, 0, 0]]
    )


def test_the_margin_of_runs_is_drawn_beyond_zero_in_another_colour(shifted):
    margin = panels(shifted)["inside the tube [mm]"]
    assert -1e-3 < line(margin)[1].min() < 2
    inside, outside = drawn(margin, EXECUTED_COLOR), drawn(margin, WARNING_COLOR)
    assert inside[:, 1].min() >= 0
    assert outside[:, 1].max() <= 0
    assert -21 < outside[:, 1].min() < -5


def test_what_is_drawn_over_time_and_in_planes(shifted):
    """Planes share the longest direction, and z points up."""
    shown = panels(shifted)
    tracking = drawn(shown["tool from the plan [mm]"], EXECUTED_COLOR)
    assert tracking[:, 1].max() == pytest.approx(20)
    assert "inside the rotation tolerance [mrad]" not in shown
    assert set(line(shown["distance from obstacles [mm]"], "limit")[1]) == {10}
    assert "1 of 3 runs failed: 1 left the tube" in shifted.get_suptitle()
    side, above, _ = [axis for axis in shifted.axes if axis.get_xlabel() == "y [m]"]
    assert [axis.get_ylabel() for axis in (side, above)] == ["z [m]", "x [m]"]
    assert above.yaxis_inverted()  # from above, with y to the right, x points down
    assert not side.yaxis_inverted()


def test_rotation_is_drawn_where_it_is_bounded_and_motions_in_a_plane_from_above_alone(stored):
    shown = panels(figure_of(*stored("ur5/level_tray", REFINEMENT), np.zeros((1, 3))))
    _, left = line(shown["inside the rotation tolerance [mrad]"])
    assert 0 <= left.min() < 2
    figure = figure_of(*stored("two_link/around_a_post", REFINEMENT), np.zeros((1, 3)))
    assert "z [m]" not in panels(figure)


def test_a_cart_on_a_rail_without_anything_else_can_be_drawn(slider, tmp_path, undrawn):
    arguments = slider, quintic(0.6, joint="slide"), np.zeros((1, 3))
    figure = figure_of(*arguments, tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == undrawn
    assert "0 of 1 runs failed" in figure.get_suptitle()
    assert "distance from obstacles [mm]" not in panels(figure)
    with pytest.raises(OutputError, match=r"the folder .*nowhere does not exist"):
        figure_of(*arguments, tmp_path / "nowhere" / "a.png")


@pytest.fixture(scope="module")
def of_cycle(tmp_path_factory):
    """The figure of a cycle of which three runs differ, the execution, and the figure's file."""
    folder = tmp_path_factory.mktemp("cycle")
    motion = motion_of(picking(folder))
    execution = followed_cycle(motion, 3)
    for run in range(3):
        execution.position[run, :, 1] += 0.01 * run
    execution.is_saturated[:, execution.time > 3, 1] = True
    judged = judged_cycle(motion, execution)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figure_files, "figure_file", lambda figure, path: b"a figure")
        figure = plot_cycle_execution(motion, execution, judged, folder / "runs.png")
    return figure, execution, folder / "runs.png"


def test_every_tolerance_has_a_panel_with_margins_of_the_move_that_runs(of_cycle):
    figure, execution, path = of_cycle
    shown = panels(figure)
    assert "inside the rotation tolerance [mrad]" not in shown
    assert path.read_bytes() == b"a figure"
    names = ["inside the tube [mm]", "clearance beyond the required [mm]"]
    time, values = line(shown["tool from the plan [mm]"])
    assert np.isnan(values).sum() == 3  # no line from move to move
    assert time[-1] == pytest.approx(execution.time[-1])
    taken = DURATION + DWELL
    time, inside = line(shown[names[0]])
    at_ends = inside[np.isclose(time, taken, atol=0.004) & ~np.isnan(inside)]
    np.testing.assert_allclose(at_ends, 200.0, atol=1e-6)  # the tool at its end, and beginning
    time, beyond = line(shown[names[1]])
    carrying = (time > taken + 0.01) & (time < taken + DWELL + DURATION)
    assert not carrying.any()  # no obstacle stands there
    assert np.nanmin(beyond) > 0


def test_moves_and_what_happens_between_are_named(of_cycle):
    figure, *_ = of_cycle
    shown = panels(figure)
    first = next(iter(shown.values()))
    assert {text.get_text() for text in first.texts} == {"reach", "carry", "back"}
    steps = shown["tool from the plan [mm]"].texts
    texts = {"close (0.1 s)", "attach part", "settle (0.1 s)", "open (0.1 s)", "detach part"}
    assert {word for text in steps for word in text.get_text().split(", ")} == texts
    assert "2 of 3 runs failed: 2 had a joint too far" in figure.get_suptitle()
