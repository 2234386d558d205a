import numpy as np
import pytest

from cases import followed, quintic
from stored_trajectories import REFINEMENT
from tubeplanner import verify
from tubeplanner.views.execution_curves import obstacle_band, tool_runs

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
