import numpy as np
import pytest

from simulated_cycle import DURATION, DWELL, followed_cycle, motion_of, picking
from tubeplanner.simulation.judged_cycle import judged_cycle
from tubeplanner.views.cycle_execution_plot import plot_cycle_execution

TAKEN = DURATION + DWELL


@pytest.fixture
def drawn(tmp_path):
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


def panels(figure):
    return {axis.get_ylabel().replace("\n", " "): axis for axis in figure.axes}


def plan(axis):
    (line,) = [line for line in axis.get_lines() if line.get_label() == "plan"]
    return line.get_xdata(), line.get_ydata()


def test_every_tolerance_has_a_panel_over_the_whole_cycle(drawn):
    _, execution, figure, path = drawn
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


def test_margins_are_those_of_the_move_that_runs(drawn):
    _, _, figure, _ = drawn
    time, inside = plan(panels(figure)["inside the tube [mm]"])
    at_ends = inside[np.isclose(time, TAKEN, atol=0.004) & ~np.isnan(inside)]
    np.testing.assert_allclose(at_ends, 200.0, atol=1e-6)  # the tool at its end, and beginning
    time, beyond = plan(panels(figure)["farther from obstacles than asked [mm]"])
    carrying = (time > TAKEN + 0.01) & (time < TAKEN + DWELL + DURATION)
    assert not carrying.any()  # no obstacle stands there
    assert np.nanmin(beyond) > 0


def test_moves_and_what_happens_between_are_named(drawn):
    _, _, figure, _ = drawn
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
