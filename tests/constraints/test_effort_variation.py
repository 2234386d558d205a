"""Total variation of efforts against closed forms."""

import numpy as np
import pytest

from cases import ANGLE, INERTIA, PEAK_ACCELERATION, one_joint, quintic
from tubeplanner import JointTrajectory, LimitOverrides, load_robot
from tubeplanner.constraints.effort_variation import effort_variation

MASS, LEVER, GRAVITY, EFFORT = 2.0, 0.5, 9.81, 5.0


@pytest.mark.parametrize("duration", [1.0, 0.4])
def test_a_rest_to_rest_quintic_moves_its_effort_up_down_and_back(duration, tmp_path):
    """From 0 to the peak, to the opposite one, and to 0: four peaks."""
    peak = INERTIA * PEAK_ACCELERATION * ANGLE / duration**2
    found = effort_variation(one_joint(tmp_path), quintic(duration=duration))
    assert found == pytest.approx([4 * peak / EFFORT], rel=5e-3)
    assert found <= 4 * peak / EFFORT


def pendulum_effort(q, acceleration):
    """A bar about z, its centre 0.5 m along x, gravity along -y."""
    inertia = INERTIA + MASS * LEVER**2
    return inertia * acceleration + MASS * GRAVITY * LEVER * np.cos(q)


def test_a_pendulums_effort_moves_with_gravity_too(tmp_path):
    """Its extremes are where the closed form turns, found on a fine grid."""
    s = np.linspace(0, 1, 200_001)
    q = ANGLE * s**3 * (10 - 15 * s + 6 * s**2)
    effort = pendulum_effort(q, ANGLE * s * (60 - 180 * s + 120 * s**2))
    expected = abs(np.diff(effort)).sum() / EFFORT
    found = effort_variation(one_joint(tmp_path, mass=MASS), quintic())
    assert found == pytest.approx([expected], rel=1e-2)
    assert abs(found - 4 * INERTIA * PEAK_ACCELERATION * ANGLE / EFFORT) > 0.1


def test_jumps_between_pieces_count_and_the_hold_before_and_after_does_not(tmp_path):
    """Full effort one way, then the other: from one limit to the opposite."""
    peak = EFFORT / INERTIA
    coefficients = np.array([[[peak / 2], [-peak / 2]], [[0], [peak]], [[0], [peak / 2]]])
    bang_bang = JointTrajectory(["turn"], [0.0, 1.0, 2.0], coefficients)
    assert effort_variation(one_joint(tmp_path), bang_bang) == pytest.approx([2.0], rel=1e-12)


def test_without_a_limit_the_largest_effort_is_the_unit(tmp_path):
    robot = one_joint(tmp_path, effort=np.inf, acceleration=50.0)
    assert effort_variation(robot, quintic()) == pytest.approx([4.0], rel=5e-3)


def test_beside_another_motion_that_ones_largest_effort_is_the_unit(tmp_path):
    """Twice as slow, a quarter of the effort: its variation too is a quarter."""
    robot = one_joint(tmp_path, effort=np.inf, acceleration=50.0)
    slower = quintic().scaled(2.0)
    beside, alone = (effort_variation(robot, slower, other) for other in (quintic(), None))
    assert beside == pytest.approx(effort_variation(robot, quintic()) / 4, rel=1e-9)
    assert alone == pytest.approx(effort_variation(robot, quintic()), rel=1e-9)


def test_a_joint_at_rest_without_gravity_has_none():
    limits = LimitOverrides(velocity={"joint1": np.inf, "joint2": np.inf})
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    still = JointTrajectory(robot.joint_names, [0.0, 1.0], np.zeros((4, 1, 2)))
    np.testing.assert_array_equal(effort_variation(robot, still), [0.0, 0.0])
