"""Majorants and enclosures of tool pose and joint efforts, for all t."""

from math import factorial

import numpy as np
import pytest
from cases import SLIDE, one_joint, with_motors

from tubeplanner import JointTrajectory, load_robot
from tubeplanner.robot.effort_rate import effort_rate
from tubeplanner.verification.enclosed_efforts import (
    effort_terms,
    enclosed_effort_rates,
    enclosed_efforts,
)
from tubeplanner.verification.enclosure import joint_bounds
from tubeplanner.verification.majorants import motor_majorant, rigid_body_majorant, tool_majorant

# Bounds on Taylor coefficients where a joint follows another: closed forms of uniform turns.


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


# The terms of the effort law: all of them, each what its bound is made for.


@pytest.fixture(params=["rigid", "motors"])
def efforts_arm(request, robot):
    """Arms without and with rotors and viscous friction."""
    if request.param == "rigid":
        return robot
    amounts = np.random.default_rng(1).uniform(0.1, 2.0, (3, robot.joint_count))
    return with_motors(
        robot, armature=amounts[0], viscous_friction=amounts[1], forwards_friction=amounts[2]
    )


@pytest.fixture
def states(robot):
    """Random positions, velocities and accelerations, each (20, n)."""
    return np.random.default_rng(0).uniform(-2, 2, (3, 20, robot.joint_count))


def test_the_terms_add_up_to_what_the_planners_limit(efforts_arm, states):
    terms = effort_terms(efforts_arm).values()
    efforts = sum(term.values(*states[: term.derivatives + 1]) for term in terms)
    np.testing.assert_allclose(
        efforts, efforts_arm.inverse_dynamics(*states), rtol=1e-12, atol=1e-12
    )


def test_friction_of_the_urdf_is_not_in_it_unasked(tmp_path):
    """What rigid bodies need is the same whichever way they move; its bound counts on that."""
    dynamics = '<dynamics damping="3" friction="2"/><limit'
    path = tmp_path / "with_friction.urdf"
    path.write_text(SLIDE.replace("<limit", dynamics))
    robot = load_robot(path, "tip")
    q, v, a = np.random.default_rng(0).uniform(-2, 2, (3, 20, robot.joint_count))
    values = effort_terms(robot)["rigid bodies and motors"].values
    np.testing.assert_allclose(values(q, -v, a), values(q, v, a), rtol=1e-9, atol=1e-9)


def test_what_rotors_and_friction_take_is_missed_by_no_more_than_the_error(tmp_path):
    """A polynomial of a degree that interpolation misses, of a joint with hardly any inertia."""
    motors = {"armature": 400.0, "viscous_friction": 3000.0}
    robot = with_motors(one_joint(tmp_path), **motors)
    rows = np.random.default_rng(2).uniform(-1, 1, (13, 1, 1))
    trajectory = JointTrajectory(["turn"], [0, 1.0], rows)
    efforts = enclosed_efforts(robot, trajectory, np.array([1e-3]))
    interval = np.repeat(np.arange(len(efforts.width)), 101)
    u = np.tile(np.linspace(0, 1, 101), len(efforts.width))
    at = trajectory.at(efforts.start[interval] + u * efforts.width[interval])
    expected = robot.inverse_dynamics(at.position, at.velocity, at.acceleration)
    missed = abs(efforts.within(interval, u) - expected)
    assert (missed <= efforts.error[interval] + 1e-9).all()
    assert missed.max() > 1e-6


def test_enclosed_rates_are_those_that_the_planners_limit(efforts_arm):
    """On either side of breakpoints at which the jerk jumps, and in between."""
    n = efforts_arm.joint_count
    coefficients = np.random.default_rng(3).uniform(-1, 1, (4, 3, n))
    coefficients *= np.array([400.0, 30.0, 2.0, 1.5])[:, None, None]
    trajectory = JointTrajectory(efforts_arm.joint_names, [0, 0.05, 0.08, 0.2], coefficients)
    rates = enclosed_effort_rates(efforts_arm, trajectory, np.full(n, 1e-4))
    assert rates.error.max() <= 1e-4
    interval = np.repeat(np.arange(len(rates.width)), 9)
    u = np.tile(np.linspace(0, 1, 9), len(rates.width))
    piece = np.searchsorted(trajectory.breakpoints, rates.start + 1e-9)[interval] - 1
    local = rates.start[interval] + u * rates.width[interval] - trajectory.breakpoints[piece]
    expected = effort_rate(efforts_arm, *(trajectory.within(piece, local, k) for k in range(4)))
    np.testing.assert_allclose(rates.within(interval, u), expected, atol=1.01e-4)
