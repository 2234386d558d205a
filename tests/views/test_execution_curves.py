"""Curves of executed runs: tool paths inside and outside the tube, quantities over time."""

import numpy as np
import pytest
from simulated_cycle import DURATION, DWELL, followed_cycle, motion_of, picking
from stored_trajectories import REFINEMENT

from cases import followed, quintic
from tubeplanner import OptionError, verify
from tubeplanner.views.cycle_executed_paths import cycle_executed_paths
from tubeplanner.views.cycle_view import view_cycle
from tubeplanner.views.executed_paths import executed_paths
from tubeplanner.views.execution_curves import obstacle_band, tool_runs
from tubeplanner.views.scene import Layer

ASIDE = 0.012  # [m]
WALL = "ur5/over_the_wall"


def test_a_plan_that_is_followed_has_the_margins_of_the_plan(stored):
    problem, motion = stored("ur5/level_tray", REFINEMENT)
    found = tool_runs(problem, motion, followed(problem, motion, np.zeros((2, 3)), 0.0005))
    for band, condition in ((found.tube, "tube"), (found.rotation, "rotation")):
        np.testing.assert_array_equal(band.runs, [band.plan, band.plan])
        judged = verify(problem, motion).conditions[condition]
        assert band.plan.min() == pytest.approx(judged.margin, abs=1e-3)
    np.testing.assert_array_equal(found.runs[0], found.plan)
    at_goal = found.tube.time >= motion.duration
    assert np.ptp(found.tube.plan[at_goal]) == 0


def test_a_base_that_stands_aside_takes_as_much_from_the_margin(slider):
    """The cart runs along the axis of a straight tube."""
    problem, motion = slider, quintic(0.6, joint="slide")
    bases = [[0, 0, 0], [0, ASIDE, 0], [0, 0, -2 * ASIDE], [0, 9 * ASIDE, 0]]
    found = tool_runs(problem, motion, followed(problem, motion, bases))
    for margin, less in zip(found.tube.runs, (0, ASIDE, 2 * ASIDE, 9 * ASIDE), strict=True):
        assert margin == pytest.approx(found.tube.plan - less, abs=1e-9)
    assert found.worst[0] == 3
    assert found.rotation is None


def test_the_distance_of_obstacles_is_the_judges_and_moves_with_the_base(stored):
    problem, motion = stored(WALL, REFINEMENT)
    found = obstacle_band(problem, motion, followed(problem, motion, [[0, 0, 0], [0, 0, 0.01]]))
    np.testing.assert_array_equal(found.runs[0], found.plan)
    judged = verify(problem, motion).conditions["obstacles"].margin
    assert found.plan.min() == pytest.approx(judged + problem.clearance, abs=1e-3)
    assert len(found.time) <= 200
    assert 0.003 < found.runs[1].min() - found.plan.min() < 0.011  # higher above the wall


def test_without_obstacles_there_is_no_distance(slider):
    motion = quintic(0.6, joint="slide")
    assert obstacle_band(slider, motion, followed(slider, motion, np.zeros((1, 3)))) is None


def paths_of(problem, bases, steps):
    motion = quintic(0.6, joint="slide")
    return executed_paths(tool_runs(problem, motion, followed(problem, motion, bases)), steps)


def test_lines_join_to_whole_paths(slider):
    found = paths_of(slider, np.zeros((1, 3)), 50)
    assert len(found.outside) == 0
    assert 50 <= len(found.inside) <= 101
    np.testing.assert_array_equal(found.inside[1:, 0], found.inside[:-1, 1])
    assert found.inside[0, 0, 0] == 0
    assert found.inside[-1, 1, 0] == pytest.approx(0.6)


def test_lines_outside_the_tube_are_told_apart(slider):
    """A base that stands 0.15 m ahead takes the tool 0.05 m out of the tube's round end."""
    found = paths_of(slider, [[0.15, 0, 0]], 1000)
    assert found.inside[:, :, 0].max() == pytest.approx(0.7, abs=0.01)
    assert found.outside[:, :, 0].min() == pytest.approx(0.7, abs=0.01)
    assert found.outside[:, :, 0].max() == pytest.approx(0.75)


def test_of_very_many_runs_those_farthest_out_are_shown(slider):
    aside = np.zeros((230, 3))
    aside[:, 1] = np.linspace(0, 0.2, 230)
    found = paths_of(slider, aside, 10)
    assert (found.shown, found.total) == (200, 230)
    shown = np.unique(np.concatenate([found.inside, found.outside])[:, 0, 1])
    np.testing.assert_allclose(shown, aside[30:, 1])


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
