"""Rates of efforts: closed forms, differences, and how they grow with the speed."""

import numpy as np
import pytest

from cases import one_joint
from follower_arm import follower_arm
from tubeplanner import Payload, load_robot
from tubeplanner.robot.effort_rate import (
    effort_rate,
    effort_rate_derivatives,
    gravity_effort_rate,
)


@pytest.fixture(scope="module", params=["two_link", "panda", "slide", "payload", "followers"])
def arm(request, tmp_path_factory):
    if request.param == "payload":
        return load_robot("example:ur10", "tool0", payload=Payload(8.0, (0.1, 0, 0.2)))
    if request.param == "followers":
        path = tmp_path_factory.mktemp("followers") / "followers.urdf"
        path.write_text(follower_arm())
        return load_robot(path, "tip")
    return request.getfixturevalue(request.param)


@pytest.fixture
def states(arm):
    """Random positions, velocities, accelerations and jerks, as fast as arms get, each (8, n)."""
    scale = np.array([1.5, 2.0, 60.0, 1e4])[:, None, None]
    return scale * np.random.default_rng(0).uniform(-1, 1, (4, 8, arm.joint_count))


def test_a_pendulums_is_known(tmp_path):
    """Effort I a + m g l cos(q), its rate I jerk - m g l sin(q) v."""
    robot = one_joint(tmp_path, mass=0.5)
    q, v, a, jerk = np.random.default_rng(1).uniform(-3, 3, (4, 20, 1))
    gravity = -0.5 * 9.81 * 0.5 * np.sin(q) * v
    np.testing.assert_allclose(gravity_effort_rate(robot, q, v), gravity, atol=1e-12)
    inertia = robot.inverse_dynamics(q, 0 * q, 1 + 0 * q) - robot.gravity_effort(q)
    expected = inertia * jerk + gravity
    np.testing.assert_allclose(effort_rate(robot, q, v, a, jerk), expected, atol=1e-12)


def test_they_are_what_the_efforts_change_by(arm, states):
    def efforts(t):
        q, v, a, jerk = states
        return arm.inverse_dynamics(
            q + t * v + t**2 / 2 * a + t**3 / 6 * jerk, v + t * a + t**2 / 2 * jerk, a + t * jerk
        )

    step = 2e-5
    numeric = (efforts(-2 * step) - 8 * efforts(-step)) / (12 * step)
    numeric += (8 * efforts(step) - efforts(2 * step)) / (12 * step)
    found = effort_rate(arm, *states)
    np.testing.assert_allclose(found / abs(found).max(), numeric / abs(found).max(), atol=1e-9)


@pytest.mark.parametrize("speed", [0.1, 3.0])
def test_gravitys_grow_with_the_speed_all_others_with_its_third_power(arm, states, speed):
    gravity = gravity_effort_rate(arm, *states[:2])
    expected = speed * gravity + speed**3 * (effort_rate(arm, *states) - gravity)
    run = (rate * speed**k for k, rate in enumerate(states))
    np.testing.assert_allclose(effort_rate(arm, *run), expected, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("order", range(4))
def test_derivatives_are_what_differences_find(arm, states, order):
    step = (1e-5, 1e-5, 1e-3, 1e-1)[order]
    found = effort_rate_derivatives(arm, *states)[order]
    for joint in range(arm.joint_count):
        sides = []
        for sign in (step, -step):
            moved = states.copy()
            moved[order, :, joint] += sign
            sides.append(effort_rate(arm, *moved))
        numeric = (sides[0] - sides[1]) / (2 * step)
        scale = abs(found).max()
        np.testing.assert_allclose(found[:, :, joint] / scale, numeric / scale, atol=1e-6)


def test_an_arm_at_rest_has_derivatives_too(arm):
    """By the jerk its inertia, by the velocity how gravity changes with the position."""
    still = np.zeros((1, arm.joint_count))
    by_q, by_v, by_a, by_jerk = effort_rate_derivatives(arm, still, still, still, still)
    gravity, _, inertia = arm.inverse_dynamics_derivatives(still, still, still)
    np.testing.assert_allclose(by_q, 0.0, atol=1e-9)
    np.testing.assert_allclose(by_v, gravity, atol=1e-9)
    np.testing.assert_allclose(by_a, 0.0, atol=1e-9)
    np.testing.assert_allclose(by_jerk, inertia, atol=1e-12)
