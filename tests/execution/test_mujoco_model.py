"""The rigid arm in MuJoCo: bodies, joints, friction."""

import os
import sys
from contextlib import closing

import numpy as np
import pytest
from arms import follower_arm
from cases import INERTIA, SLIDE, one_joint, with_motors
from scipy.integrate import solve_ivp

from tubeplanner import BasePose, OptionError, RobotError, load_robot
from tubeplanner.execution.mujoco_model import ArmsTogether, mujoco_arms
from tubeplanner.execution.plants import Draw, drawn_plants
from tubeplanner.task.demands import Robustness

STEP = 2.5e-4
LEVER = 0.5  # [m]


@pytest.fixture
def slide(tmp_path):
    (tmp_path / "slide.urdf").write_text(SLIDE)
    return load_robot(tmp_path / "slide.urdf", "tip", joints=["lift", "turn", "extend"])


def tree():
    """A chest that turns, an arm to the right, and one to the left that has a wrist."""
    links = "".join(
        f"""<link name="{name}"><inertial><origin xyz="0.1 0.05 {0.1 * mass}"/>
        <mass value="{mass}"/>
        <inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0.01" ixz="0" iyz="0"/></inertial></link>"""
        for mass, name in enumerate(["chest", "shoulder", "elbow", "hand"], start=1)
    )
    hung = [("turn", "base", "chest"), ("right", "chest", "shoulder"), ("left", "chest", "elbow")]
    joints = "".join(
        f"""<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
        <origin xyz="0.2 0.1 0.3" rpy="0.3 -0.5 0.7"/><axis xyz="0.6 0 0.8"/>
        <limit lower="-3" upper="3" effort="9" velocity="3"/></joint>"""
        for name, parent, child in [*hung, ("wrist", "elbow", "hand")]
    )
    return f'<robot name="tree"><link name="base"/>{links}{joints}</robot>'


def exact_arm(robot):
    return mujoco_arms(robot, drawn_plants(robot, Robustness.exact(), Draw(1)), STEP)[0]


def assert_dynamics_agree(robot, low, high):
    """Forward dynamics are what Pinocchio's inverse dynamics and mass matrix ask."""
    arm, count, random = exact_arm(robot), robot.joint_count, np.random.default_rng(4)
    still = np.zeros((1, count))
    for _ in range(10):
        q, v = random.uniform(low, high, (1, count)), random.uniform(-2, 2, (1, count))
        effort = random.uniform(-1, 1, count) * np.minimum(robot.limits.effort, 100)
        arm.place(q[0], v[0])
        found = arm.acceleration(effort)
        columns = [robot.inverse_dynamics(q, still, unit[None])[0] for unit in np.eye(count)]
        mass_matrix = np.transpose(columns - robot.gravity_effort(q))
        expected = np.linalg.solve(mass_matrix, effort - robot.inverse_dynamics(q, v, still)[0])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * abs(expected).max())


@pytest.mark.parametrize("name", ["ur10/onto_a_conveyor", "panda/between_shelves"])
def test_forward_dynamics_of_bundled_arms_are_pinocchios(name, bundled):
    robot = bundled(name).robot
    limits = robot.limits
    low, high = np.maximum(limits.lower_position, -3), np.minimum(limits.upper_position, 3)
    assert_dynamics_agree(robot, low, high)


def test_and_of_an_arm_that_slides_with_motors_and_joints_in_another_order(slide):
    robot = load_robot(slide.urdf.path, "tip", joints=slide.joint_names, gravity=(1, 2, -9))
    motors = {"armature": [0.3, 2.0, 1.0], "viscous_friction": [1.0, 2.0, 3.0]}
    assert_dynamics_agree(with_motors(robot, **motors), -0.9, 0.9)


def test_and_of_a_chest_with_two_arms_on_a_slope(tmp_path):
    path = tmp_path / "tree.urdf"
    path.write_text(tree())
    joints = ["turn", "right", "left", "wrist"]
    assert_dynamics_agree(load_robot(path, "hand", joints=joints, gravity=(1, 2, -9)), -2, 2)
    sloped = load_robot(path, "hand", base=BasePose((0.3, -0.2, 1.1), (0.4, -1.2, 2.5)))
    assert_dynamics_agree(sloped, -2, 2)
    level = load_robot(path, "hand")
    states = [exact_arm(arm).acceleration(np.zeros(3)) for arm in (sloped, level)]
    assert abs(states[0] - states[1]).max() > 1


