"""Poses, Jacobians, velocities of bodies, frames and tool at N configurations, native or NumPy."""

import numpy as np
import pinocchio as pin
import pytest
from arms import follower_arm, rail_arm
from numpy.testing import assert_allclose as close
from numpy.testing import assert_array_equal as same

from tubeplanner import LimitOverrides, PointSpeed, load_robot
from tubeplanner.native.library import LIBRARY
from tubeplanner.robot import kinematics
from tubeplanner.robot import model as robot_model
from tubeplanner.robot.pinocchio_model import BasePose

STEP = 1e-6


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


def test_bodies_and_tool_are_where_pinocchio_has_them(arm):
    q = configurations(arm)
    bodies, (rotation, position, jacobian) = arm.body_poses(q), arm.tool_pose_jacobian(q)
    model, data, tool = arm._model, arm._model.createData(), arm._tool_id
    for k, values in enumerate(arm._joints.positions(q)):
        columns = pin.computeFrameJacobian(model, data, values, tool, pin.LOCAL_WORLD_ALIGNED)
        close(jacobian[k], arm._joints.collected(columns.reshape(6, -1)), atol=1e-12)
        placement = pin.updateFramePlacement(model, data, tool)
        close(rotation[k], placement.rotation, atol=1e-12)
        close(position[k], placement.translation, atol=1e-12)
        pin.forwardKinematics(model, data, values)
        for body, placement in enumerate(data.oMi):
            close(bodies[0][k, body], placement.rotation, atol=1e-14)
            close(bodies[1][k, body], placement.translation, atol=1e-14)
    for one, other in zip(arm.tool_pose(q), (rotation, position), strict=True):
        same(one, other)


@pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")
@pytest.mark.parametrize("count", [0, 7, 70])
def test_the_arrays_of_numpy_are_the_same(count, arm, monkeypatch):
    q = configurations(arm, count)
    rng = np.random.default_rng(2)
    body, point = rng.integers(0, arm.body_count, count), rng.normal(size=(count, 3))

    def all_of():
        poses = arm.body_poses(q)
        moved = arm.point_jacobian(*poses, body, point)
        return *poses, *arm.tool_pose(q), *arm.tool_pose_jacobian(q), moved

    compiled = all_of()
    for name in ("_body_poses", "_last_poses"):
        monkeypatch.setattr(kinematics, name, None)
    monkeypatch.setattr(robot_model, "_point_jacobians", None)
    for one, other in zip(compiled, all_of(), strict=True):
        close(one, other, atol=1e-12)
        assert one.shape == other.shape


def test_a_view_of_configurations_has_the_poses_of_a_copy(panda):
    q = configurations(panda, 100)
    for one, other in zip(panda.tool_pose(q[::2]), panda.tool_pose(q[::2].copy()), strict=True):
        same(one, other)
    for one, other in zip(panda.body_poses(q[::2]), panda.body_poses(q), strict=True):
        same(one, other[::2])


def test_points_move_as_their_links_do_and_their_derivatives_are_those_of_differences():
    """The last one is fixed to the base."""
    links, tool = ("panda_link2", "panda_hand_tcp", "panda_link0"), "panda_hand_tcp"
    points = [PointSpeed(link, (0.1, -0.2, 0.3), 1.0) for link in links]
    arm = load_robot("example:panda", tool, limits=LimitOverrides(point_speed=points))
    q, v = np.random.default_rng(2).uniform(-1, 1, (2, 7, arm.joint_count))

    def places(q):
        rotation, position = arm.body_poses(q)
        for point in arm.limits.point_speed:
            body = arm.link_body[point.link]
            in_body = (arm.link_placement[point.link] @ [*point.position, 1.0])[:3]
            yield rotation[:, body] @ in_body + position[:, body]

    velocity, by_q, by_v = arm.point_velocities(q, v)
    ahead, behind = (np.array([*places(q + sign * STEP * v)]) for sign in (1, -1))
    close(velocity, (ahead - behind) / (2 * STEP), atol=1e-7)
    assert abs(velocity[0]).max() > 0.1
    same(velocity[2], 0.0)
    for j, way in enumerate(STEP * np.eye(arm.joint_count)):
        for exact, (dq, dv) in ((by_q, (way, 0)), (by_v, (0, way))):
            ahead, behind = (arm.point_velocities(q + s * dq, v + s * dv)[0] for s in (1, -1))
            close(exact[..., j], (ahead - behind) / (2 * STEP), atol=1e-7)


def test_without_points_there_are_no_velocities_of_points(two_link):
    velocity, by_q, by_v = two_link.point_velocities(*np.zeros((2, 4, 2)))
    assert (velocity.shape, by_q.shape, by_v.shape) == ((0, 4, 3), (0, 4, 3, 2), (0, 4, 3, 2))
