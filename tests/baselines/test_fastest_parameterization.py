"""What limits ask along a path, and how fast it is run then, against integrated phase planes."""

import numpy as np
import pytest
from cases import ANGLE, INERTIA, anywhere, one_joint, with_motors

from tubeplanner import JointTrajectory, load_robot
from tubeplanner.baselines.fastest_parameterization import fastest_parameterization
from tubeplanner.baselines.path_rows import path_rows, with_reversals
from tubeplanner.constraints.speed_limits import speed_limits
from tubeplanner.outcome import Infeasible
from tubeplanner.robot.effort_range import EffortRange

STRAIGHT = JointTrajectory(["turn"], [0, ANGLE], [[[1.0]], [[0.0]]])
# There and back to where it came from: it reverses at 0.75, between the points where all is judged.
BACK = JointTrajectory(["turn"], [0, 1.0], [[[-1.0]], [[1.5]], [[0.0]]])
FRICTION = {"viscous_friction": 1.0, "forwards_friction": 0.8, "backwards_friction": 0.3}
LINE = {"saturation_effort": 6.0, "no_load_velocity": 3.0}


def least_time(forwards, backwards, length=ANGLE, steps=8000):
    """Return the time from rest to rest of a joint with accelerations by velocity and way.

    The phase plane, integrated from both ends by Heun's method: x = v^2, dx/ds = 2 a(v, s).
    """
    step = length / steps

    def squares(acceleration):
        x = np.zeros(steps + 1)
        for k in range(steps):
            slope = 2 * acceleration(np.sqrt(x[k]), k * step)
            ahead = np.sqrt(max(x[k] + step * slope, 0))
            x[k + 1] = x[k] + step / 2 * (slope + 2 * acceleration(ahead, (k + 1) * step))
        return x

    speed = np.sqrt(np.minimum(squares(forwards), squares(backwards)[::-1]))
    return (2 * step / (speed[1:] + speed[:-1])).sum()


@pytest.mark.parametrize(
    ("motors", "forwards", "backwards", "at_both_ends"),
    [
        ({"armature": 0.4}, lambda v: 5 / 1.1, lambda v: 5 / 1.1, True),
        (FRICTION, lambda v: (4.2 - v) / INERTIA, lambda v: (5.8 + v) / INERTIA, False),
        (LINE, lambda v: min(5, 6 - 2 * v) / INERTIA, lambda v: min(5, 6 + 2 * v) / INERTIA, True),
        (
            FRICTION | LINE | {"friction_uncertainty": 0.5},
            lambda v: (min(5, 6 - 2 * v) - 1.2 - 1.5 * v) / INERTIA,
            lambda v: (5 + 0.4 + 0.5 * v) / INERTIA,
            True,
        ),
    ],
    ids=["rotor", "friction", "torque-speed line", "all, friction uncertain"],
)
def test_one_joint_takes_what_its_phase_plane_says(
    motors, forwards, backwards, at_both_ends, tmp_path
):
    robot = with_motors(one_joint(tmp_path, velocity=np.inf), **motors)
    timing = fastest_parameterization(
        anywhere(robot), STRAIGHT, np.linspace(0, ANGLE, 1601), at_both_ends=at_both_ends
    )
    expected = least_time(lambda v, _: forwards(v), lambda v, _: backwards(v))
    assert timing.duration == pytest.approx(expected, rel=1e-3)


def test_a_motor_that_can_hardly_lift_its_load_creeps_over_the_top(tmp_path):
    """Tangents at what an ideal motor would do there leave it nothing: others must be found."""
    mass, line = 1.1, {"saturation_effort": 6.0, "no_load_velocity": 1.0}
    robot = with_motors(one_joint(tmp_path, mass, velocity=np.inf, effort=50.0), **line)
    path = JointTrajectory(["turn"], [0, 2 * ANGLE], [[[1.0]], [[-ANGLE]]])
    grid = np.linspace(0, 2 * ANGLE, 1601)
    timing = fastest_parameterization(anywhere(robot), path, grid)
    inertia = INERTIA + mass * 0.5**2

    def load(s):
        return mass * 9.81 * 0.5 * np.cos(s - ANGLE)

    expected = least_time(
        lambda v, s: (min(50, 6 * (1 - v)) - load(s)) / inertia,
        lambda v, s: (min(50, 6 * (1 + v)) + load(s)) / inertia,
        2 * ANGLE,
    )
    assert expected > 10
    assert timing.duration == pytest.approx(expected, rel=2e-3)


