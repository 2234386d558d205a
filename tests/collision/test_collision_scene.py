from dataclasses import replace

import pytest

from tubeplanner import Obstacle, load_robot, placement_of
from tubeplanner.collision.collision_scene import CollisionScene


def ball():
    return Obstacle.sphere("ball", 0.1, placement_of([0.0, 0.5, 0.5]))


@pytest.fixture(scope="module")
def scene():
    robot = load_robot("example:two_link", "hand")
    return CollisionScene(robot, (ball(),), (), True, ())


def test_an_arm_with_other_limits_meets_the_same_scene(scene):
    robot = scene.robot
    limits = replace(robot.limits, effort=0.9 * robot.limits.effort)
    assert scene.is_as(replace(scene, robot=robot.with_limits(limits, robot.motors)))


@pytest.mark.parametrize(
    "changes",
    [
        {"obstacles": ()},
        {"obstacles": (ball(),)},
        {"self_collision": False},
        {"ignore": (("hand", "ball"),)},
        {"robot": load_robot("example:two_link", "hand")},
    ],
    ids=["none", "another", "links", "pairs", "arm"],
)
def test_with_anything_else_it_is_another(scene, changes):
    assert not scene.is_as(replace(scene, **changes))
