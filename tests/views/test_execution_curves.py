"""Curves of executed runs: tool paths inside and outside the tube, quantities over time."""

import numpy as np
import pytest
from cases import followed, quintic
from simulated_cycle import DURATION, DWELL, followed_cycle, motion_of, picking
from stored_trajectories import REFINEMENT

from tubeplanner import OptionError, verify
from tubeplanner.views.cycle_executed_paths import cycle_executed_paths
from tubeplanner.views.cycle_view import view_cycle
from tubeplanner.views.executed_paths import executed_paths
from tubeplanner.views.execution_curves import obstacle_band, tool_runs
from tubeplanner.views.scene import Layer

ASIDE = 0.012  # [m]


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


def test_the_distance_of_obstacles_is_the_judges_and_moves_with_the_base(stored, slider):
    problem, motion = stored("ur5/over_the_wall", REFINEMENT)
    band = obstacle_band(problem, motion, followed(problem, motion, [[0, 0, 0], [0, 0, 0.01]]))
    np.testing.assert_array_equal(band.runs[0], band.plan)
    judged = verify(problem, motion).conditions["obstacles"].margin
    assert band.plan.min() == pytest.approx(judged + problem.clearance, abs=1e-3)
    assert len(band.time) <= 200
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
    paths, tool = cycle_executed_paths(motion, execution), motion.cycle.robot.tool_position
    assert (paths.shown, paths.total) == (2, 2)
    out = tool(execution.position[1, then])
    far = np.linalg.norm(paths.outside[:, :, None] - out, axis=3).min(axis=2)
    assert len(paths.outside) > 10
    assert far.min(axis=1).max() < 1e-9  # each with an end that was put out
    ends = paths.inside[[0, -1], [0, 1]]
    np.testing.assert_allclose(ends, tool(execution.position[[0, 0], [0, -1]]))

    with_runs = view_cycle(motion.cycle, [motion], ["plan"], execution=execution)
    alone = view_cycle(motion.cycle, [motion], ["plan"])
    (label,) = (e["label"] for e in with_runs.panel["layers"] if e["name"] == "executed")
    assert label == "Executed paths of the tool: 2 runs"
    assert "executed" not in [layer["name"] for layer in alone.panel["layers"]]
    points = [
        next(i for i in page.scene.items if (i.layer, i.name) == (Layer.TOOL, "point"))
        for page in (with_runs, alone)
    ]  # the plan's is thinner
    widths = [np.ptp(point.surface.vertices, axis=0).max() for point in points]
    assert widths[0] == pytest.approx(0.3 * widths[1])
    with pytest.raises(OptionError, match="execution goes with one motion, not 2; give one"):
        view_cycle(motion.cycle, [motion, motion], execution=execution)
