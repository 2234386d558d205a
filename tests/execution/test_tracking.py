"""Tracking controllers, planned feedforward, bounds and lag of drives."""

import numpy as np
import pytest
from cases import INERTIA, SLIDE, one_joint, quintic, rest_to_rest, with_motors

from tubeplanner import JointTrajectory, LimitOverrides, OptionError, load_robot
from tubeplanner.execution.plants import Draw, drawn_plants
from tubeplanner.execution.tracking import Drives, Feedback, controller_maker, planned_motion
from tubeplanner.robot.joint_limits import EffortRange
from tubeplanner.task.demands import CONTROLLERS, PD, Robustness

PERIOD = 0.001
TIME = np.arange(1201) * PERIOD
BANDWIDTH = 30.0  # [rad/s]


def bar(tmp_path, mass=0.0, armature=0.0):
    friction = {"viscous_friction": 0.5, "backwards_friction": 1.0, "forwards_friction": 2.0}
    return with_motors(one_joint(tmp_path, mass=mass), armature=armature, **friction)


def test_it_is_the_plan_and_then_its_goal_by_the_middles_of_periods(tmp_path):
    plan = planned_motion(bar(tmp_path, armature=0.3), quintic(), TIME, PERIOD)
    np.testing.assert_allclose(plan.start.position[::100], quintic().position(TIME[::100]))
    assert (plan.start.position[1000:] == plan.start.position[-1]).all()
    assert not plan.start.velocity[1000:].any()
    assert not plan.acceleration[1001:].any()
    middle = quintic().at(TIME[:1000] + PERIOD / 2)
    expected = (INERTIA + 0.3) * middle.acceleration + 0.5 * middle.velocity + 2.0
    np.testing.assert_allclose(plan.effort[:1000], expected, atol=1e-4)
    assert not plan.effort[1001:].any()  # friction holds nothing that does not pull
    np.testing.assert_allclose(plan.inertia, INERTIA + 0.3)
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
    found = planned_motion(robot, motion, time, 0.2)
    mass, inertia, square = 14.6, 0.1, 0.3**2
    cosine = np.cos(motion.position(time + 0.1)[:, 1])
    far = inertia + mass * square
    near = far + inertia + 2 * mass * square * (1 + cosine)
    between = far + mass * square * cosine
    free = near * far - between**2
    # With the other joint free to move, Schur's complement of its own entry.
    np.testing.assert_allclose(found.inertia, np.transpose([free / far, free / near]), rtol=1e-9)
    fractions = free / (near * far)
    np.testing.assert_allclose(found.freedom, np.transpose([fractions, fractions]), rtol=1e-9)


def test_a_joint_is_as_stiff_as_its_effort_limit_within_a_tenth_of_a_radian(tmp_path):
    """Or within 10 mm, of a sliding joint; but no quicker than 80 rad/s."""
    path = tmp_path / "slide.urdf"
    path.write_text(SLIDE)
    motion = rest_to_rest(["turn", "extend", "lift"], np.zeros(3), [1e-6, 0.0, 0.0], 1.0)

    def plan(**efforts):
        robot = load_robot(path, "tip", limits=LimitOverrides(effort=efforts))
        return planned_motion(robot, motion, np.zeros(1), PERIOD)

    usual = plan()
    stiffness = 3 * usual.inertia * usual.stiff**2
    np.testing.assert_allclose(stiffness[0, :2], [60 / 0.1, 80 / 0.01], rtol=1e-9)
    assert plan(lift=50.0).stiff[0, 2] == 80
    np.testing.assert_allclose(usual.integral_limit, [6.0, 8.0, 2.0])
    assert plan(lift=np.inf).stiff[0, 2] == 0


def test_the_integral_is_bounded_by_a_tenth_of_the_effort_limit_and_goes_on_from_plan_to_plan(
    tmp_path,
):
    """It grows by w^3 e in a second, and at its bound it does not wind up."""
    motion, behind, rest = rest_to_rest(["turn"], 0.3, 0.3 + 1e-9, 2.0), 1e-3, np.zeros((1, 1))
    plan = planned_motion(one_joint(tmp_path), motion, TIME, PERIOD)
    feedback, w = Feedback(BANDWIDTH, PERIOD), np.full((len(TIME), 1), BANDWIDTH)

    def integral(k, error, of=plan):
        found = feedback.acceleration(of, w, k, np.array([[0.3 - error]]), rest)[0, 0]
        return INERTIA * (found - 3 * BANDWIDTH**2 * error)

    grown = [integral(k, behind) for k in range(10)]
    step = INERTIA * BANDWIDTH**3 * behind * PERIOD
    np.testing.assert_allclose(grown, step * np.arange(1, 11), rtol=1e-4)
    assert integral(10, 10.0) == pytest.approx(0.5)
    assert integral(11, behind) == pytest.approx(0.5)
    again = planned_motion(one_joint(tmp_path), motion, TIME, PERIOD)
    assert integral(0, -behind, again) == pytest.approx(0.5 - step, rel=1e-4)


MASS = 2.0


def controller(tmp_path, name):
    robot = one_joint(tmp_path, mass=MASS)
    plan = planned_motion(robot, rest_to_rest(["turn"], 0.3, 0.9, 2.0), np.zeros(1), 0.001)
    return robot, controller_maker(name)(robot, plan, Feedback(BANDWIDTH, 0.001))


