"""What is claimed for all t of tool, pose and efforts: majorants and enclosures.

Against closed forms, dense evaluation and numerical derivatives.
"""

from math import factorial

import numpy as np
import pytest
from arms import follower_arm
from cases import one_joint, with_motors
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebpts1

from tubeplanner import JointTrajectory, Payload, Tube, load_robot
from tubeplanner.certificate.enclosed_quantities import (
    derivative,
    effort_terms,
    enclosed_effort_rates,
    enclosed_efforts,
    enclosed_pose,
    enclosed_tool,
    motor_majorant,
    rigid_body_majorant,
    tool_majorant,
)
from tubeplanner.certificate.enclosure import Quantity, enclosed, enclosed_rate, joint_bounds
from tubeplanner.robot.model import effort_rate

TUBE = Tube([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 1.0)


@pytest.fixture(scope="module", params=["two_link", "ur5", "ur10", "panda", "slide", "followers"])
def arm(request, tmp_path_factory):
    if request.param == "ur10":
        return load_robot("example:ur10", "tool0", payload=Payload(8.0, (0.1, 0, 0.2)))
    if request.param == "followers":
        path = tmp_path_factory.mktemp("followers") / "followers.urdf"
        path.write_text(follower_arm())
        return load_robot(path, "tip")
    return request.getfixturevalue(request.param)


def random_trajectory(robot, seed, degree=5, pieces=3, width=0.1):
    """Return polynomials as fast as arms move, with jumps between the pieces."""
    rng = np.random.default_rng(seed)
    scale = np.array([60.0, 30.0, 20.0, 8.0, 2.0, 1.5])[-1 - degree :, None, None]
    rows = scale * rng.uniform(-1, 1, (degree + 1, pieces, robot.joint_count))
    return JointTrajectory(robot.joint_names, width * np.arange(pieces + 1), rows)


def bounds_of(trajectory):
    """Return bounds of the joints' Taylor coefficients over a trajectory of one piece."""
    return joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([trajectory.duration]), 11)


def effort_bounds(robot, trajectory):
    """Return bounds of the efforts' Taylor coefficients, (9, n)."""
    width = np.array([trajectory.duration])
    return rigid_body_majorant(robot, bounds_of(trajectory), width)[:9, 0]


# Closed forms of uniform turns: the k-th derivative of a point on a circle has the length r w^k.


GRAVITY, LEVER = 9.81, 0.4
SLOW, LONG = 1e-3, 600.0  # speed and duration at which nothing but gravity counts


def link(name, mass=1.0, x=0.0, inertia=(1e-9, 1e-9, 1e-9)):
    terms = "ixx='{}' iyy='{}' izz='{}' ixy='0' ixz='0' iyz='0'".format(*inertia)
    return (
        f'<link name="{name}"><inertial><origin xyz="{x} 0 0"/><mass value="{mass}"/>'
        f"<inertia {terms}/></inertial></link>"
    )


def joint(name, kind, parent, child, axis="0 0 1", x=0.0, mimic=None):
    follows = ""
    if mimic:
        follows = '<mimic joint="{}" multiplier="{}" offset="{}"/>'.format(*mimic)
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="{axis}"/>'
        f'<limit lower="-9" upper="9" effort="99" velocity="9"/>{follows}</joint>'
    )


@pytest.fixture
def load(tmp_path):
    """Return a function from links and joints to the arm up to `tip`, gravity along -y."""

    def of(*parts, gravity=GRAVITY):
        path = tmp_path / "arm.urdf"
        path.write_text(f'<robot name="arm"><link name="base"/>{"".join(parts)}</robot>')
        return load_robot(path, "tip", gravity=(0, -gravity, 0))

    return of


@pytest.fixture
def bar(load):
    """Return a function from a kind of joint to a bar whose tool is on a lever, weightless."""

    def of(kind="revolute"):
        return load(
            link("bar", 2.0, inertia=(1, 1, 0.7)),
            link("tip", 0.0),
            joint("move", kind, "base", "bar"),
            joint("end", "fixed", "bar", "tip", x=LEVER),
            gravity=0.0,
        )

    return of


