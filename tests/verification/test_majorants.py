"""Bounds on Taylor coefficients where a joint follows another: closed forms of uniform turns."""

from math import factorial

import numpy as np
import pytest

from cases import with_motors
from tubeplanner import JointTrajectory, load_robot
from tubeplanner.verification.enclosure import joint_bounds
from tubeplanner.verification.majorants import motor_majorant, rigid_body_majorant, tool_majorant

SPEED, WIDTH = 1e-3, 600.0  # slow: nothing but gravity counts
ORDERS = range(9)
GRAVITY = 9.81


def link(name, mass, x=0.0):
    inertia = '<inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/>'
    origin = f'<origin xyz="{x} 0 0"/>'
    return (
        f'<link name="{name}"><inertial>{origin}<mass value="{mass}"/>{inertia}</inertial></link>'
    )


def joint(name, kind, parent, child, mimic=""):
    axis = "0 0 1" if kind == "revolute" else "1 0 0"
    limit = '<limit lower="-9" upper="9" effort="99" velocity="9"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/>{limit}{mimic}</joint>'
    )


def mimic(master, multiplier, offset):
    return f'<mimic joint="{master}" multiplier="{multiplier}" offset="{offset}"/>'


@pytest.fixture
def load(tmp_path):
    """Return a function from links and joints to the arm up to `tip`, gravity along -y."""

    def of(*parts):
        path = tmp_path / "arm.urdf"
        path.write_text(f'<robot name="arm"><link name="base"/>{"".join(parts)}</robot>')
        return load_robot(path, "tip", gravity=(0, -GRAVITY, 0))

    return of


def bounds_of(robot, position, velocity):
    """Return bounds of the joints' coefficients while they move uniformly."""
    names = robot.joint_names
    coefficients = [[[velocity.get(name, 0.0) for name in names]]]
    coefficients += [[[position.get(name, 0.0) for name in names]]]
    trajectory = JointTrajectory(names, [0, WIDTH], coefficients)
    return joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([WIDTH]), 11)


@pytest.mark.parametrize("multiplier", [-3.0, 0.5])
def test_a_pendulum_that_follows_a_crank_loads_it_by_the_gear(load, multiplier):
    """Effort c m g l cos(c w t): the k-th coefficient is c m g l (c w T)^k / k!."""
    mass, lever = 0.5, 0.4
    robot = load(
        link("crank", 1e-9),
        link("tip", mass, lever),
        joint("master", "revolute", "base", "crank"),
        joint("follower", "revolute", "base", "tip", mimic("master", multiplier, 0.0)),
    )
    joints = bounds_of(robot, {}, {"master": SPEED})
    bound = rigid_body_majorant(robot, joints, np.array([WIDTH]))[:9, 0, 0]
    gear = abs(multiplier)
    expected = [
        gear * mass * GRAVITY * lever * (gear * SPEED * WIDTH) ** k / factorial(k) for k in ORDERS
    ]
    np.testing.assert_allclose(bound, expected, rtol=1e-3)


@pytest.mark.parametrize("offset", [0.5, -0.5])
@pytest.mark.parametrize("multiplier", [2.0, 0.5])
def test_a_slide_that_follows_another_carries_the_tool_round_a_circle(load, multiplier, offset):
    """Its radius is what the slide extends: r (w T)^k / k! is the k-th coefficient."""
    robot = load(
        link("cart", 1),
        link("arm", 1),
        link("tip", 1),
        joint("master", "prismatic", "base", "cart"),
        joint("turn", "revolute", "base", "arm"),
        joint("follower", "prismatic", "arm", "tip", mimic("master", multiplier, offset)),
    )
    at = 0.1 * np.sign(offset)
    joints = bounds_of(robot, {"master": at}, {"turn": SPEED})
    radius = multiplier * abs(at) + abs(offset)
    expected = [radius * (SPEED * WIDTH) ** k / factorial(k) for k in ORDERS]
    found = tool_majorant(robot, joints).position[1:9, 0]
    np.testing.assert_allclose(found, expected[1:], rtol=1e-12)


def test_rotors_and_viscous_friction_take_what_polynomials_do(slide):
    """Of q = c t^3, J q'' + d q' is 6 c J t + 3 c d t^2: nothing is estimated."""
    armature, viscous = np.array([[0.3, 0.5, 0.7], [2.0, 0.4, 0.0]])
    robot = with_motors(slide, armature=armature, viscous_friction=viscous)
    cubic, width = np.array([1.0, -2.0, 0.5]), np.array([0.5, 2.0])
    rows = np.zeros((4, 1, 3))
    rows[0, 0] = cubic
    trajectory = JointTrajectory(robot.joint_names, [0, 3.0], rows)
    joints = joint_bounds(trajectory, np.zeros(2, dtype=int), np.zeros(2), width, 6)
    found = motor_majorant(robot, joints, width)
    assert found.shape == (4, 2, 3)
    time = width[:, None]
    # On [0, T] each Taylor coefficient is the largest at T, where those of q' are 3, 6, 3 c T^2.
    speed = 3 * abs(cubic) * time**2
    expected = [2 * armature * speed / time + viscous * speed]
    expected += [2 * armature * speed / time + 2 * viscous * speed, viscous * speed, 0 * speed]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
