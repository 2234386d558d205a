"""Closest pairs against all pairs measured, and where the points are known."""

import numpy as np
import pytest

from cases import anywhere, changed, rest_to_rest
from lifting_arm import CASES, HALF, POST, lifting
from tubeplanner import Obstacle, load_robot, placement_of
from tubeplanner.constraints.closest_pairs import closest_pairs

BALL = """<robot name="ball"><link name="base"/><link name="arm">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0.5 0 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="5" velocity="4"/></joint></robot>"""


@pytest.mark.parametrize("clearance", [0.0, 0.02])
@pytest.mark.parametrize(
    "name", ["ur5/level_tray", "panda/between_shelves", "two_link/around_a_post"]
)
def test_they_are_the_closest_of_all(name, clearance, stored):
    problem, trajectory = stored(name, "refinement")
    problem = changed(problem, clearance=clearance)
    time = np.linspace(0, trajectory.duration, 25)
    checker, poses = problem.collision, problem.robot.body_poses(trajectory.position(time))
    every = np.array([checker.distances(*each, checker.pairs) for each in zip(*poses, strict=True)])
    obstacles, links = closest_pairs(problem, trajectory, time)
    count = len(checker.obstacle_pairs)
    assert (obstacles.kind, links.kind) == ("obstacles", "self_collision")
    for found, own, asked in (
        (obstacles, every[:, :count], clearance),
        (links, every[:, count:], 0),
    ):
        np.testing.assert_allclose(found.distance, own.min(axis=1), atol=1e-9)
        np.testing.assert_allclose(found.margin, own.min(axis=1) - asked, atol=1e-9)
        apart = np.linalg.norm(found.points[:, 1] - found.points[:, 0], axis=1)
        np.testing.assert_allclose(apart, found.distance, atol=1e-4)
    first = checker.pairs[:count][every[:, :count].argmin(axis=1)]
    assert obstacles.names == tuple(
        (checker.shapes[i].owner, checker.shapes[j].owner) for i, j in first
    )


def test_wherever_the_arm_is_they_are_the_closest(bundled):
    problem, random = bundled("panda/between_shelves"), np.random.default_rng(3)
    lower, upper = problem.robot.limits.lower_position, problem.robot.limits.upper_position
    ends = random.uniform(lower, upper, (2, len(lower)))
    motion = rest_to_rest(problem.robot.joint_names, *ends, 1.0)
    time = np.linspace(0, 1, 80)
    checker, poses = problem.collision, problem.robot.body_poses(motion.position(time))
    for found, pairs in zip(
        closest_pairs(problem, motion, time),
        (checker.obstacle_pairs, checker.link_pairs),
        strict=True,
    ):
        every = [checker.distances(*each, pairs).min() for each in zip(*poses, strict=True)]
        expected = np.array(every) - found.distance + found.margin
        np.testing.assert_allclose(found.margin, expected, atol=1e-9)


@pytest.fixture
def ball(tmp_path):
    """A ball on an arm that turns from the x-axis to the y-axis, between two others."""
    (tmp_path / "ball.urdf").write_text(BALL)
    robot = load_robot("ball.urdf", "arm", directory=tmp_path)
    near = Obstacle.sphere("near", 0.05, placement_of([0.9, 0, 0]))
    far = Obstacle.sphere("far", 0.05, placement_of([0, 1.0, 0]))
    return changed(anywhere(robot), obstacles=[near, far])


def test_points_are_on_the_surfaces(ball):
    motion = rest_to_rest(["turn"], 0.0, np.pi / 2, 1.0)
    (found,) = closest_pairs(ball, motion, np.array([0.0, 1.0]))
    assert found.names == (("arm", "near"), ("arm", "far"))
    np.testing.assert_allclose(found.distance, [0.25, 0.35], atol=1e-9)
    np.testing.assert_allclose(found.points[0], [[0.6, 0, 0], [0.85, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(found.points[1], [[0, 0.6, 0], [0, 0.95, 0]], atol=1e-6)


def test_what_must_be_farther_apart_is_closer(ball):
    problem = changed(ball, pair_clearances={("arm", "far"): 0.5})
    motion = rest_to_rest(["turn"], 0.0, np.pi / 4, 1.0)
    (found,) = closest_pairs(problem, motion, np.array([1.0]))
    assert found.names == (("arm", "far"),)
    place = 0.5 * np.sqrt(0.5)
    distance = np.hypot(place, 1.0 - place) - 0.15
    assert found.distance == pytest.approx([distance])
    assert found.margin == pytest.approx([distance - 0.5])


def test_what_may_touch_is_left_out_while_it_may(tmp_path):
    """Lifted off the table by 20 cm, with 1 cm of clearance."""
    problem, motion = lifting(tmp_path, CASES["a lift"])
    obstacles, links = closest_pairs(problem, motion, np.array([0.0, 1.0]))
    assert obstacles.margin[0] == obstacles.distance[0] == np.inf
    assert obstacles.distance[1] == pytest.approx(0.2)
    assert obstacles.margin[1] == pytest.approx(0.19)
    np.testing.assert_allclose(links.distance, -HALF - POST, atol=1e-9)


def test_nothing_is_closest_where_nothing_is_checked(ball):
    problem = changed(ball, obstacles=[])
    assert closest_pairs(problem, rest_to_rest(["turn"], 0.0, 1.0, 1.0), np.zeros(1)) == []