def uniform(robot, velocity, width, position=None):
    """Return joints that move at constant velocities, by name."""
    rows = [
        [values.get(n, 0.0) for n in robot.joint_names] for values in (velocity, position or {})
    ]
    return JointTrajectory(robot.joint_names, [0, width], np.array(rows)[:, None])


def powers(rate, count=9):
    """Return the Taylor coefficients of a uniform turn by an angle, in units of its radius."""
    return np.array([rate**k / factorial(k) for k in range(count)])


def test_what_is_said_of_a_uniform_turn_is_exact(bar):
    """Tool and axes go round in circles: errors of order 8, speeds and accelerations."""
    robot, speed, width = bar(), 3.0, 0.5
    trajectory = uniform(robot, {"move": speed}, width)
    bound = tool_majorant(robot, bounds_of(trajectory)).position[1:9, 0]
    np.testing.assert_allclose(bound, LEVER * powers(width * speed)[1:], rtol=1e-12)
    error = 2 / 4**8 * powers(width * speed)[8]
    tool = enclosed_tool(robot, TUBE, trajectory, 1.0)
    pose = enclosed_pose(robot, TUBE, trajectory, 1.0, 1.0)
    np.testing.assert_allclose(tool.error, [[LEVER * error] * 3], rtol=1e-12)
    np.testing.assert_allclose(pose.tool.error, [[LEVER * error] * 3], rtol=1e-12)
    np.testing.assert_allclose(pose.rotation.error, [[error] * 9], rtol=1e-12)
    np.testing.assert_allclose(pose.speed, LEVER * speed)
    np.testing.assert_allclose(pose.acceleration, LEVER * speed**2)
    np.testing.assert_allclose(pose.spin, speed)
    np.testing.assert_allclose(pose.spin_rate, 0.0)


def test_spin_that_grows_is_bounded_by_its_growth(bar):
    """Angle c t^2: the tool's axis spins up by 2 c."""
    trajectory = JointTrajectory(["move"], [0, 0.5], [[[1.5]], [[0.0]], [[0.0]]])
    pose = enclosed_pose(bar(), TUBE, trajectory, 1.0, 1.0)
    np.testing.assert_allclose(pose.spin_rate, 3.0)
    np.testing.assert_allclose(pose.spin, 1.5)


@pytest.mark.parametrize(("kind", "inertia"), [("prismatic", 2.0), ("revolute", 0.7)])
def test_the_bound_is_near_for_a_joint_that_speeds_up(bar, kind, inertia):
    """Effort is inertia times acceleration, 2 + 6 c t; the bound takes the largest moment."""
    trajectory = JointTrajectory(["move"], [0, 0.1], [[[5.0]], [[1.0]], [[0.0]], [[0.0]]])
    bound = effort_bounds(bar(kind), trajectory)[:, 0]
    exact = inertia * np.array([2 + 30 * 0.1, 30 * 0.1])
    if kind == "prismatic":
        np.testing.assert_allclose(bound[:2], exact, rtol=1e-12)
        np.testing.assert_allclose(bound[2:], 0, atol=1e-12)
    else:
        assert (bound[:2] >= exact).all()
        assert (bound[:2] < 2.5 * exact).all()


