import numpy as np
import pytest

from cases import INERTIA, one_joint, rest_to_rest
from tubeplanner import OptionError
from tubeplanner.problem.robustness import CONTROLLERS
from tubeplanner.simulation.planned_motion import planned_motion
from tubeplanner.simulation.tracking_controllers import BANDWIDTH, controller_maker

MASS = 2.0


def controller(tmp_path, name):
    robot = one_joint(tmp_path, mass=MASS)
    plan = planned_motion(robot, rest_to_rest(["turn"], 0.3, 0.9, 2.0), np.zeros(1), 0.001)
    return robot, controller_maker(name)(robot, plan)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_an_error_is_answered_as_by_a_critically_damped_oscillator(tmp_path, name):
    _, made = controller(tmp_path, name)
    at = np.array([[0.3], [0.3 + 1e-6], [0.3]])
    moving = np.array([[0.0], [0.0], [1e-6]])
    calm, behind, faster = made.effort(0, at, moving)[:, 0]
    inertia = INERTIA + MASS * 0.5**2
    weight_slope = -MASS * 9.81 * 0.5 * np.sin(0.3) if name == "computed-torque" else 0.0
    assert behind - calm == pytest.approx(1e-6 * (weight_slope - inertia * BANDWIDTH**2), rel=1e-4)
    assert faster - calm == pytest.approx(-2e-6 * inertia * BANDWIDTH, rel=1e-4)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_at_the_start_all_hold_the_weight(tmp_path, name):
    robot, made = controller(tmp_path, name)
    found = made.effort(0, np.array([[0.3]]), np.zeros((1, 1)))
    np.testing.assert_allclose(found, robot.gravity_effort(np.array([[0.3]])), atol=0.02)


def test_an_unknown_controller_is_refused():
    with pytest.raises(OptionError, match="unknown controller 'pid'"):
        controller_maker("pid")
