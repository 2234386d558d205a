import numpy as np
import pytest

from simulated_cycle import DURATION, DWELL, followed_cycle, motion_of, picking
from tubeplanner import OptionError
from tubeplanner.views.cycle_executed_paths import cycle_executed_paths
from tubeplanner.views.cycle_view import view_cycle
from tubeplanner.views.scene import Layer

CARRIED = DURATION + 2 * DWELL + DURATION / 2  # [s], in the middle of the second move


@pytest.fixture
def case(tmp_path):
    motion = motion_of(picking(tmp_path))
    execution = followed_cycle(motion, 2)
    then = abs(execution.time - CARRIED) < 0.05
    execution.position[1, then, 1] += 0.7
    return motion, execution


def test_paths_are_outside_where_they_leave_the_tube_of_the_move_that_runs(case):
    motion, execution = case
    paths = cycle_executed_paths(motion, execution)
    assert (paths.shown, paths.total) == (2, 2)
    out = motion.cycle.robot.tool_position(
        execution.position[1, abs(execution.time - CARRIED) < 0.05]
    )
    far = np.linalg.norm(paths.outside[:, :, None] - out, axis=3).min(axis=2)
    assert len(paths.outside) > 10
    assert far.min(axis=1).max() < 1e-9  # each with an end that was put out
    ends = paths.inside[[0, -1], [0, 1]]
    np.testing.assert_allclose(
        ends, motion.cycle.robot.tool_position(execution.position[[0, 0], [0, -1]])
    )


def test_pages_show_them_beside_a_thinner_path_of_the_plan(case):
    motion, execution = case
    with_runs = view_cycle(motion.cycle, [motion], ["plan"], execution=execution)
    alone = view_cycle(motion.cycle, [motion], ["plan"])
    assert "Executed paths of the tool: 2 runs" in with_runs.html
    assert "Executed paths" not in alone.html
    assert Layer.EXECUTED in with_runs.scene.layers
    widths = [np.ptp(_point(view), axis=0).max() for view in (with_runs, alone)]
    assert widths[0] == pytest.approx(0.3 * widths[1])


def test_an_execution_goes_with_one_motion(case):
    motion, execution = case
    with pytest.raises(OptionError, match="execution goes with one motion, not 2; give one"):
        view_cycle(motion.cycle, [motion, motion], execution=execution)


def _point(view):
    (item,) = [
        each for each in view.scene.items if (each.layer, each.name) == (Layer.TOOL, "point")
    ]
    return item.surface.vertices
