import numpy as np
import pytest

from cases import INERTIA, one_joint, rest_to_rest, with_motors
from tubeplanner import OptionError, load_robot
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


def bar(tmp_path):
    return with_motors(
        one_joint(tmp_path, mass=MASS),
        viscous_friction=0.5,
        backwards_friction=1.0,
        forwards_friction=2.0,
    )


@pytest.mark.parametrize("name", CONTROLLERS)
def test_on_the_way_efforts_are_those_of_the_equation_of_motion(tmp_path, name):
    """Far behind and too slow, in periods so long that their middles are elsewhere."""
    robot, motion, period, k = bar(tmp_path), rest_to_rest(["turn"], 0.3, 0.9, 2.0), 0.1, 7
    plan = planned_motion(robot, motion, np.arange(21) * period, period)
    late, slow = 0.2, 0.1
    start, middle = motion.at(np.array([k * period])), motion.at(np.array([(k + 0.5) * period]))
    found = controller_maker(name)(robot, plan).effort(
        k, start.position - late, start.velocity - slow
    )
    inertia, weight = INERTIA + MASS * 0.5**2, MASS * 9.81 * 0.5
    back = inertia * (BANDWIDTH**2 * late + 2 * BANDWIDTH * slow)
    gain = motion.velocity((k + 1) * period) - motion.velocity(k * period)
    ahead = inertia * gain / period + 2.0
    moved, speed = middle.position, middle.velocity
    expected = {
        "computed-torque": ahead + weight * np.cos(moved - late) + 0.5 * (speed - slow),
        "feedforward-pd": ahead + weight * np.cos(moved) + 0.5 * speed,
        "pd": weight * np.cos(0.3),
    }[name]
    np.testing.assert_allclose(found, expected + back, rtol=1e-9)


@pytest.mark.parametrize("name", ["feedforward-pd", "pd"])
def test_feedback_has_the_inertia_of_where_the_arm_is_by_then(name):
    robot = load_robot("example:two_link", "hand")
    motion = rest_to_rest(["joint1", "joint2"], [0.2, -2.5], [0.4, 0.5], 1.0)
    plan = planned_motion(robot, motion, np.arange(11) / 10, 0.1)
    made, k = controller_maker(name)(robot, plan), 6
    q, v = motion.position(0.6)[None], motion.velocity(0.6)[None]
    back = made.effort(k, q - 1e-3, v) - made.effort(k, q, v)
    bent = motion.position(0.65)[None]
    pushed = [robot.inverse_dynamics(bent, 0 * v, unit[None])[0] for unit in np.eye(2)]
    mass_matrix = np.array(pushed) - robot.gravity_effort(bent)
    # What each motor alone gives its own joint is the acceleration that was asked for.
    got = np.diag(np.linalg.solve(mass_matrix, np.diag(back[0])))
    np.testing.assert_allclose(got, 1e-3 * BANDWIDTH**2, rtol=1e-9)


def test_an_unknown_controller_is_refused():
    with pytest.raises(OptionError, match="unknown controller 'pid'"):
        controller_maker("pid")
