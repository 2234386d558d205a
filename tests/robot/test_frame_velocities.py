"""The velocities of points on links: against where the links are, and against differences."""

import numpy as np
import pytest

from tubeplanner import LimitOverrides, PointSpeed, load_robot

STEP = 1e-6
TOOLS = {"two_link": "hand", "ur5": "tool0", "panda": "panda_hand_tcp"}


@pytest.fixture(scope="module", params=TOOLS)
def arm(request):
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


def test_a_point_moves_as_its_link_does(arm):
    q, v = np.random.default_rng(2).uniform(-1, 1, (2, 7, arm.joint_count))
    ahead, behind = (places(arm, q + sign * STEP * v) for sign in (1, -1))
    velocity = arm.point_velocities(q, v)[0]
    np.testing.assert_allclose(velocity, (ahead - behind) / (2 * STEP), atol=1e-7)
    assert abs(velocity[0]).max() > 0.1
    assert (velocity[2] == 0).all()  # it is fixed to the base


def test_derivatives_are_those_of_the_velocity(arm):
    q, v = np.random.default_rng(3).uniform(-1, 1, (2, 5, arm.joint_count))
    _, by_q, by_v = arm.point_velocities(q, v)
    for j, direction in enumerate(np.eye(arm.joint_count)):
        for change, (dq, dv) in ((by_q, (direction, 0)), (by_v, (0, direction))):
            sides = [
                arm.point_velocities(q + sign * STEP * dq, v + sign * STEP * dv)[0]
                for sign in (1, -1)
            ]
            numeric = (sides[0] - sides[1]) / (2 * STEP)
            np.testing.assert_allclose(change[..., j], numeric, atol=1e-7)


def test_without_points_there_is_nothing(two_link):
    velocity, by_q, by_v = two_link.point_velocities(*np.zeros((2, 4, 2)))
    assert (velocity.shape, by_q.shape, by_v.shape) == ((0, 4, 3), (0, 4, 3, 2), (0, 4, 3, 2))
