"""plot_execution, plot_cycle_execution: executed paths in section, tolerance left over time."""

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from simulated_cycle import DURATION, DWELL, followed_cycle, motion_of, picking
from stored_trajectories import REFINEMENT

from cases import followed, quintic
from tubeplanner import OutputError, judged_runs, plot_execution
from tubeplanner.simulation.judged_cycle import judged_cycle
from tubeplanner.views.cycle_execution_plot import plot_cycle_execution
from tubeplanner.views.palette import EXECUTED_COLOR, WARNING_COLOR

# The figure of an execution shows the plan, all runs, and where and when they leave the tube.


WALL, TRAY = "ur5/over_the_wall", "ur5/level_tray"


def figure_of(problem, motion, bases, path=None):
    execution = followed(problem, motion, bases)
    judged = judged_runs(problem, motion, execution)
    return plot_execution(problem, motion, execution, judged, path)


def drawn(axis, color):
    """Return the corners of the bands of a colour."""
    bands = [band for band in axis.collections if isinstance(band, PolyCollection)]
    found = [band for band in bands if to_hex(band.get_facecolor()[0]) == color.lower()]
    return np.vstack([path.vertices for band in found for path in band.get_paths()])


def panels(figure):
    return {axis.get_ylabel().replace("\n", " "): axis for axis in figure.axes}


@pytest.fixture(scope="module")
def shifted(stored, tmp_path_factory):
    """The plan over the wall, followed by three arms: one stands 20 mm too far ahead."""
    path = tmp_path_factory.mktemp("figure") / "executed.png"
    bases = [[0, 0, 0], [0, 0, 0.001], [0.02, 0, 0]]
    return figure_of(*stored(WALL, REFINEMENT), bases, path), path


def test_the_margin_of_runs_is_drawn_beyond_zero_in_another_colour(shifted):
    figure, path = shifted
    assert path.read_bytes().startswith(b"\x89PNG")
    margin = panels(figure)["inside the tube [mm]"]
    plan = next(line for line in margin.lines if line.get_label() == "plan")
    assert -1e-3 < plan.get_ydata().min() < 2
    inside, outside = drawn(margin, EXECUTED_COLOR), drawn(margin, WARNING_COLOR)
    assert inside[:, 1].min() >= 0
    assert outside[:, 1].max() <= 0
    assert -21 < outside[:, 1].min() < -5
    low, high = margin.get_ylim()
    assert low < outside[:, 1].min()
    assert high < 80


def test_what_is_drawn_over_time(shifted, stored):
    figure, _ = shifted
    _, motion = stored(WALL, REFINEMENT)
    shown = panels(figure)
    tracking = drawn(shown["tool from the plan [mm]"], EXECUTED_COLOR)
    assert tracking[:, 1].max() == pytest.approx(20)
    assert "inside the rotation tolerance [mrad]" not in shown
    distance = shown["distance from obstacles [mm]"]
    limit = next(line for line in distance.lines if line.get_label() == "limit")
    assert set(limit.get_ydata()) == {10}
    end = shown["inside the tube [mm]"].get_xlim()[1]
    assert motion.duration + 0.19 < end < motion.duration + 0.21
    assert "1 of 3 runs failed: 1 left the tube" in figure.get_suptitle()


def test_planes_share_the_longest_direction_and_z_points_up(shifted):
    figure, _ = shifted
    planes = [axis for axis in figure.axes if axis.get_xlabel() == "y [m]"]
    side, above, close = planes
    assert [axis.get_ylabel() for axis in (side, above)] == ["z [m]", "x [m]"]
    assert above.yaxis_inverted()  # from above, with y to the right, x points down
    assert not side.yaxis_inverted()
    assert np.ptp(close.get_xlim()) < 0.3 * np.ptp(side.get_xlim())
    label = next(text for text in close.get_legend_handles_labels()[1] if "outside" in text[4:])
    assert "outside" in label


def test_rotation_is_drawn_where_it_is_bounded(stored):
    shown = panels(figure_of(*stored(TRAY, REFINEMENT), np.zeros((2, 3))))
    turned = shown["inside the rotation tolerance [mrad]"]
    plan = next(line for line in turned.lines if line.get_label() == "plan")
    assert 0 <= plan.get_ydata().min() < 2


