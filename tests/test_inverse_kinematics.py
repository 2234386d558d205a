import numpy as np
import pytest

from tubeplanner.inverse_kinematics import solve_position


def bounds(robot):
    return robot.limits.lower_position, robot.limits.upper_position


def test_a_reachable_position_is_reached(robot):
    rng = np.random.default_rng(1)
    low, high = bounds(robot)
    low, high = np.maximum(low, -2.5), np.minimum(high, 2.5)
    for _ in range(20):
        goal = rng.uniform(low, high)
        target = robot.tool_position(goal[None])[0]
        seed = np.clip(goal + rng.normal(scale=0.2, size=len(goal)), *bounds(robot))
        solution = solve_position(robot, target, seed, *bounds(robot))
        assert solution.error < 1e-9
        assert (solution.q >= low - 10).all()


def test_a_fully_stretched_arm_is_reached(two_link):
    """The goal of the paper's second example: 0.6 m away is the whole length of the arm."""
    solution = solve_position(
        two_link, np.array([0.6, 0, 0]), np.array([0.5, -1.0]), *bounds(two_link)
    )
    assert solution.error < 1e-6
    np.testing.assert_allclose(solution.q, 0, atol=3e-3)


def test_out_of_reach_the_nearest_point_is_found(two_link):
    solution = solve_position(
        two_link, np.array([0.0, 0.7, 0]), np.array([0.5, -1.0]), *bounds(two_link)
    )
    assert solution.error == pytest.approx(0.1, abs=1e-3)


def test_bounds_hold_and_are_used(two_link):
    """With the elbow held between -0.5 and 0 the hand can get no nearer than 0.58 m."""
    lower, upper = np.array([-3.0, -0.5]), np.array([3.0, 0.0])
    solution = solve_position(two_link, np.array([0.3, 0, 0]), np.zeros(2), lower, upper)
    assert solution.q[1] == -0.5
    reach = 0.3 * np.hypot(1 + np.cos(0.5), np.sin(0.5))
    assert solution.error == pytest.approx(reach - 0.3, abs=1e-4)


def test_spare_joints_go_to_the_preferred_configuration(panda):
    """The preferred configuration reaches the target, so the solution is that configuration."""
    rng = np.random.default_rng(2)
    preferred = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])
    target = panda.tool_position(preferred[None])[0]
    seed = preferred + rng.uniform(-0.3, 0.3, 7)
    solution = solve_position(panda, target, seed, *bounds(panda), preferred)
    np.testing.assert_allclose(solution.q, preferred, atol=1e-6)


def test_without_a_preference_joints_move_little(panda):
    q = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])
    target = panda.tool_position(q[None])[0] + np.array([0, 0, 1e-3])
    solution = solve_position(panda, target, q, *bounds(panda))
    assert abs(solution.q - q).max() < 0.01


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_stretched_arm_folds_the_way_its_bounds_allow(sign, two_link):
    """At full stretch the hand's inward motion has no gradient in the joints."""
    lower, upper = np.sort([[0.0, 3.0 * sign], [-3.0, 3.0]], axis=1)[[0, 1]].T
    lower, upper = np.array([-3.0, lower[0]]), np.array([3.0, upper[0]])
    target = np.array([0.5, 0, 0])
    solution = solve_position(two_link, target, np.zeros(2), lower, upper)
    assert solution.error < 1e-9
    assert np.sign(solution.q[1]) == sign
