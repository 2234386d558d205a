"""Corners of a box that lies on another: how far each is, and between which points."""

from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import AttachedSolid, Obstacle, placement_of
from tubeplanner.collision.collision_checker import CollisionChecker
from tubeplanner.collision.convex_shape import box
from tubeplanner.refinement.corner_distances import CORNERS, of_corners

TOP = 0.02


@pytest.fixture
def part(ur5):
    """A part that the tool carries, 1 mm above a table, tilted by so much: checker, q, poses."""

    def make(tilt, size=(0.06, 0.06, 0.1)):
        q = np.array([[-0.79, -1.31, 1.9, -2.159, -1.5708 + tilt, 0.0]])
        rotation, tool = ur5.tool_pose(q)
        placement = np.eye(4)
        placement[:3, 3] = [0, 0, size[2] / 2]
        solid = AttachedSolid("part", (box(size).transformed(placement),), ("wrist_3_link",))
        lowest = (solid.shapes[0].vertices @ rotation[0].T + tool[0])[:, 2].min()
        height = lowest - 0.001 - TOP
        table = Obstacle.box("table", [2, 2, 2 * TOP], placement_of([0.5, 0, height]))
        checker = CollisionChecker(ur5, [table], attached=[solid], self_collision=False)
        pair = checker.pairs[checker.between("part", "table")]
        return checker, np.repeat(q, CORNERS + 1, axis=0), np.repeat(pair, CORNERS + 1, axis=0)

    return make


NUMBERS = np.array([-1, 0, 1, 2, 3])


def found(checker, q, pairs):
    poses = checker.robot.body_poses(q)
    closest = checker.closest_points(*poses, pairs)
    return closest, of_corners(checker, poses, pairs, closest, NUMBERS)


def test_all_corners_of_a_face_are_found(part):
    checker, q, pairs = part(0.01)
    closest, corners = found(checker, q, pairs)
    lengths = 0.06 * 0.01
    assert corners.distance[0] == closest.distance[0] == pytest.approx(0.001, abs=1e-9)
    np.testing.assert_allclose(
        np.sort(corners.distance[1:]), 0.001 + np.array([0, 0, lengths, lengths]), atol=2e-4
    )
    upper, lower = corners.first[1:, 2], corners.second[1:, 2]
    np.testing.assert_allclose(abs(upper - lower), corners.distance[1:], atol=1e-9)
    assert len(np.unique(corners.first[1:, :2].round(6), axis=0)) == CORNERS


def test_their_gradients_are_those_of_the_corners(part):
    checker, q, pairs = part(0.01)
    poses = checker.robot.body_poses(q)
    _, corners = found(checker, q, pairs)
    exact = checker.distance_gradient(*poses, pairs, corners)[1:]
    for joint in range(q.shape[1]):
        step = 1e-6 * np.eye(q.shape[1])[joint]
        after, before = (found(checker, q + sign * step, pairs)[1].distance for sign in (1, -1))
        np.testing.assert_allclose(exact[:, joint], (after - before)[1:] / 2e-6, atol=1e-4)


def test_corners_far_from_the_face_do_not_count(part):
    checker, q, pairs = part(0.3)
    closest, corners = found(checker, q, pairs)
    assert np.sort(corners.distance)[-1] < closest.distance[0] + 0.005
    assert (corners.distance < 0.002).all()  # the others are 18 mm farther


def test_a_pair_may_have_none(part):
    checker, q, pairs = part(0.01)
    poses = checker.robot.body_poses(q)
    closest = checker.closest_points(*poses, pairs)
    same = of_corners(checker, poses, pairs, closest, np.full(CORNERS + 1, -1))
    np.testing.assert_array_equal(same.distance, closest.distance)
    assert replace(same, distance=closest.distance).direction is closest.direction