@pytest.mark.parametrize("gear", [None, -3.0, 0.5])
def test_a_slow_pendulums_bound_is_its_gravity(load, gear):
    """Effort c m g l cos(c w t), where it follows a crank with a gear c."""
    mass, crank = 0.5, [link("crank", 1e-9), joint("master", "revolute", "base", "crank")]
    mimic = ("master", gear, 0.0) if gear else None
    swing = joint("follower" if gear else "master", "revolute", "base", "tip", mimic=mimic)
    robot = load(*(crank if gear else []), link("tip", mass, LEVER), swing)
    trajectory = uniform(robot, {"master": SLOW}, LONG)
    c = abs(gear or 1.0)
    expected = c * mass * GRAVITY * LEVER * powers(c * SLOW * LONG)
    np.testing.assert_allclose(effort_bounds(robot, trajectory)[:, 0], expected, rtol=1e-3)
    efforts = enclosed_efforts(robot, trajectory, np.ones(1))
    np.testing.assert_allclose(efforts.error, [[2 / 4**8 * expected[8]]], rtol=1e-3)


def test_a_slow_slides_bound_is_its_gravity(load):
    """It turns uniformly with what carries it: its force is m g cos(w t)."""
    robot = load(
        link("rail", 1e-9),
        link("tip", 2.0),
        joint("turn", "revolute", "base", "rail"),
        joint("slide", "prismatic", "rail", "tip", "0 1 0"),
    )
    trajectory = uniform(robot, {"turn": SLOW}, LONG, {"slide": 0.1})
    expected = 2 * GRAVITY * powers(SLOW * LONG)
    np.testing.assert_allclose(effort_bounds(robot, trajectory)[:, 1], expected, rtol=1e-3)


@pytest.mark.parametrize(("multiplier", "offset"), [(2.0, 0.5), (0.5, -0.5)])
def test_a_slide_that_follows_another_carries_the_tool_round_a_circle(load, multiplier, offset):
    """Its radius is what the slide extends."""
    robot = load(
        *(link(name) for name in ("cart", "arm", "tip")),
        joint("master", "prismatic", "base", "cart", "1 0 0"),
        joint("turn", "revolute", "base", "arm"),
        joint("follower", "prismatic", "arm", "tip", "1 0 0", mimic=("master", multiplier, offset)),
    )
    at = 0.1 * np.sign(offset)
    joints = bounds_of(uniform(robot, {"turn": SLOW}, LONG, {"master": at}))
    expected = (multiplier * abs(at) + abs(offset)) * powers(SLOW * LONG)
    found = tool_majorant(robot, joints).position[1:9, 0]
    np.testing.assert_allclose(found, expected[1:], rtol=1e-12)


def test_the_bound_on_spin_is_exact_for_an_axis_that_turns_uniformly(load):
    """Angular velocity p x + w z(t), where z is tilted at p: its k-th derivative is w p^k."""
    robot = load(
        link("frame"),
        link("tip"),
        joint("tilt", "revolute", "base", "frame", "1 0 0"),
        joint("spin", "revolute", "frame", "tip"),
    )
    tilt, spin, width = 2.0, 5.0, 0.4
    joints = bounds_of(uniform(robot, {"tilt": tilt, "spin": spin}, width))
    expected = width * spin * powers(width * tilt, 8)
    expected[0] += width * tilt
    np.testing.assert_allclose(tool_majorant(robot, joints).spin[:8, 0], expected, rtol=1e-12)


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


# Taylor coefficients of arms, by numerical derivatives.


def taylor_coefficients(function, width, orders, points=13):
    """Return the largest Taylor coefficients of a function (N,) -> (N, c) on [0, width].

    In units of the width. Fewer points would not resolve the function, more amplify rounding.
    """
    values = function(width * (chebpts1(points) + 1) / 2)
    u = np.linspace(0, 1, 33)
    largest = []
    for column in values.T:
        fit = Chebyshev.fit(chebpts1(points) / 2 + 0.5, column, points - 1, domain=[0, 1])
        derivatives = [fit.deriv(k)(u) if k else fit(u) for k in orders]
        largest.append(
            [abs(d).max() / factorial(k) for d, k in zip(derivatives, orders, strict=True)]
        )
    return np.array(largest).T