def bandwidth_of(name, effort, inertia, period=0.001):
    """Return that of a joint with an effort limit: of "pd" the stiffness is what is given."""
    bandwidth = np.sqrt(effort / 0.1 / (3 * inertia)) if name == PD else BANDWIDTH
    return np.minimum(bandwidth, 0.4 / period)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_an_error_is_answered_as_by_an_oscillator_with_three_equal_poles(tmp_path, name):
    _, made = controller(tmp_path, name)
    at = np.array([[0.3], [0.3 + 1e-6], [0.3]])
    moving = np.array([[0.0], [0.0], [1e-6]])
    calm, behind, faster = made.effort(0, at, moving)[:, 0]
    inertia = INERTIA + MASS * 0.5**2
    weight_slope = -MASS * 9.81 * 0.5 * np.sin(0.3) if name == "computed-torque" else 0.0
    w = bandwidth_of(name, 5.0, inertia)
    stiffness = inertia * (3 * w**2 + w**3 * 0.001)  # with the integral of one period
    assert behind - calm == pytest.approx(1e-6 * (weight_slope - stiffness), rel=1e-4)
    assert faster - calm == pytest.approx(-3e-6 * inertia * w, rel=1e-4)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_at_the_start_all_hold_the_weight(tmp_path, name):
    robot, made = controller(tmp_path, name)
    found = made.effort(0, np.array([[0.3]]), np.zeros((1, 1)))
    np.testing.assert_allclose(found, robot.gravity_effort(np.array([[0.3]])), atol=0.02)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_on_the_way_efforts_are_those_of_the_equation_of_motion(tmp_path, name):
    """Far behind and too slow, in periods so long that their middles are elsewhere."""
    robot, motion, period, k = bar(tmp_path, MASS), rest_to_rest(["turn"], 0.3, 0.9, 2.0), 0.1, 7
    plan = planned_motion(robot, motion, np.arange(21) * period, period)
    late, slow = 0.2, 0.1
    start, middle = motion.at(np.array([k * period])), motion.at(np.array([(k + 0.5) * period]))
    found = controller_maker(name)(robot, plan, Feedback(BANDWIDTH, period)).effort(
        k, start.position - late, start.velocity - slow
    )
    inertia, weight = INERTIA + MASS * 0.5**2, MASS * 9.81 * 0.5
    w = bandwidth_of(name, 5.0, inertia, period)
    back = 3 * inertia * w * (w * late + slow) + 0.5  # of the integral, at its bound
    gain = motion.velocity((k + 1) * period) - motion.velocity(k * period)
    ahead = inertia * gain / period + 2.0
    moved, speed = middle.position, middle.velocity
    expected = {
        "computed-torque": ahead + weight * np.cos(moved - late) + 0.5 * (speed - slow),
    }.get(name, ahead + weight * np.cos(moved) + 0.5 * speed)
    np.testing.assert_allclose(found, expected + back, rtol=1e-9)


@pytest.mark.parametrize("name", ["feedforward-pd", "pd"])
def test_feedback_has_the_inertia_of_where_the_arm_is_by_then(name):
    robot = load_robot("example:two_link", "hand")
    motion = rest_to_rest(["joint1", "joint2"], [0.2, -2.5], [0.4, 0.5], 1.0)
    plan = planned_motion(robot, motion, np.arange(11) / 10, 0.1)
    k = 6
    q, v = motion.position(0.6)[None], motion.velocity(0.6)[None]
    behind, calm = (
        controller_maker(name)(robot, plan, Feedback(BANDWIDTH, 0.1)).effort(k, at, v)
        for at in (q - 1e-5, q)
    )
    back = behind - calm
    bent = motion.position(0.65)[None]
    pushed = [robot.inverse_dynamics(bent, 0 * v, unit[None])[0] for unit in np.eye(2)]
    mass_matrix = np.array(pushed) - robot.gravity_effort(bent)
    # What each motor alone gives its own joint is the acceleration that was asked for.
    got = np.diag(np.linalg.solve(mass_matrix, np.diag(back[0])))
    inertia = 1 / np.diag(np.linalg.inv(mass_matrix))
    w = bandwidth_of(name, robot.limits.effort, inertia, 0.1)
    fraction = 2 * inertia / np.diag(mass_matrix)  # of the integral, as the joints move each other
    assert fraction.max() < 1
    np.testing.assert_allclose(got, 1e-5 * (3 * w**2 + 0.1 * fraction * w**3), rtol=1e-6)


def test_an_unknown_controller_is_refused():
    with pytest.raises(OptionError, match="unknown controller 'pid'"):
        controller_maker("pid")


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


def test_without_errors_motors_give_what_is_asked_and_a_delay_holds_what_was_held(tmp_path):
    robot, efforts = one_joint(tmp_path), [1.0, 2.0, 3.0, 4.0, 5.0]
    assert answers(drives(robot), [1.0, -2.0, 3.0]).tolist() == [1.0, -2.0, 3.0]
    late = drives(robot, held=7.0, delay=3.1 * STEP)
    assert answers(late, efforts).tolist() == [7.0, 7.0, 7.0, 1.0, 2.0]
    nearer = drives(robot, held=7.0, delay=2.9 * STEP)
    assert answers(nearer, efforts[:4]).tolist() == [7.0, 7.0, 7.0, 1.0]


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
    # And to what there is each way at a position.
    at = EffortRange(0, np.array([0.0, 1.0]), np.array([2.0, 4.0]), np.array([6.0, 8.0]))
    assert bounds(drives(with_motors(plain, effort_ranges=[at])), q=0.5) == [7.0, -3.0]


def test_what_rounding_takes_is_not_called_saturation(tmp_path):
    asked = np.array([[5.0 * (1 + 1e-13)], [5.0 * (1 + 1e-6)]])
    plants = drawn_plants(one_joint(tmp_path), Robustness.exact(), Draw(2))
    motors = Drives(one_joint(tmp_path), plants, np.zeros(1), STEP)
    _, is_cut = motors.bounded(asked, np.zeros((2, 1)), np.zeros((2, 1)))
    assert is_cut.tolist() == [[False], [True]]


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
