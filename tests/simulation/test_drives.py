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


def test_and_to_what_there_is_each_way_at_a_position(tmp_path):
    at = EffortRange(0, np.array([0.0, 1.0]), np.array([2.0, 4.0]), np.array([6.0, 8.0]))
    motor = drives(with_motors(one_joint(tmp_path), effort_ranges=[at]))
    assert bounds(motor, q=0.5) == [7.0, -3.0]
