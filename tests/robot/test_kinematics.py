"""Poses, Jacobians, velocities of bodies, frames and tool at N configurations, native or NumPy."""

import numpy as np
import pinocchio as pin
import pytest
from follower_arm import follower_arm
from rail_arm import rail_arm

from tubeplanner import LimitOverrides, PointSpeed, load_robot
from tubeplanner.native.library import LIBRARY, NativeLibrary
from tubeplanner.robot import body_chain, robot_model, tool_chain
from tubeplanner.robot.base_pose import BasePose
from tubeplanner.robot.body_chain import BodyChain

NEEDS_LIBRARY = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")


# Poses and Jacobians by compiled functions, against Pinocchio and against the arrays of numpy.


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


@NEEDS_LIBRARY
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


@NEEDS_LIBRARY
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


@NEEDS_LIBRARY
def test_configurations_may_be_a_view(ur5):
    q = configurations(ur5, 8)
    for one, other in zip(ur5.tool_pose(q[::2]), ur5.tool_pose(q[::2].copy()), strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(ur5.body_poses(q[::2]), ur5.body_poses(q), strict=True):
        np.testing.assert_array_equal(one, other[::2])


@NEEDS_LIBRARY
def test_no_configurations_have_no_poses(ur5):
    rotation, position, jacobian = ur5.tool_pose_jacobian(np.zeros((0, 6)))
    assert (rotation.shape, position.shape, jacobian.shape) == ((0, 3, 3), (0, 3), (0, 6, 6))


# Poses of bodies in many configurations, against Pinocchio one by one.


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


# The velocities of points on links: against where the links are, and against differences.


STEP = 1e-6
TOOLS = {"two_link": "hand", "ur5": "tool0", "panda": "panda_hand_tcp"}


@pytest.fixture(scope="module", params=TOOLS)
def frame_velocities_arm(request):
    """An arm of which points on its second, its last and its first link are limited."""
    name, tool = request.param, TOOLS[request.param]
    plain = load_robot(f"example:{name}", tool)
    base = next(link for link, body in plain.link_body.items() if body == 0)
    links = [plain.urdf.joints[plain.joint_names[1]].child, tool, base]
    points = [PointSpeed(link, (0.1, -0.2, 0.3), 1.0) for link in links]
    return load_robot(f"example:{name}", tool, limits=LimitOverrides(point_speed=points))


def places(arm, q):
    """Return where the points are, (P, N, 3) [m], from the poses of the bodies."""
    rotation, position = arm.body_poses(q)
    found = []
    for point in arm.limits.point_speed:
        body = arm.link_body[point.link]
        in_body = (arm.link_placement[point.link] @ [*point.position, 1.0])[:3]
        found.append(rotation[:, body] @ in_body + position[:, body])
    return np.array(found)


def test_a_point_moves_as_its_link_does(frame_velocities_arm):
    q, v = np.random.default_rng(2).uniform(-1, 1, (2, 7, frame_velocities_arm.joint_count))
    ahead, behind = (places(frame_velocities_arm, q + sign * STEP * v) for sign in (1, -1))
    velocity = frame_velocities_arm.point_velocities(q, v)[0]
    np.testing.assert_allclose(velocity, (ahead - behind) / (2 * STEP), atol=1e-7)
    assert abs(velocity[0]).max() > 0.1
    assert (velocity[2] == 0).all()  # it is fixed to the base


def test_derivatives_are_those_of_the_velocity(frame_velocities_arm):
    q, v = np.random.default_rng(3).uniform(-1, 1, (2, 5, frame_velocities_arm.joint_count))
    _, by_q, by_v = frame_velocities_arm.point_velocities(q, v)
    for j, direction in enumerate(np.eye(frame_velocities_arm.joint_count)):
        for change, (dq, dv) in ((by_q, (direction, 0)), (by_v, (0, direction))):
            sides = [
                frame_velocities_arm.point_velocities(q + sign * STEP * dq, v + sign * STEP * dv)[0]
                for sign in (1, -1)
            ]
            numeric = (sides[0] - sides[1]) / (2 * STEP)
            np.testing.assert_allclose(change[..., j], numeric, atol=1e-7)


def test_without_points_there_is_nothing(two_link):
    velocity, by_q, by_v = two_link.point_velocities(*np.zeros((2, 4, 2)))
    assert (velocity.shape, by_q.shape, by_v.shape) == ((0, 4, 3), (0, 4, 3, 2), (0, 4, 3, 2))
