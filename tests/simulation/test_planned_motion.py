import numpy as np
import pytest

from cases import INERTIA, one_joint, quintic, rest_to_rest, with_motors
from tubeplanner import JointTrajectory, load_robot
from tubeplanner.simulation.planned_motion import planned_motion

PERIOD = 0.001
TIME = np.arange(1201) * PERIOD


@pytest.fixture
def plan(tmp_path):
    robot = with_motors(
        one_joint(tmp_path),
        armature=0.3,
        viscous_friction=0.5,
        backwards_friction=1.0,
        forwards_friction=2.0,
    )
    return planned_motion(robot, quintic(), TIME, PERIOD)


def test_it_is_the_plan_and_then_its_goal(plan):
    np.testing.assert_allclose(plan.start.position[::100], quintic().position(TIME[::100]))
    assert (plan.start.position[1000:] == plan.start.position[-1]).all()
    assert not plan.start.velocity[1000:].any()
    assert not plan.acceleration[1001:].any()


def test_efforts_are_the_motors_in_the_middle_of_a_period(plan):
    middle = quintic().at(TIME[:1000] + PERIOD / 2)
    expected = (INERTIA + 0.3) * middle.acceleration + 0.5 * middle.velocity + 2.0
    np.testing.assert_allclose(plan.effort[:1000], expected, atol=1e-4)
    assert not plan.effort[1001:].any()  # friction holds nothing that does not pull
    np.testing.assert_allclose(plan.inertia, INERTIA + 0.3)


def test_a_mean_acceleration_makes_up_the_velocity(plan):
    made = np.cumsum(plan.acceleration, axis=0) * PERIOD
    np.testing.assert_allclose(made[:-1], plan.start.velocity[1:], atol=1e-12)


def test_the_last_period_is_as_any_other(tmp_path):
    plan = planned_motion(one_joint(tmp_path), quintic(), TIME[:501], PERIOD)
    speeds = quintic().velocity(TIME[500:502])
    np.testing.assert_allclose(plan.acceleration[500], (speeds[1] - speeds[0]) / PERIOD)


def test_a_goal_that_is_reached_with_a_jolt_is_held_all_the_same(tmp_path):
    """Of t^2, which ends at 2 rad/s and 2 rad/s^2."""
    abrupt = JointTrajectory(["turn"], [0, 1.0], np.array([1.0, 0, 0])[:, None, None])
    time = np.array([0.9, 1.0, 1.1])
    plan = planned_motion(one_joint(tmp_path), abrupt, time, 0.1)
    assert plan.start.position[:, 0] == pytest.approx([0.81, 1.0, 1.0])
    assert plan.start.velocity[:, 0] == pytest.approx([1.8, 0.0, 0.0])
    assert plan.start.acceleration[:, 0] == pytest.approx([2.0, 0.0, 0.0])
    assert plan.acceleration[:, 0] == pytest.approx([-18.0, 0.0, 0.0])


def test_inertia_is_what_a_joint_has_while_the_others_have_no_motor():
    """Of two links with their masses at their ends."""
    robot = load_robot("example:two_link", "hand", gravity=(0, -9.81, 0))
    motion = rest_to_rest(["joint1", "joint2"], [0.2, -0.5], [0.4, 1.5], 1.0)
    time = np.array([0.3, 0.5])
    found = planned_motion(robot, motion, time, 0.2).inertia
    mass, inertia, square = 14.6, 0.1, 0.3**2
    cosine = np.cos(motion.position(time + 0.1)[:, 1])
    far = inertia + mass * square
    near = far + inertia + 2 * mass * square * (1 + cosine)
    between = far + mass * square * cosine
    free = near * far - between**2
    # With the other joint free to move, Schur's complement of its own entry.
    np.testing.assert_allclose(found, np.transpose([free / far, free / near]), rtol=1e-9)
