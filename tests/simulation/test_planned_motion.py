import numpy as np
import pytest

from cases import INERTIA, one_joint, quintic, with_motors
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