@pytest.mark.parametrize("slower", [1, 1000])
@pytest.mark.parametrize("seed", range(2))
def test_no_taylor_coefficient_exceeds_its_bound(arm, seed, slower):
    """Fast, where inertia counts; and slowly, where little but gravity does."""
    width = 0.05 * slower
    trajectory = random_trajectory(arm, seed, pieces=1, width=0.05).scaled(slower)
    orders = range(1, 9)
    tool = taylor_coefficients(lambda t: arm.tool_position(trajectory.position(t)), width, orders)
    bound = tool_majorant(arm, bounds_of(trajectory)).position[1:9, 0]
    assert (tool <= bound[:, None] * (1 + 1e-6) + 1e-7).all()

    def efforts(t):
        states = trajectory.at(t)
        return arm.inverse_dynamics(states.position, states.velocity, states.acceleration)

    found = taylor_coefficients(efforts, width, range(9))
    assert (found <= effort_bounds(arm, trajectory) * (1 + 1e-6) + 1e-5).all()


def test_joint_bounds_are_those_of_the_derivatives(two_link):
    trajectory = random_trajectory(two_link, 5, pieces=2)
    start, width = np.array([0.02, 0.03]), np.array([0.05, 0.06])
    bounds = joint_bounds(trajectory, np.array([0, 1]), start, width, 11)
    for i in range(2):
        t = trajectory.breakpoints[i] + start[i] + width[i] * np.linspace(0, 1, 500)
        states = trajectory.at(t)
        for order, value in enumerate((states.position, states.velocity, states.acceleration)):
            found = abs(value).max(axis=0) * width[i] ** order / factorial(order)
            assert (found <= bounds[order, i] * (1 + 1e-9)).all()
            assert (found >= bounds[order, i] * 0.3).all() or order > 0
    assert (bounds[6:] == 0).all()


# Enclosures: polynomials and what they miss at most.


ORDER_EIGHT = Quantity(0, lambda q: q**8, lambda joints, width: np.ones((9, 1, 1)))


def test_errors_belong_to_their_intervals():
    """Pieces of different widths, halved differently often: an error as large as its width."""
    trajectory = JointTrajectory(["u"], [0, 1.0, 1.05, 1.35], np.zeros((1, 3, 1)))

    def majorant(joints, width):
        return np.tile(width[:, None], (9, 1, 1))

    enclosure = enclosed(trajectory, Quantity(0, lambda q: q, majorant), np.array([1e-5]))
    assert len(np.unique(enclosure.width.round(9))) > 1
    np.testing.assert_allclose(enclosure.error[:, 0] / enclosure.width, 2 / 4**8)


@pytest.mark.parametrize("duration", [1.0, 2.0])
def test_the_error_is_just_that_of_the_next_power(duration):
    """Of degree 8, one more than the polynomials have: the bound is met, not only kept.

    At an end of the interval the polynomials' derivative misses all that it may.
    """
    trajectory = JointTrajectory(["u"], [0, duration], [[[1 / duration]], [[0.0]]])
    t = np.linspace(0, duration, 100_001)
    found, rate = (make(trajectory, ORDER_EIGHT, np.ones(1)) for make in (enclosed, enclosed_rate))
    off = abs(found.at(t)[:, 0] - (t / duration) ** 8)
    assert off.max() == pytest.approx(found.error[0, 0], rel=1e-6)
    off = abs(rate.at(t)[:, 0] - 8 / duration * (t / duration) ** 7)
    assert off.max() == pytest.approx(rate.error[0, 0], rel=1e-6)
    assert off.argmax() in (0, len(t) - 1)


