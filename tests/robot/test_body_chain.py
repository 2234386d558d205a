"""Poses of bodies in many configurations, against Pinocchio one by one."""

import numpy as np
import pinocchio as pin
import pytest

from tubeplanner.robot.body_chain import BodyChain


@pytest.mark.parametrize(
    "name", ["two_link/around_a_post", "ur5/over_the_wall", "panda/between_shelves"]
)
def test_poses_are_those_of_pinocchio(name, bundled):
    robot = bundled(name).robot
    q = np.random.default_rng(3).uniform(-2, 2, (9, robot.joint_count))
    rotation, position = robot.body_poses(q)
    model, data = robot._model, robot._model.createData()
    for k, values in enumerate(robot._joints.positions(q)):
        pin.forwardKinematics(model, data, values)
        for body, placement in enumerate(data.oMi):
            np.testing.assert_allclose(rotation[k, body], placement.rotation, atol=1e-14)
            np.testing.assert_allclose(position[k, body], placement.translation, atol=1e-14)


@pytest.mark.parametrize("name", ["two_link/around_a_post", "panda/between_shelves"])
def test_the_tool_of_many_is_as_that_of_few(name, bundled):
    robot = bundled(name).robot
    q = np.random.default_rng(4).uniform(-2, 2, (100, robot.joint_count))
    many, few = robot.tool_pose_jacobian(q), robot.tool_pose_jacobian(q[:3])
    for all_of_them, some in zip(many, few, strict=True):
        np.testing.assert_allclose(all_of_them[:3], some, atol=1e-14)
    for pose, same in zip(robot.tool_pose(q), many[:2], strict=True):
        np.testing.assert_array_equal(pose, same)


def test_a_slide_on_a_turned_body_moves_along_its_own_axis():
    upright = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # a quarter turn about y
    chain = BodyChain(
        parents=np.array([0, 0, 1]),
        rotation=np.array([np.eye(3), np.eye(3), upright]),
        position=np.array([[0.0, 0, 0], [0, 0, 0.5], [0.2, 0, 0]]),
        axes=np.array([[0.0, 0, 1], [0, 0, 1]]),
        turns=np.array([True, False]),
    )
    rotation, position = chain.poses(np.array([[np.pi / 2, 0.3], [0.0, 0.0]]))
    np.testing.assert_allclose(position[:, 2], [[0, 0.5, 0.5], [0.2, 0, 0.5]], atol=1e-15)
    np.testing.assert_allclose(rotation[1, 2], upright)
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(rotation[0, 2], quarter @ upright, atol=1e-15)
