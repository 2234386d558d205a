"""What several payloads weigh together: against Pinocchio, and against bodies of their own."""

import numpy as np
import pinocchio as pin
import pytest

from tubeplanner import Payload, load_robot

FIRST = Payload(2.5, (0.05, -0.02, 0.1), (0.03, 0.02, 0.04, 0.005, -0.002, 0.001))
SECOND = Payload(0.7, (-0.1, 0.3, 0.0), (0.01, 0.03, 0.02, -0.001, 0.002, 0.004))


def as_inertia(payload):
    return pin.Inertia(payload.mass, np.array(payload.com), payload.inertia_matrix())


def states(robot, count=12):
    return np.random.default_rng(5).uniform(-1.5, 1.5, (3, count, robot.joint_count))


@pytest.mark.parametrize("pair", [(FIRST, SECOND), (SECOND, FIRST), (FIRST, FIRST)])
def test_payloads_add_as_inertias_do(pair):
    both, expected = pair[0].plus(pair[1]), as_inertia(pair[0]) + as_inertia(pair[1])
    assert both.mass == pytest.approx(expected.mass)
    np.testing.assert_allclose(both.com, expected.lever, atol=1e-14)
    np.testing.assert_allclose(both.inertia_matrix(), expected.inertia, atol=1e-13)


def test_an_arm_feels_two_payloads_as_it_feels_each(ur5):
    """Efforts are linear in what an arm carries, whatever it does."""
    motion = states(ur5)
    bare, first, second, both = (
        ur5.with_payload(load).inverse_dynamics(*motion)
        for load in (None, FIRST, SECOND, FIRST.plus(SECOND))
    )
    np.testing.assert_allclose(both - bare, (first - bare) + (second - bare), atol=1e-10)
    assert abs(both - first).max() > 1.0


def test_an_arm_with_another_payload_is_as_one_loaded_with_it(ur5):
    loaded, motion = load_robot("example:ur5", "tool0", payload=FIRST), states(ur5)
    changed = ur5.with_payload(SECOND).with_payload(FIRST)
    assert (changed.payload, ur5.payload) == (FIRST, None)
    expected = loaded.inverse_dynamics(*motion)
    np.testing.assert_array_equal(changed.inverse_dynamics(*motion), expected)
    without = loaded.with_payload(None).inverse_dynamics(*motion)
    np.testing.assert_array_equal(without, ur5.inverse_dynamics(*motion))
    assert changed.limits is ur5.limits
    assert changed.motors is ur5.motors
    assert (changed.joint_names, changed.tool_frame) == (ur5.joint_names, ur5.tool_frame)


def test_points_that_are_heavy_add_to_something_possible():
    """What two points weigh turns freely about their line, but for rounding."""
    random = np.random.default_rng(0)
    for _ in range(50):
        first, second = (
            Payload(1e5 * random.uniform(0.1, 1), random.normal(size=3)) for _ in range(2)
        )
        assert first.plus(second).mass == pytest.approx(first.mass + second.mass)


def test_nothing_weighs_nothing_more():
    both = FIRST.plus(Payload(0.0, (1.0, 2.0, 3.0)))
    assert both.mass == FIRST.mass
    np.testing.assert_allclose(both.com, FIRST.com, atol=1e-15)
    np.testing.assert_allclose(both.inertia, FIRST.inertia, atol=1e-15)