def test_every_plant_has_its_own_bodies_and_motors(tmp_path):
    robot = with_motors(one_joint(tmp_path, mass=2.0), viscous_friction=0.5)
    plants = drawn_plants(robot, Robustness.exact(mass=0.5, friction=0.5), Draw(3))
    arms = mujoco_arms(robot, plants, STEP)
    for arm in arms:
        arm.place(np.array([0.4]), np.array([2.0]))
    found = [arm.acceleration(np.array([1.5]))[0] for arm in arms]
    fractions = np.array([plant.bodies[1].mass / 2.0 for plant in plants])
    friction = np.array([plant.motors.viscous_friction[0] * 2.0 for plant in plants])
    weight = fractions * 2.0 * 9.81 * LEVER * np.cos(0.4)
    expected = (1.5 - weight - friction) / (fractions * (INERTIA + 2.0 * LEVER**2))
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert np.ptp(found) > 0.1


def test_a_swing_is_that_of_the_differential_equation(tmp_path):
    robot = with_motors(one_joint(tmp_path, mass=2.0), armature=0.2, viscous_friction=0.5)
    inertia, effort = INERTIA + 2.0 * LEVER**2 + 0.2, 1.5

    def rates(_, state):
        weight = 2.0 * 9.81 * LEVER * np.cos(state[0])
        return [state[1], (effort - weight - 0.5 * state[1]) / inertia]

    arm = exact_arm(robot)
    arm.place(np.array([0.4]), np.array([-1.0]))
    for _ in range(2000):
        arm.step(np.array([effort]))
    expected = solve_ivp(rates, (0, 2000 * STEP), [0.4, -1.0], rtol=1e-12, atol=1e-12).y[:, -1]
    np.testing.assert_allclose([*arm.position, *arm.velocity], expected, atol=1e-9)


@pytest.mark.parametrize(("effort", "sticks"), [(2.9, True), (-0.9, True), (3.2, False)])
def test_friction_differs_by_direction_and_holds_a_joint_up_to_its_size(tmp_path, effort, sticks):
    robot = with_motors(one_joint(tmp_path), backwards_friction=1.0, forwards_friction=3.0)
    arm = exact_arm(robot)
    for way, friction in ((1.0, 3.0), (-1.0, -1.0)):
        arm.place(np.zeros(1), np.array([way]))
        rate = arm.acceleration(np.array([0.5]))
        np.testing.assert_allclose(rate, (0.5 - friction) / INERTIA, rtol=1e-6)
    arm.place(np.zeros(1), np.zeros(1))
    for _ in range(4000):
        arm.step(np.array([effort]))
    assert (abs(arm.position[0]) < 1e-3) == sticks


def test_friction_creeps_at_rest_and_is_whole_from_one_step_of_it_on(tmp_path):
    """Of a heavy bar that stands upright: rest, half that velocity and twice it."""
    friction = {"backwards_friction": 3.0, "forwards_friction": 3.0}
    robot = with_motors(one_joint(tmp_path, mass=20.0), armature=0.3, **friction)
    arm = exact_arm(robot)
    inertia, upright = INERTIA + 20.0 * LEVER**2 + 0.3, np.array([np.pi / 2])
    whole = 3.0 / inertia
    arm.place(upright, np.zeros(1))
    assert arm.acceleration(np.array([2.0])) == pytest.approx(1e-4 * 2.0 / inertia, rel=1e-6)
    for fraction, expected in ((0.5, 0.5), (2.0, 1.0)):
        arm.place(upright, np.array([fraction * whole * STEP]))
        assert arm.acceleration(np.zeros(1)) == pytest.approx(-expected * whole, rel=1e-3)


