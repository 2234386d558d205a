"""Poses and Jacobians by compiled functions, against Pinocchio and against the arrays of numpy."""

import numpy as np
import pinocchio as pin
import pytest

from follower_arm import follower_arm
from rail_arm import rail_arm
from tubeplanner import load_robot
from tubeplanner.native.library import LIBRARY, NativeLibrary
from tubeplanner.robot import body_chain, robot_model, tool_chain
from tubeplanner.robot.base_pose import BasePose

pytestmark = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")
PURE = NativeLibrary(None, "for a test")


@pytest.fixture(
    params=["two_link", "ur5", "panda", "slide", "rail", "followers", "branch", "moved"]
)
def arm(request, tmp_path):
    """Arms with a slide, with joints that follow others, with two branches, on a moved base."""
    sources = {"rail": (rail_arm(), "flange"), "followers": (follower_arm(), "tip")}
    sources["branch"] = (follower_arm(rules={}), "side")
    if request.param == "moved":
        return load_robot("example:ur5", "tool0", base=BasePose((0.3, -0.2, 1.0), (0.4, 2.0, -1.0)))
    if request.param not in sources:
        return request.getfixturevalue(request.param)
    text, tool = sources[request.param]
    (tmp_path / "arm.urdf").write_text(text)
    joints = None if tool != "side" else ["first", "second", "side_joint", "lift"]
    return load_robot(tmp_path / "arm.urdf", tool, joints=joints)


def configurations(robot, count=7):
    return np.random.default_rng(1).uniform(-2, 2, (count, robot.joint_count))


def test_the_tool_is_where_pinocchio_has_it(arm):
    q = configurations(arm)
    rotation, position, jacobian = arm.tool_pose_jacobian(q)
    model, data, tool = arm._model, arm._model.createData(), arm._tool_id
    for k, values in enumerate(arm._joints.positions(q)):
        columns = pin.computeFrameJacobian(model, data, values, tool, pin.LOCAL_WORLD_ALIGNED)
        columns = arm._joints.collected(columns.reshape(6, -1))
        placement = pin.updateFramePlacement(model, data, tool)
        np.testing.assert_allclose(rotation[k], placement.rotation, atol=1e-12)
        np.testing.assert_allclose(position[k], placement.translation, atol=1e-12)
        np.testing.assert_allclose(jacobian[k], columns, atol=1e-12)
    for same, other in zip(arm.tool_pose(q), (rotation, position), strict=True):
        np.testing.assert_array_equal(same, other)


@pytest.mark.parametrize("count", [1, 7, 70])
def test_the_arrays_of_numpy_are_the_same(count, arm, monkeypatch):
    q = configurations(arm, count)
    rng = np.random.default_rng(2)
    body = rng.integers(0, arm.body_count, count)
    point = rng.normal(size=(count, 3))

    def all_of():
        poses = arm.body_poses(q)
        moved = arm.point_jacobian(*poses, body, point)
        return *poses, *arm.tool_pose(q), *arm.tool_pose_jacobian(q), moved

    compiled = all_of()
    for module in (body_chain, robot_model, tool_chain):
        monkeypatch.setattr(module, "LIBRARY", PURE)
    for one, other in zip(compiled, all_of(), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)
        assert one.shape == other.shape


def test_configurations_may_be_a_view(ur5):
    q = configurations(ur5, 8)
    for one, other in zip(ur5.tool_pose(q[::2]), ur5.tool_pose(q[::2].copy()), strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(ur5.body_poses(q[::2]), ur5.body_poses(q), strict=True):
        np.testing.assert_array_equal(one, other[::2])


def test_no_configurations_have_no_poses(ur5):
    rotation, position, jacobian = ur5.tool_pose_jacobian(np.zeros((0, 6)))
    assert (rotation.shape, position.shape, jacobian.shape) == ((0, 3, 3), (0, 3), (0, 6, 6))
