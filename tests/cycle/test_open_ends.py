"""An open end is turned as the next move begins."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import GoalRegion, Move, Tube, load_robot
from tubeplanner.cycle.open_ends import ending_for

POINTS = [[0.4, 0.0, 0.5], [0.5, 0.2, 0.4]]
DOWN, ASIDE = [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]
TILTED = [np.cos(0.3), np.sin(0.3), 0.0, 0.0]
FREE, UPRIGHT = [np.inf] * 3, [0.1, 0.1, np.inf]


@pytest.fixture(scope="module")
def robot():
    return load_robot("example:ur5", "tool0")


def move(robot, name, orientation=None, tolerance=None, goal=None) -> Move:
    given = {}
    if orientation is not None:
        given = {"orientations": [orientation] * 2, "rotation_tolerance": [tolerance]}
    return Move(name, robot, Tube(POINTS, 0.05, **given), goal)


def test_a_tool_that_is_free_on_the_way_ends_turned_as_the_next_move_asks(robot):
    joined = ending_for(move(robot, "first"), move(robot, "second", DOWN, UPRIGHT))
    assert joined.goal.rotation_tolerance == tuple(UPRIGHT)
    assert np.array_equal(joined.goal.position, POINTS[1])
    assert np.array_equal(joined.tube.orientations, [DOWN] * 2)
    assert joined.tube.rotation is None  # free on the way


def test_a_ball_keeps_its_tolerances(robot):
    ball = GoalRegion(np.array(POINTS[1]), 0.02)
    first = move(robot, "first", DOWN, 0.5, ball)
    goal = ending_for(first, move(robot, "second", DOWN, 0.1)).goal
    assert (goal.tolerance, goal.rotation_tolerance) == (0.02, 0.1)
    own = replace(ball, rotation_tolerance=0.03)
    first = replace(first, goal=own)
    assert ending_for(first, move(robot, "second", DOWN, 0.1)).goal is own


@pytest.mark.parametrize(
    "second",
    [{}, {"orientation": DOWN, "tolerance": FREE}],
)
def test_a_next_move_that_leaves_the_tool_free_asks_nothing(robot, second):
    first = move(robot, "first")
    assert ending_for(first, move(robot, "second", **second)) is first


def test_a_given_goal_and_another_orientation_stay_as_they_are(robot):
    second = move(robot, "second", DOWN, UPRIGHT)
    given = move(robot, "first", goal=np.zeros(6))
    assert ending_for(given, second) is given
    aside = move(robot, "first", ASIDE, UPRIGHT)
    assert ending_for(aside, second) is aside
    opposite = move(robot, "first", [-x for x in DOWN], UPRIGHT)  # the same rotation
    assert ending_for(opposite, second).goal.rotation_tolerance == tuple(UPRIGHT)


def test_what_counts_is_where_the_moves_meet(robot):
    """The first ends as it does last, the second begins as it does first."""
    turning = Tube(
        [*POINTS, [0.5, 0.3, 0.4]],
        0.05,
        orientations=[DOWN, DOWN, TILTED],
        rotation_tolerance=[0.1, 0.3],
    )
    second = Move("second", robot, turning)
    joined = ending_for(move(robot, "first"), second)
    assert np.array_equal(joined.tube.orientations, [DOWN] * 2)
    assert joined.goal.rotation_tolerance == 0.1
    ends_tilted = Move("first", robot, turning)
    assert ending_for(ends_tilted, second) is ends_tilted
