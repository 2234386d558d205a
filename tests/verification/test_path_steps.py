"""Steps in which nothing jumps."""

import numpy as np
import pytest

from cases import rest_to_rest
from tubeplanner import JointTrajectory
from tubeplanner.trajectory.joint_trajectory import concatenate
from tubeplanner.verification.path_steps import path_steps


def test_steps_follow_each_other_from_start_to_end(stored):
    _, trajectory = stored("ur5/over_the_wall")
    steps = path_steps(trajectory, 500, 3)
    assert len(steps.piece) >= 500
    assert np.bincount(steps.piece).min() >= 3
    assert steps.width.min() > 0
    ends = steps.start + steps.width
    np.testing.assert_allclose(ends[:-1], steps.start[1:], atol=1e-12)
    assert (steps.start[0], ends[-1]) == (0.0, pytest.approx(trajectory.duration))


def test_every_piece_has_its_steps_though_there_are_many(stored):
    _, trajectory = stored("ur5/over_the_wall")
    pieces = len(trajectory.widths)
    steps = path_steps(trajectory, 1, 7)
    assert pieces * 7 <= len(steps.piece) < pieces * 7 + 100


def test_joints_turn_round_between_steps():
    """Once in the middle of a piece, at a third of it, where no regular step ends."""
    turn = JointTrajectory(["turn"], [0, 1.0], np.array([[[1.5]], [[-1.0]], [[0.0]]]))
    steps = path_steps(turn, 10, 1)
    np.testing.assert_allclose(steps.start[4], 1 / 3, atol=1e-12)
    np.testing.assert_array_equal(steps.direction[:, 0], [-1] * 4 + [1] * 7)


def test_ends_have_what_is_inside_of_the_step():
    """Where the acceleration jumps, each side has its own."""
    move = JointTrajectory(
        ["slide"], [0, 1.0, 2.0], np.array([[[1.0], [-1]], [[0], [2]], [[0], [1]]])
    )
    acceleration = path_steps(move, 4, 1).at_ends(2).reshape(2, -1)
    np.testing.assert_array_equal(acceleration, [[2, 2, -2, -2]] * 2)
    position = path_steps(move, 4, 1).at_ends(0).reshape(2, -1)
    np.testing.assert_allclose(position, [[0, 0.25, 1, 1.75], [0.25, 1, 1.75, 2]])


def test_a_part_is_those_steps():
    steps = path_steps(
        concatenate([rest_to_rest(["a"], 0, 1, 1), rest_to_rest(["a"], 1, 0, 1)]), 8, 1
    )
    part = steps.part(2, 5)
    np.testing.assert_array_equal(part.start, steps.start[2:5])
    np.testing.assert_array_equal(part.at_ends(1)[:3], steps.at_ends(1)[2:5])
    np.testing.assert_array_equal(part.direction, steps.direction[2:5])
