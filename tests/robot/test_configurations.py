"""One configuration where many are taken: the same numbers, without the leading axis."""

import numpy as np
import pytest

from tubeplanner import LimitOverrides, PointSpeed, RobotError, load_robot

# Each with how many arrays of joints it takes, and the axis of the samples in what it returns.
METHODS = {
    "tool_position": (1, 0),
    "tool_pose": (1, 0),
    "tool_jacobian": (1, 0),
    "tool_pose_jacobian": (1, 0),
    "body_poses": (1, 0),
    "gravity_effort": (1, 0),
    "tool_velocity": (2, 0),
    "point_velocities": (2, 1),
    "inverse_dynamics": (3, 0),
    "inverse_dynamics_derivatives": (3, 0),
}


@pytest.fixture(scope="module")
def arm():
    points = [PointSpeed("wrist_1_link", (0.0, 0.0, 0.0), 1.0)] * 2
    return load_robot("example:ur5", "ee_link", limits=LimitOverrides(point_speed=points))


def _states(count, samples=4):
    return np.random.default_rng(3).uniform(-1, 1, (count, samples, 6))


def _arrays(result):
    return result if isinstance(result, tuple) else (result,)


@pytest.mark.parametrize("name", METHODS)
def test_one_configuration_gives_what_it_gives_among_many(arm, name):
    count, axis = METHODS[name]
    states = _states(count)
    many = _arrays(getattr(arm, name)(*states))
    one = _arrays(getattr(arm, name)(*states[:, 2]))
    assert len(one) == len(many)
    for single, several in zip(one, many, strict=True):
        np.testing.assert_allclose(single, several.take(2, axis), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", METHODS)
def test_lists_and_names_are_taken_too(arm, name):
    count, _ = METHODS[name]
    states = _states(count)[:, 0]
    named = dict(zip("qva", states.tolist(), strict=False))
    wanted = _arrays(getattr(arm, name)(*states))
    for found, expected in zip(_arrays(getattr(arm, name)(**named)), wanted, strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("shape", [(5,), (7,), (3, 5), (1, 1, 6), ()])
def test_another_shape_is_named_beside_the_one_that_is_wanted(arm, name, shape):
    with pytest.raises(RobotError) as error:
        getattr(arm, name)(*[np.zeros(shape)] * METHODS[name][0])
    assert str(shape) in str(error.value)
    assert "(6,), or (N, 6)" in str(error.value)


@pytest.mark.parametrize("shape", [(6,), (3, 6), (2, 5)])
def test_rates_have_the_shape_of_the_configurations(arm, shape):
    with pytest.raises(RobotError, match=r"v has shape .*, and q \(2, 6\)"):
        arm.tool_velocity(np.zeros((2, 6)), np.zeros(shape))


def test_efforts_by_position_are_had_for_one_configuration_too():
    limits = LimitOverrides(effort={"elbow_joint": {"position": [-1, 1], "effort": [10, 30]}})
    robot = load_robot("example:ur5", "ee_link", limits=limits)
    q = np.full(6, 0.5)
    assert robot.limits.effort_at(q, 1.0)[2] == pytest.approx(25)
    np.testing.assert_array_equal(
        robot.limits.effort_at(q, 1.0), robot.limits.effort_at(q[None], 1.0)[0]
    )