def test_what_is_found_keeps_the_limits_themselves_and_not_their_tangents(tmp_path):
    robot = with_motors(one_joint(tmp_path, velocity=np.inf), **(FRICTION | LINE))
    problem, grid = anywhere(robot), np.linspace(0, ANGLE, 401)
    limits = tuple(limit for limit in speed_limits(problem) if limit.order == 2)
    begin, _ = path_rows(problem, STRAIGHT, grid, limits)
    timing = fastest_parameterization(problem, STRAIGHT, grid, at_both_ends=False)
    speed = timing.velocity(timing.breakpoints[:-1])
    acceleration = 2 * timing.coefficients[0]
    used = begin.acceleration * acceleration + begin.square * speed**2 + begin.speed * speed
    most = (used - begin.allowed).max(axis=1)
    assert most.max() < 1e-6
    assert (most < -1e-4).sum() <= 1  # every step takes all that there is, but that which switches


def test_an_effort_by_direction_speeds_up_and_slows_down_differently(tmp_path):
    ranges = [EffortRange(0, np.zeros(1), np.array([2.0]), np.array([5.0]))]
    robot = with_motors(one_joint(tmp_path, velocity=np.inf), effort_ranges=ranges)
    timing = fastest_parameterization(anywhere(robot), STRAIGHT, np.linspace(0, ANGLE, 801))
    expected = np.sqrt(2 * ANGLE * INERTIA * (1 / 5 + 1 / 2))  # v^2 / (2 a) on either side
    assert timing.duration == pytest.approx(expected, rel=1e-3)


def test_an_effort_by_position_is_that_of_each_place(tmp_path):
    """Efforts that fall linearly: the kinetic energy is what they worked, 5 q - q^2."""
    table = EffortRange(0, np.array([0.0, 2.0]), np.array([5.0, 1.0]), np.array([5.0, 1.0]))
    robot = with_motors(one_joint(tmp_path, velocity=np.inf), effort_ranges=[table])
    timing = fastest_parameterization(anywhere(robot), STRAIGHT, np.linspace(0, ANGLE, 1601))
    q = np.linspace(0, ANGLE, 200001)
    work = 5 * q - q**2
    energy = np.minimum(work, work[-1] - work)
    speed = np.sqrt(2 * energy / INERTIA)
    expected = (2 * np.diff(q) / (speed[1:] + speed[:-1])).sum()
    assert timing.duration == pytest.approx(expected, rel=1e-3)


def test_points_are_added_where_joints_reverse():
    apart = with_reversals(BACK, np.linspace(0, 1, 5), 1e-3)
    np.testing.assert_allclose(apart, [0, 0.25, 0.5, 0.75, 1.0])  # one of them is there already
    apart = with_reversals(BACK, np.linspace(0, 1, 4), 1e-3)
    np.testing.assert_allclose(apart, [0, 1 / 3, 2 / 3, 0.75, 1.0])
    assert len(with_reversals(BACK, np.linspace(0, 1, 4), 0.1)) == 4


def test_steps_have_the_friction_of_their_own_direction(tmp_path):
    """Before and after the reversal, whatever the velocity is at the ends of the steps."""
    robot = with_motors(one_joint(tmp_path), forwards_friction=0.8, backwards_friction=0.3)
    problem = anywhere(robot)
    limits = tuple(limit for limit in speed_limits(problem) if limit.kind == "effort")
    rows = path_rows(problem, BACK, np.array([0.0, 0.75, 1.0]), limits)
    for each in rows:
        allowed = np.array([[5 - 0.8, 5 + 0.8], [5 + 0.3, 5 - 0.3]]) / 5
        np.testing.assert_allclose(each.allowed, allowed)
    begin, end = rows
    np.testing.assert_allclose(begin.acceleration[:, 0] * 5 / INERTIA, [1.5, 0.0], atol=1e-12)
    np.testing.assert_allclose(end.acceleration[:, 0] * 5 / INERTIA, [0.0, -0.5], atol=1e-12)
    np.testing.assert_allclose(begin.square[:, 0] * 5 / INERTIA, -2.0)