def test_intervals_are_halved_until_the_rate_is_close_enough(two_link):
    """A rate changes faster than the quantity: the same tolerance takes more intervals."""
    trajectory, tolerance = random_trajectory(two_link, 1), np.full(2, 1e-6)
    (rigid,) = effort_terms(two_link).values()
    rate = enclosed_rate(trajectory, rigid, tolerance)
    assert rate.error.max() <= 1e-6
    assert len(rate.width) > len(enclosed(trajectory, rigid, tolerance).width)


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_tool_velocity_and_efforts_are_what_they_are_said_to_be(arm, degree):
    def velocity(q, v):
        return np.einsum("ijk,ik->ij", arm.tool_jacobian(q)[1], v)

    def majorant(joints, width):
        speed = derivative(tool_majorant(arm, joints).position) / width
        return np.stack([speed] * 3, axis=2)

    trajectory = random_trajectory(arm, degree, degree)
    tolerance = 1e-7 * arm.limits.effort
    tool = enclosed_tool(arm, TUBE, trajectory, 1e-7)
    speed = enclosed(trajectory, Quantity(1, velocity, majorant), np.full(3, 1e-6))
    efforts = enclosed_efforts(arm, trajectory, tolerance)
    assert tool.error.max() <= 1e-7
    assert speed.error.max() <= 1e-6
    assert (efforts.error <= tolerance).all()
    s = trajectory.per_piece(400)
    inside = np.setdiff1d(np.arange(len(s.time)), np.arange(3) * 400 + 399)
    t, q, v, a = (x[inside] for x in (s.time, s.position, s.velocity, s.acceleration))
    assert np.linalg.norm(tool.at(t) - arm.tool_position(q), axis=1).max() <= 1e-7
    assert np.linalg.norm(speed.at(t) - velocity(q, v), axis=1).max() <= 1e-6
    assert (abs(efforts.at(t) - arm.inverse_dynamics(q, v, a)) <= tolerance + 1e-9).all()
    np.testing.assert_allclose(tool.start[0], 0)
    np.testing.assert_allclose(np.diff(tool.start), tool.width[:-1], atol=1e-12)
    np.testing.assert_allclose(tool.start[-1] + tool.width[-1], trajectory.duration)


def test_few_intervals_are_enough(stored):
    problem, trajectory = stored("ur5/over_the_wall", "branch-and-bound")
    robot = problem.robot
    assert len(enclosed_tool(robot, TUBE, trajectory, 1e-7).width) < 40
    assert len(enclosed_efforts(robot, trajectory, 1e-7 * robot.limits.effort).width) < 80
    assert len(enclosed_tool(robot, TUBE, trajectory, 1e-3).width) < 12


def test_halving_ends_after_so_many_intervals(two_link, monkeypatch):
    monkeypatch.setattr("tubeplanner.certificate.enclosure._MAX_INTERVALS", 40)
    enclosure = enclosed_tool(two_link, TUBE, random_trajectory(two_link, 0), 1e-25)
    assert 20 <= len(enclosure.width) < 80
    assert enclosure.error.max() > 1e-25


# The terms of the effort law: all of them, each what its bound is made for.


@pytest.fixture(params=["rigid", "motors"])
def efforts_arm(request, robot):
    """Arms without and with rotors and viscous friction."""
    if request.param == "rigid":
        return robot
    names = ("armature", "viscous_friction", "forwards_friction")
    amounts = np.random.default_rng(1).uniform(0.1, 2.0, (3, robot.joint_count))
    return with_motors(robot, **dict(zip(names, amounts, strict=True)))


def random_states(robot):
    """Return positions, velocities and accelerations, each (20, n)."""
    return np.random.default_rng(0).uniform(-2, 2, (3, 20, robot.joint_count))


def test_the_terms_add_up_to_what_the_planners_limit(efforts_arm):
    states = random_states(efforts_arm)
    terms = effort_terms(efforts_arm).values()
    efforts = sum(term.values(*states[: term.derivatives + 1]) for term in terms)
    expected = efforts_arm.inverse_dynamics(*states)
    np.testing.assert_allclose(efforts, expected, rtol=1e-12, atol=1e-12)


def test_what_rotors_and_friction_take_is_missed_by_no_more_than_the_error(tmp_path):
    """A polynomial of a degree that interpolation misses, of a joint with hardly any inertia."""
    robot = with_motors(one_joint(tmp_path), armature=400.0, viscous_friction=3000.0)
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
