import numpy as np

from cases import one_joint, with_motors
from tubeplanner.problem.robustness import Robustness
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.simulation.drives import Drives
from tubeplanner.simulation.plant import Draw, drawn_plants

STEP = 2.5e-4


def drives(robot, held=0.0, **errors):
    plants = drawn_plants(robot, Robustness.exact(**errors), Draw(1))
    return Drives(robot, plants, np.array([held]), STEP)


def answers(motor, asked):
    return np.array([motor.stepped(np.array([[effort]]))[0, 0] for effort in asked])


def bounds(motor, q=0.0, v=0.0):
    state = np.array([[q]]), np.array([[v]])
    found = [motor.bounded(np.array([[asked]]), *state) for asked in (1e3, -1e3, 0.0)]
    assert [bool(is_cut.item()) for _, is_cut in found] == [True, True, False]
    return [given.item() for given, _ in found[:2]]


def test_without_errors_motors_give_what_is_asked(tmp_path):
    asked = [1.0, -2.0, 3.0]
    assert answers(drives(one_joint(tmp_path)), asked).tolist() == asked


def test_a_delay_holds_what_was_held_before(tmp_path):
    motor = drives(one_joint(tmp_path), held=7.0, delay=3.1 * STEP)
    assert answers(motor, [1.0, 2.0, 3.0, 4.0, 5.0]).tolist() == [7.0, 7.0, 7.0, 1.0, 2.0]
    nearer = drives(one_joint(tmp_path), held=7.0, delay=2.9 * STEP)
    assert answers(nearer, [1.0, 2.0, 3.0, 4.0]).tolist() == [7.0, 7.0, 7.0, 1.0]


def test_each_arm_has_its_own_delay_and_lag(tmp_path):
    robot = one_joint(tmp_path)
    errors = ({}, {"delay": STEP}, {"delay": 3 * STEP}, {"lag": STEP})
    plants = [drawn_plants(robot, Robustness.exact(**each), Draw(1))[0] for each in errors]
    motors = Drives(robot, plants, np.zeros(1), STEP)
    asked = np.array([[1.0], [2.0], [3.0], [4.0]])
    first, second = motors.stepped(asked), motors.stepped(2 * asked)
    # Of a lag of one step, the mean during its first is 1/e.
    np.testing.assert_allclose(first, [[1.0], [0.0], [0.0], [4 * np.exp(-1)]], rtol=1e-12)
    np.testing.assert_allclose(second[:3], [[2.0], [2.0], [0.0]], rtol=1e-12)


def test_a_lag_is_of_first_order_and_steps_have_its_mean(tmp_path):
    lag = 0.002
    found = answers(drives(one_joint(tmp_path), held=1.0, lag=lag), np.full(40, 5.0))
    # The integral of 5 - 4 exp(-t/lag) over each step.
    ends = np.arange(41) * STEP
    integral = 5 * ends + 4 * lag * np.exp(-ends / lag)
    np.testing.assert_allclose(found, np.diff(integral) / STEP, rtol=1e-12)


def test_efforts_are_cut_to_the_limit_and_to_the_torque_speed_line(tmp_path):
    plain = one_joint(tmp_path)
    motor = drives(with_motors(plain, saturation_effort=8.0, no_load_velocity=4.0))
    assert bounds(drives(plain)) == [5.0, -5.0]
    assert bounds(motor, v=1.0) == [5.0, -5.0]
    assert bounds(motor, v=3.0) == [2.0, -5.0]
    assert bounds(motor, v=-3.0) == [5.0, -2.0]


def test_what_rounding_takes_is_not_called_saturation(tmp_path):
    asked = np.array([[5.0 * (1 + 1e-13)], [5.0 * (1 + 1e-6)]])
    plants = drawn_plants(one_joint(tmp_path), Robustness.exact(), Draw(2))
    motors = Drives(one_joint(tmp_path), plants, np.zeros(1), STEP)
    _, is_cut = motors.bounded(asked, np.zeros((2, 1)), np.zeros((2, 1)))
    assert is_cut.tolist() == [[False], [True]]


def test_and_to_what_there_is_each_way_at_a_position(tmp_path):
    at = EffortRange(0, np.array([0.0, 1.0]), np.array([2.0, 4.0]), np.array([6.0, 8.0]))
    motor = drives(with_motors(one_joint(tmp_path), effort_ranges=[at]))
    assert bounds(motor, q=0.5) == [7.0, -3.0]


def test_motors_go_on_with_other_limits_and_what_is_on_its_way(tmp_path):
    motor = drives(one_joint(tmp_path, effort=5.0), held=7.0, delay=STEP)
    assert answers(motor, [1.0]).tolist() == [7.0]
    stronger = with_motors(
        one_joint(tmp_path, effort=9.0), saturation_effort=8.0, no_load_velocity=4.0
    )
    motor.become(stronger)
    assert bounds(motor) == [8.0, -8.0]
    assert bounds(motor, v=-4.0) == [9.0, 0.0]
    assert answers(motor, [2.0, 3.0]).tolist() == [1.0, 2.0]