def test_where_a_path_begins_to_bend_steps_have_the_bend_of_their_own_side(tmp_path):
    robot = with_motors(one_joint(tmp_path))
    problem = anywhere(robot)
    limits = tuple(limit for limit in speed_limits(problem) if limit.kind == "effort")
    bends = [[[0.0], [1.0]], [[1.0], [1.0]], [[0.0], [0.5]]]  # s, and from 0.5 on s + (s - 0.5)^2
    path = JointTrajectory(["turn"], [0, 0.5, 1.0], bends)
    for each in path_rows(problem, path, np.array([0.0, 0.5, 1.0]), limits):
        np.testing.assert_allclose(each.square[:, 0] * 5 / INERTIA, [0.0, 2.0], atol=1e-12)


def test_tangents_cost_no_less_than_the_root(tmp_path):
    robot = with_motors(one_joint(tmp_path, velocity=np.inf), **FRICTION, **LINE)
    problem = anywhere(robot)
    begin, _ = path_rows(problem, STRAIGHT, np.array([0.0, 1.0]), speed_limits(problem)[:2])
    touches, x = 2.3, np.linspace(0, 9, 50)
    tangent = begin.tangent(np.array([touches]))
    used = begin.square[0] * x[:, None] + begin.speed[0] * np.sqrt(x)[:, None] - begin.allowed[0]
    bound = tangent.square[0] * x[:, None] - tangent.allowed[0]
    costs = begin.speed[0] > 0
    assert costs.any()
    assert (~costs).any()
    assert (bound >= used - 1e-12)[:, costs].all()
    at_touch = tangent.square[0] * touches - tangent.allowed[0]
    exact = begin.square[0] * touches + begin.speed[0] * np.sqrt(touches) - begin.allowed[0]
    np.testing.assert_allclose(at_touch, exact)
    assert not tangent.speed.any()


def test_an_arm_that_friction_stops_is_refused(tmp_path):
    robot = with_motors(one_joint(tmp_path), forwards_friction=5.5)
    with pytest.raises(Infeasible, match=r"needs 5\.50 N m against gravity and friction"):
        fastest_parameterization(anywhere(robot), STRAIGHT, np.linspace(0, ANGLE, 11))


@pytest.mark.parametrize("velocity", [0.0, -1e-17])
def test_what_rounding_makes_of_standing_still_has_no_friction(tmp_path, velocity):
    """A joint that gravity and friction together would stop, and that does not move."""
    (tmp_path / "arm.urdf").write_text(ARM)
    free = load_robot("arm.urdf", "tip", directory=tmp_path, gravity=(0, 0, -9.81))
    held = float(abs(free.gravity_effort(np.zeros((1, 2)))[0, 1]))
    friction = np.array([0.0, free.limits.effort[1] - held / 2])
    robot = with_motors(free, forwards_friction=friction, backwards_friction=friction)
    row = np.array([1.0, velocity])
    path = JointTrajectory(robot.joint_names, [0, 1.0], [[row], [np.zeros(2)]])
    timing = fastest_parameterization(anywhere(robot), path, np.linspace(0, 1, 101))
    assert timing.duration > 0


ARM = """<robot name="arm"><link name="base"/>
<link name="post"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="post"/><axis xyz="0 0 1"/>
  <limit lower="-3" upper="3" effort="50" velocity="3"/></joint>
<joint name="lift" type="revolute"><parent link="post"/><child link="tip"/><axis xyz="0 1 0"/>
  <limit lower="-3" upper="3" effort="20" velocity="3"/></joint></robot>"""
