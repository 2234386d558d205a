import numpy as np
import pytest

from cases import anywhere, one_joint
from stored_trajectories import REFINEMENT, stored_trajectory
from tubeplanner import load_problem
from tubeplanner.simulation.executed_clearance import least_clearances, obstacle_distances

NO_SHIFT = np.zeros(3)


@pytest.fixture(scope="module")
def wall():
    problem = load_problem("example:ur5/over_the_wall")
    motion = stored_trajectory("ur5/over_the_wall", REFINEMENT).trajectory
    time = np.linspace(0, motion.duration, 60)
    return problem, time, motion.reordered(problem.robot.joint_names).position(time)


def measured(problem, q, pairs, shift):
    """The least distance of all pairs at all samples, each measured."""
    found = []
    for rotation, position in zip(*problem.robot.body_poses(q), strict=True):
        moved = position.copy()
        moved[1:] += shift
        found.append(problem.collision.distances(rotation, moved, pairs))
    return np.array(found)


@pytest.mark.parametrize("shift", [NO_SHIFT, np.array([0.02, -0.01, -0.02])])
def test_they_are_the_least_of_all_distances(wall, shift):
    problem, time, q = wall
    obstacles, links = least_clearances(problem, time, q, shift)
    pairs = problem.collision.obstacle_pairs
    expected = measured(problem, q, pairs, shift)
    sample, pair = np.unravel_index(expected.argmin(), expected.shape)
    assert obstacles.value == pytest.approx(expected.min(), abs=1e-9)
    assert obstacles.place.time == time[sample]
    assert (obstacles.place.links, obstacles.place.obstacle) == problem.collision.owners(
        pairs[pair]
    )
    alone = measured(problem, q, problem.collision.link_pairs, NO_SHIFT)
    assert links.value == pytest.approx(alone.min(), abs=1e-9)
    assert links.place.obstacle is None


def test_an_arm_without_shapes_has_none(tmp_path):
    problem = anywhere(one_joint(tmp_path))
    assert least_clearances(problem, np.zeros(1), np.zeros((1, 1)), NO_SHIFT) == (None, None)


@pytest.mark.parametrize("shift", [NO_SHIFT, np.array([0.02, -0.01, -0.02])])
def test_over_time_they_are_the_least_of_all_pairs(wall, shift):
    problem, _, q = wall
    expected = measured(problem, q, problem.collision.obstacle_pairs, shift).min(axis=1)
    assert obstacle_distances(problem, q, shift) == pytest.approx(expected, abs=1e-9)
