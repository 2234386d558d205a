"""Efforts with rotors and viscous friction: against Pinocchio's own, formulas, and differences."""

import numpy as np
import pinocchio as pin
import pytest

from cases import with_motors
from follower_arm import JOINTS, RULES, follower_arm
from tubeplanner import load_robot

STEP = 1e-6


def states(count, samples=30):
    return np.random.default_rng(4).uniform(-2, 2, (3, samples, count))


def motors_of(count):
    rng = np.random.default_rng(5)
    return {"armature": rng.uniform(0.1, 2, count), "viscous_friction": rng.uniform(1, 9, count)}


@pytest.fixture(scope="module")
def follower(tmp_path_factory):
    """The arm with followers, its joints in an order of their own, and all its joints planned."""
    folder = tmp_path_factory.mktemp("followers")
    arms = []
    for name, rules, joints in (
        ("following", RULES, ["wrist", "first", "side_joint", "lift"]),
        ("free", {}, list(JOINTS)),
    ):
        path = folder / f"{name}.urdf"
        path.write_text(follower_arm(rules))
        arms.append(load_robot(path, "tip", joints=joints))
    return arms


def test_rotors_are_pinocchios_armature(ur5):
    motors = motors_of(6)
    model = pin.buildModelFromUrdf(str(ur5.urdf.path))
    assert tuple(list(model.names)[1:]) == ur5.joint_names
    model.armature = motors["armature"]
    data, (q, v, a) = model.createData(), states(6)
    rigid = [pin.rnea(model, data, *state).copy() for state in zip(q, v, a, strict=True)]
    expected = np.array(rigid) + motors["viscous_friction"] * v
    found = with_motors(ur5, **motors).inverse_dynamics(q, v, a)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-10)


def test_joints_in_another_order_have_their_own_motors(ur5):
    order = [3, 0, 5, 1, 4, 2]
    names = [ur5.joint_names[k] for k in order]
    other, motors = load_robot("example:ur5", "tool0", joints=names), motors_of(6)
    permuted = with_motors(other, **{name: value[order] for name, value in motors.items()})
    state, robot = states(6), with_motors(ur5, **motors)
    found = permuted.inverse_dynamics(*(part[:, order] for part in state))
    np.testing.assert_allclose(found, robot.inverse_dynamics(*state)[:, order], atol=1e-10)


def test_followers_have_no_motors(follower):
    """What the masters feel is their own rotors and friction, once: not once more per follower."""
    plain, _ = follower
    motors, (q, v, a) = motors_of(4), states(4)
    found = with_motors(plain, **motors).inverse_dynamics(q, v, a)
    expected = plain.inverse_dynamics(q, v, a)
    expected += motors["armature"] * a + motors["viscous_friction"] * v
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_gravity_is_held_without_friction(ur5):
    q = states(6)[0]
    found = with_motors(ur5, **motors_of(6), forwards_friction=3.0).gravity_effort(q)
    np.testing.assert_allclose(found, ur5.gravity_effort(q), atol=1e-12)


@pytest.mark.parametrize("which", ["ur5", "following", "free"])
def test_derivatives_are_those_of_differences(which, ur5, follower):
    plain = ur5 if which == "ur5" else follower[which == "free"]
    robot = with_motors(plain, **motors_of(plain.joint_count))
    state = states(plain.joint_count, 5)
    exact = robot.inverse_dynamics_derivatives(*state)
    for order in range(3):
        for joint in range(plain.joint_count):
            shift = np.zeros_like(state)
            shift[order, :, joint] = STEP
            sides = [robot.inverse_dynamics(*(state + way * shift)) for way in (1, -1)]
            slope = (sides[0] - sides[1]) / (2 * STEP)
            np.testing.assert_allclose(exact[order][:, :, joint], slope, rtol=1e-5, atol=1e-5)
