"""What is required along a spline: at hand-overs of both segments, near the ends less."""

import numpy as np
import pytest

from tubeplanner import Contact, Obstacle, PlanningProblem, Tube, placement_of
from tubeplanner.problem.required_distances import RequiredDistances
from tubeplanner.refinement.distances_along import DistancesAlong
from tubeplanner.refinement.phased_spline import Samples
from tubeplanner.refinement.spline_start import knot_grid

START, GOAL = np.array([0.2, 0.3]), np.array([0.9, 0.5])
NAMES = ("ball", "link2")


@pytest.fixture
def problem(two_link):
    def make(clearances=None, **others):
        tool = two_link.tool_position(np.array([START, (START + GOAL) / 2, GOAL]))
        ball = Obstacle.sphere("ball", 0.05, placement_of([0.0, 2.2, 0.0]))
        tube = Tube(tool, 0.3, clearance=clearances)
        return PlanningProblem(two_link, tube, START, GOAL, obstacles=[ball], **others)

    return make


def along(problem):
    return DistancesAlong(problem, np.array([START, GOAL]), 0.0)


GRID = knot_grid(np.array([0.0, 0.5, 1.0]), 8)
PIECES = GRID.interval_count


def test_at_a_hand_over_both_segments_ask(problem):
    made = problem([0.01, 0.02])
    samples = Samples(
        np.array([0, 0, 0, 1, 1, 1]),
        np.array([0.0, 0.5, 1.0, 0.0, 0.5, 1.0]),
        np.array([0, 1, PIECES // 2 - 1, PIECES // 2, PIECES - 2, PIECES - 1]),
    )
    column = np.flatnonzero(made.collision.between(*NAMES))[0]
    found = along(made).at(GRID, samples, np.tile(START, (6, 1)))[:, column]
    np.testing.assert_allclose(found, [0.01, 0.01, 0.02, 0.02, 0.02, 0.02])


def test_more_is_required_than_the_judge_asks_and_all_of_it_before_the_distance_ends(problem):
    made = problem(clearance=3.0, contacts=[Contact(NAMES, 0.2, "start")])
    column = np.flatnonzero(made.collision.between(*NAMES))[0]
    q = START + np.linspace(0, 1, 60)[:, None] * [0.2, 0.0]
    samples = Samples(np.zeros(60, int), np.full(60, 0.5), np.ones(60, int))
    tool = made.robot.tool_position(q)
    asked = RequiredDistances(made, START, GOAL).at(np.zeros(60, int), tool)[:, column]
    found = along(made).at(GRID, samples, q)[:, column]
    away = np.linalg.norm(tool - tool[0], axis=1)
    assert (asked[away < 0.2] < 3.0).all()
    assert (asked[away > 0.2] == 3.0).all()
    assert (found >= asked - 1e-12).all()
    assert found[0] == pytest.approx(asked[0])
    assert (np.diff(found) >= 0).all()
    assert (found[away > 0.19] == 3.0).all()
    assert found[away < 0.1].max() < (asked[0] + 3.0) / 2


def test_where_the_same_is_asked_throughout_nothing_changes_with_the_joints(problem):
    samples = Samples(np.zeros(3, int), np.full(3, 0.5), np.ones(3, int))
    made = problem(clearance=0.01)
    required, change = along(made).of_pairs(GRID, samples, np.tile(START, (3, 1)), np.arange(3))
    np.testing.assert_array_equal(change, 0.0)
    np.testing.assert_array_equal(required, RequiredDistances(made, START, GOAL).by_segment[0, :3])


@pytest.mark.parametrize("ends", [("start",), ("goal",), ("start", "goal")])
def test_what_changes_with_the_joints_is_what_is_required(ends, two_link):
    """Of both ends of one segment the one counts that requires less."""
    tool = two_link.tool_position(np.array([START, GOAL]))
    ball = Obstacle.sphere("ball", 0.05, placement_of([0.0, 2.2, 0.0]))
    made = PlanningProblem(
        two_link,
        Tube(tool, 0.3),
        START,
        GOAL,
        obstacles=[ball],
        clearance=3.0,
        contacts=[Contact(NAMES, 0.9, ends)],
    )
    grid, column = knot_grid(np.array([0.0, 1.0]), 8), made.collision.between(*NAMES).argmax()
    q = START + np.linspace(0.02, 0.98, 25)[:, None] * (GOAL - START)
    samples = Samples(np.zeros(25, int), np.full(25, 0.5), np.ones(25, int))

    def required(x):
        return along(made).of_pairs(grid, samples, x, np.full(25, column))

    found, change = required(q)
    np.testing.assert_allclose(found, along(made).at(grid, samples, q)[:, column])
    for joint in range(2):
        step = 1e-6 * np.eye(2)[joint]
        slope = (required(q + step)[0] - required(q - step)[0]) / 2e-6
        np.testing.assert_allclose(change[:, joint], slope, atol=1e-5)
