import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cases import INERTIA, PROBLEMS, SLIDE, one_joint, with_motors
from follower_arm import follower_arm
from tubeplanner import BasePose, OptionError, RobotError, load_problem, load_robot
from tubeplanner.problem.robustness import Robustness
from tubeplanner.simulation.mujoco_model import mujoco_arms
from tubeplanner.simulation.plant import Draw, drawn_plants

STEP = 2.5e-4
LEVER = 0.5  # [m]


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


@pytest.mark.parametrize("name", PROBLEMS)
def test_forward_dynamics_of_bundled_arms_are_pinocchios(name):
    robot = load_problem(f"example:{name}").robot
    limits = robot.limits
    low, high = np.maximum(limits.lower_position, -3), np.minimum(limits.upper_position, 3)
    assert_dynamics_agree(robot, low, high)


def test_and_of_an_arm_that_slides_with_motors_and_joints_in_another_order(tmp_path):
    (tmp_path / "slide.urdf").write_text(SLIDE)
    joints = ["lift", "turn", "extend"]
    robot = load_robot(tmp_path / "slide.urdf", "tip", joints=joints, gravity=(1, 2, -9))
    motors = {"armature": [0.3, 2.0, 1.0], "viscous_friction": [1.0, 2.0, 3.0]}
    assert_dynamics_agree(with_motors(robot, **motors), -0.9, 0.9)


def test_and_of_a_chest_with_two_arms(tmp_path):
    (tmp_path / "tree.urdf").write_text(tree())
    joints = ["turn", "right", "left", "wrist"]
    robot = load_robot(tmp_path / "tree.urdf", "hand", joints=joints, gravity=(1, 2, -9))
    assert_dynamics_agree(robot, -2, 2)


def test_and_of_two_arms_on_a_slope(tmp_path):
    (tmp_path / "tree.urdf").write_text(tree())
    base = BasePose((0.3, -0.2, 1.1), (0.4, -1.2, 2.5))
    robot = load_robot(tmp_path / "tree.urdf", "hand", base=base)
    assert_dynamics_agree(robot, -2, 2)
    level = load_robot(tmp_path / "tree.urdf", "hand")
    states = [exact_arm(arm).acceleration(np.zeros(3)) for arm in (robot, level)]
    assert abs(states[0] - states[1]).max() > 1


def test_every_plant_has_its_own_bodies_and_motors(tmp_path):
    robot = with_motors(one_joint(tmp_path, mass=2.0), viscous_friction=0.5)
    plants = drawn_plants(robot, Robustness.exact(mass=0.5, friction=0.5), Draw(3))
    arms = mujoco_arms(robot, plants, STEP)
    for arm in arms:
        arm.place(np.array([0.4]), np.array([2.0]))
    found = [arm.acceleration(np.array([1.5]))[0] for arm in arms]
    shares = np.array([plant.bodies[1].mass / 2.0 for plant in plants])
    friction = np.array([plant.motors.viscous_friction[0] * 2.0 for plant in plants])
    weight = shares * 2.0 * 9.81 * LEVER * np.cos(0.4)
    expected = (1.5 - weight - friction) / (shares * (INERTIA + 2.0 * LEVER**2))
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


def test_friction_differs_by_direction(tmp_path):
    robot = with_motors(one_joint(tmp_path), backwards_friction=1.0, forwards_friction=3.0)
    arm = exact_arm(robot)
    for way, friction in ((1.0, 3.0), (-1.0, -1.0)):
        arm.place(np.zeros(1), np.array([way]))
        found = arm.acceleration(np.array([0.5]))
        np.testing.assert_allclose(found, (0.5 - friction) / INERTIA, rtol=1e-6)


@pytest.mark.parametrize(("effort", "sticks"), [(2.9, True), (-0.9, True), (3.2, False)])
def test_friction_holds_a_joint_up_to_its_size(tmp_path, effort, sticks):
    robot = with_motors(one_joint(tmp_path), backwards_friction=1.0, forwards_friction=3.0)
    arm = exact_arm(robot)
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
    for share, expected in ((0.5, 0.5), (2.0, 1.0)):
        arm.place(upright, np.array([share * whole * STEP]))
        assert arm.acceleration(np.zeros(1)) == pytest.approx(-expected * whole, rel=1e-3)


def test_followers_are_refused_by_name(tmp_path):
    (tmp_path / "arm.urdf").write_text(follower_arm())
    robot = load_robot(tmp_path / "arm.urdf", "tip")
    plants = drawn_plants(robot, Robustness.exact(), Draw(1))
    with pytest.raises(RobotError, match=r"joint 'lift' has 1 that follow it \(<mimic>\); MuJoCo"):
        mujoco_arms(robot, plants, STEP)


def test_without_mujoco_it_is_said_how_to_get_it(tmp_path, monkeypatch):
    robot = one_joint(tmp_path)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(OptionError, match=r"pip install -e '\.\[simulate\]'"):
        mujoco_arms(robot, drawn_plants(robot, Robustness.exact(), Draw(1)), STEP)