def test_followers_are_refused_by_name_and_mujoco_is_needed(tmp_path, monkeypatch):
    (tmp_path / "arm.urdf").write_text(follower_arm())
    robot = load_robot(tmp_path / "arm.urdf", "tip")
    plants = drawn_plants(robot, Robustness.exact(), Draw(1))
    with pytest.raises(RobotError, match=r"joint 'lift' has 1 that follow it \(<mimic>\); MuJoCo"):
        mujoco_arms(robot, plants, STEP)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(OptionError, match=r"pip install -e '\.\[simulate\]'"):
        mujoco_arms(robot, plants, STEP)


STEPS, PERIODS = 4, 100


def wrong_arms(robot, runs=5):
    """Arms in states of their own, and efforts for them, (PERIODS, STEPS, R, n)."""
    random = np.random.default_rng(3)
    arms = mujoco_arms(robot, drawn_plants(robot, Robustness(), Draw(runs)), STEP)
    for arm in arms:
        arm.place(*random.uniform(-0.5, 0.5, (2, robot.joint_count)))
    most = np.minimum(robot.limits.effort, 30.0)
    return arms, most * random.uniform(-1, 1, (PERIODS, STEPS, runs, robot.joint_count))


def alone(robot):
    arms, effort = wrong_arms(robot)
    for given in effort.reshape(-1, len(arms), robot.joint_count):
        for arm, own in zip(arms, given, strict=True):
            arm.step(own)
    return np.array([[arm.position, arm.velocity] for arm in arms])


def together(robot):
    arms, effort = wrong_arms(robot)
    with closing(ArmsTogether(arms)) as moved:
        for given in effort:
            moved.move(given, np.arange(len(arms)))
        return np.stack([moved.position, moved.velocity], axis=1)


def test_without_friction_they_move_as_each_alone_to_the_last_bit(slide):
    """Joints may be in another order than on the arm."""
    np.testing.assert_array_equal(together(slide), alone(slide))


def test_with_friction_they_differ_by_rounding_whatever_the_number_of_processors(
    slide, monkeypatch
):
    rubbing = with_motors(slide, backwards_friction=1.0, forwards_friction=3.0)
    moved, expected = together(rubbing), alone(rubbing)
    np.testing.assert_allclose(moved, expected, rtol=0, atol=1e-12)
    assert abs(moved - alone(slide)).max() > 1e-3
    for processors in (1, 3, None):
        monkeypatch.setattr(os, "cpu_count", lambda count=processors: count)
        np.testing.assert_array_equal(together(rubbing), moved)


def test_only_those_move_that_are_to(tmp_path):
    robot = one_joint(tmp_path)
    arms, effort = wrong_arms(robot)
    before = np.array([arm.position for arm in arms])
    with closing(ArmsTogether(arms)) as moved:
        np.testing.assert_array_equal(moved.position, before)
        moved.move(effort[0], np.array([], dtype=int))
        np.testing.assert_array_equal(moved.position, before)
        moved.move(effort[0], np.array([1, 3]))
        assert ((moved.position != before)[:, 0] == [False, True, False, True, False]).all()
    for own in effort[0, :, 3]:
        arms[3].step(own)
    np.testing.assert_array_equal(moved.position[3], arms[3].position)


def test_they_go_on_as_others_where_they_are(slide):
    """Half of the way each; alone the state is carried over by hand."""
    others = with_motors(slide, backwards_friction=0.0, forwards_friction=0.0, armature=0.5)
    runs, effort = 3, np.ones((1, 3, 3))
    first, second = (
        mujoco_arms(robot, drawn_plants(robot, Robustness(), Draw(runs, seed)), STEP)
        for robot, seed in ((slide, 0), (others, 1))
    )
    with closing(ArmsTogether(first)) as moved:
        moved.move(effort, np.arange(runs))
        moved.become(second)
        for arm, *state in zip(second, moved.position, moved.velocity, strict=True):
            arm.place(*state)
            arm.step(effort[0, 0])
        moved.move(effort, np.arange(runs))
        np.testing.assert_array_equal(moved.position, [arm.position for arm in second])
        np.testing.assert_array_equal(moved.velocity, [arm.velocity for arm in second])