def test_an_arm_that_moves_in_a_plane_is_seen_from_above_alone(stored):
    problem, motion = stored("two_link/around_a_post", REFINEMENT)
    figure = figure_of(problem, motion, np.zeros((1, 3)))
    names = [axis.get_xlabel() + axis.get_ylabel() for axis in figure.axes]
    assert len([name for name in names if name in ("x [m]y [m]", "y [m]x [m]")]) == 2
    assert not any("z [m]" in name for name in names)


def test_a_cart_on_a_rail_without_anything_else_can_be_drawn(slider):
    figure = figure_of(slider, quintic(0.6, joint="slide"), np.zeros((1, 3)))
    assert "0 of 1 runs failed" in figure.get_suptitle()
    assert "distance from obstacles [mm]" not in panels(figure)


def test_a_figure_that_cannot_be_written_is_an_error_of_ours(slider, tmp_path):
    with pytest.raises(OutputError, match=r"the folder .*nowhere does not exist"):
        figure_of(
            slider, quintic(0.6, joint="slide"), np.zeros((1, 3)), tmp_path / "nowhere" / "a.png"
        )


TAKEN = DURATION + DWELL


@pytest.fixture
def cycle_plot_drawn(tmp_path):
    motion = motion_of(picking(tmp_path))
    execution = followed_cycle(motion, 3)
    for run in range(3):
        execution.position[run, :, 1] += 0.01 * run
    execution.is_saturated[:, execution.time > 3, 1] = True
    path = tmp_path / "runs.png"
    return (
        motion,
        execution,
        plot_cycle_execution(motion, execution, judged_cycle(motion, execution), path),
        path,
    )


def plan(axis):
    (line,) = [line for line in axis.get_lines() if line.get_label() == "plan"]
    return line.get_xdata(), line.get_ydata()


def test_every_tolerance_has_a_panel_over_the_whole_cycle(cycle_plot_drawn):
    _, execution, figure, path = cycle_plot_drawn
    found = panels(figure)
    assert "inside the rotation tolerance [mrad]" not in found
    assert path.read_bytes().startswith(b"\x89PNG")
    names = ["inside the tube [mm]", "farther from obstacles than asked [mm]"]
    for name in (*names, "tool from the plan [mm]"):
        time, _ = plan(found[name])
        assert (np.diff(time) >= 0).all()
        assert found[name].get_xlim() == (0.0, pytest.approx(execution.time[-1]))
    time, values = plan(found["tool from the plan [mm]"])
    assert np.isnan(values).sum() == 3  # no line from move to move
    assert time[-1] == pytest.approx(execution.time[-1])


def test_margins_are_those_of_the_move_that_runs(cycle_plot_drawn):
    _, _, figure, _ = cycle_plot_drawn
    time, inside = plan(panels(figure)["inside the tube [mm]"])
    at_ends = inside[np.isclose(time, TAKEN, atol=0.004) & ~np.isnan(inside)]
    np.testing.assert_allclose(at_ends, 200.0, atol=1e-6)  # the tool at its end, and beginning
    time, beyond = plan(panels(figure)["farther from obstacles than asked [mm]"])
    carrying = (time > TAKEN + 0.01) & (time < TAKEN + DWELL + DURATION)
    assert not carrying.any()  # no obstacle stands there
    assert np.nanmin(beyond) > 0


def test_moves_and_what_happens_between_are_named(cycle_plot_drawn):
    _, _, figure, _ = cycle_plot_drawn
    found = panels(figure)
    first = next(iter(found.values()))
    assert {text.get_text() for text in first.texts} == {"reach", "carry", "back"}
    steps = found["tool from the plan [mm]"].texts
    said = ["close (0.1 s)", "attach part", "settle (0.1 s)", "open (0.1 s)", "detach part"]
    assert {word for text in steps for word in text.get_text().split(", ")} == set(said)
    drawn_at = [text.xy[0] for text in steps]
    assert len(drawn_at) > 1
    assert min(np.diff(drawn_at)) > 0  # none over another
    others = [axis for axis in found.values() if axis.texts]
    assert len(others) == 2
    title = figure.get_suptitle()
    assert title.startswith("cycle: 3.3000 s, executed\n0 of 3 runs failed")
