"""What is claimed for all t, against dense evaluation and numerical derivatives."""

from math import factorial

import numpy as np
import pytest
from cases import one_joint as pendulum
from follower_arm import follower_arm
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebpts1

from tubeplanner import JointTrajectory, Payload, load_robot
from tubeplanner.trajectory.bernstein import bernstein_coefficients
from tubeplanner.verification.enclosed_efforts import enclosed_efforts
from tubeplanner.verification.enclosed_pose import enclosed_pose, enclosed_tool
from tubeplanner.verification.enclosure import (
    Quantity,
    enclosed,
    enclosed_rate,
    joint_bounds,
    total,
)
from tubeplanner.verification.majorants import derivative, rigid_body_majorant, tool_majorant


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
    shape = (degree + 1, pieces, robot.joint_count)
    scale = np.array([[60.0, 30.0, 20.0, 8.0, 2.0, 1.5][-1 - degree :]]).reshape(-1, 1, 1)
    powers = np.arange(degree, -1, -1)
    limits = [rng.uniform(-1, 1, shape)[i] * scale[i] for i in range(degree + 1)]
    assert len(powers) == len(limits)
    breakpoints = width * np.arange(pieces + 1)
    return JointTrajectory(robot.joint_names, breakpoints, np.array(limits))


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


def one_joint(tmp_path, kind):
    path = tmp_path / f"{kind}.urdf"
    path.write_text(
        f"""<robot name="bar"><link name="base"/>
        <link name="bar"><inertial><origin xyz="0 0 0"/><mass value="2"/>
          <inertia ixx="1" iyy="1" izz="0.7" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="tip"/>
        <joint name="move" type="{kind}"><parent link="base"/><child link="bar"/>
          <axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="5" velocity="4"/></joint>
        <joint name="end" type="fixed"><parent link="bar"/><child link="tip"/>
          <origin xyz="0.4 0 0"/></joint></robot>"""
    )
    return load_robot(path, "tip", gravity=(0, 0, 0))


def test_the_bound_is_exact_for_a_joint_that_turns_uniformly(tmp_path):
    """The k-th derivative of a point on a circle has the length r w^k."""
    robot, speed = one_joint(tmp_path, "revolute"), 3.0
    trajectory = JointTrajectory(["move"], [0, 0.2], [[[speed]], [[0.0]]])
    joints = joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([0.2]), 11)
    expected = [0.4 * (0.2 * speed) ** k / factorial(k) for k in range(1, 9)]
    np.testing.assert_allclose(tool_majorant(robot, joints).position[1:9, 0], expected, rtol=1e-12)


def test_what_is_said_of_a_uniform_turn_is_exact(tmp_path):
    """Tool and axes go round in circles: errors of order 8, speeds and accelerations."""
    robot, speed, width = one_joint(tmp_path, "revolute"), 3.0, 0.5
    trajectory = JointTrajectory(["move"], [0, width], [[[speed]], [[0.0]]])
    error = 2 / 4**8 * (speed * width) ** 8 / factorial(8)
    tool = enclosed_tool(robot, trajectory, 1.0)
    np.testing.assert_allclose(tool.error, [[0.4 * error] * 3], rtol=1e-12)
    pose = enclosed_pose(robot, trajectory, 1.0, 1.0)
    np.testing.assert_allclose(pose.tool.error, [[0.4 * error] * 3], rtol=1e-12)
    np.testing.assert_allclose(pose.rotation.error, [[error] * 9], rtol=1e-12)
    np.testing.assert_allclose(pose.speed, 0.4 * speed)
    np.testing.assert_allclose(pose.acceleration, 0.4 * speed**2)
    np.testing.assert_allclose(pose.spin, speed)
    np.testing.assert_allclose(pose.spin_rate, 0.0)


def test_spin_that_grows_is_bounded_by_its_growth(tmp_path):
    """Angle c t^2: the tool's axis spins up by 2 c."""
    robot = one_joint(tmp_path, "revolute")
    trajectory = JointTrajectory(["move"], [0, 0.5], [[[1.5]], [[0.0]], [[0.0]]])
    pose = enclosed_pose(robot, trajectory, 1.0, 1.0)
    np.testing.assert_allclose(pose.spin_rate, 3.0)
    np.testing.assert_allclose(pose.spin, 1.5)


def test_errors_belong_to_their_intervals():
    """Pieces of different widths, halved differently often: an error as large as its width."""
    breakpoints = [0, 1.0, 1.05, 1.35]
    trajectory = JointTrajectory(["u"], breakpoints, np.zeros((1, 3, 1)))

    def majorant(joints, width):
        return np.tile(width[:, None], (9, 1, 1))

    enclosure = enclosed(trajectory, Quantity(0, lambda q: q, majorant), np.array([1e-5]))
    assert len(np.unique(enclosure.width.round(9))) > 1
    np.testing.assert_allclose(enclosure.error[:, 0] / enclosure.width, 2 / 4**8)


@pytest.mark.parametrize(("kind", "inertia"), [("prismatic", 2.0), ("revolute", 0.7)])
def test_the_bound_is_near_for_a_joint_that_speeds_up(tmp_path, kind, inertia):
    """Effort is inertia times acceleration, 2 + 6 c t; the bound takes the largest moment."""
    robot = one_joint(tmp_path, kind)
    trajectory = JointTrajectory(["move"], [0, 0.1], [[[5.0]], [[1.0]], [[0.0]], [[0.0]]])
    joints = joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([0.1]), 11)
    bound = rigid_body_majorant(robot, joints, np.array([0.1]))[:, 0, 0]
    exact = inertia * np.array([2 + 30 * 0.1, 30 * 0.1])
    if kind == "prismatic":
        np.testing.assert_allclose(bound[:2], exact, rtol=1e-12)
        np.testing.assert_allclose(bound[2:], 0, atol=1e-12)
    else:
        assert (bound[:2] >= exact).all()
        assert (bound[:2] < 2.5 * exact).all()


def test_the_error_is_just_that_of_the_next_power():
    """Of degree 8, one more than the polynomials have: the bound is met, not only kept."""
    trajectory = JointTrajectory(["u"], [0, 1.0], [[[1.0]], [[0.0]]])
    enclosure = enclosed(
        trajectory,
        Quantity(0, lambda q: q**8, lambda joints, width: np.ones((9, 1, 1))),
        np.ones(1),
    )
    u = np.linspace(0, 1, 100_001)
    off = abs(enclosure.at(u)[:, 0] - u**8)
    assert off.max() == pytest.approx(enclosure.error[0, 0], rel=1e-6)


def test_the_error_of_a_rate_is_just_that_of_the_next_power():
    """At an end of the interval the polynomials' derivative misses all that it may."""
    trajectory = JointTrajectory(["u"], [0, 2.0], [[[0.5]], [[0.0]]])
    quantity = Quantity(0, lambda q: q**8, lambda joints, width: np.ones((9, 1, 1)))
    enclosure = enclosed_rate(trajectory, quantity, np.ones(1))
    t = np.linspace(0, 2, 100_001)
    off = abs(enclosure.at(t)[:, 0] - 4 * (t / 2) ** 7)
    assert off.max() == pytest.approx(enclosure.error[0, 0], rel=1e-6)
    assert off.argmax() in (0, len(t) - 1)


def test_intervals_are_halved_until_the_rate_is_close_enough(two_link):
    """A rate changes faster than the quantity: the same tolerance takes more intervals."""
    trajectory = random_trajectory(two_link, 1)

    def majorant(joints, width):
        return np.stack([rigid_body_majorant(two_link, joints, width)[:, :, 0]], axis=2)

    def values(*states):
        return two_link.inverse_dynamics(*states)[:, :1]

    quantity, tolerance = Quantity(2, values, majorant), np.array([1e-6])
    rate = enclosed_rate(trajectory, quantity, tolerance)
    assert rate.error.max() <= 1e-6
    assert len(rate.width) > len(enclosed(trajectory, quantity, tolerance).width)


def test_a_slow_pendulums_bound_is_its_gravity(tmp_path):
    """Turned uniformly, effort is m g l cos(w t): the k-th coefficient is m g l (w T)^k / k!."""
    robot, speed, width = pendulum(tmp_path, mass=0.5), 1e-3, 600.0
    trajectory = JointTrajectory(["turn"], [0, width], [[[speed]], [[0.0]]])
    joints = joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([width]), 11)
    bound = rigid_body_majorant(robot, joints, np.array([width]))[:9, 0, 0]
    expected = [0.5 * 9.81 * 0.5 * (speed * width) ** k / factorial(k) for k in range(9)]
    np.testing.assert_allclose(bound, expected, rtol=1e-3)
    efforts = enclosed_efforts(robot, trajectory, np.array([1.0]))
    np.testing.assert_allclose(efforts.error, [[2 / 4**8 * expected[8]]], rtol=1e-3)


def test_a_slow_slides_bound_is_its_gravity(tmp_path):
    """It turns uniformly with what carries it: its force is m g cos(w t)."""
    (tmp_path / "slide.urdf").write_text(
        """<robot name="slide"><link name="base"/>
        <link name="rail"><inertial><mass value="1e-9"/>
          <inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <link name="cart"><inertial><mass value="2"/>
          <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
        <joint name="turn" type="continuous"><parent link="base"/><child link="rail"/>
          <axis xyz="0 0 1"/><limit effort="5" velocity="4"/></joint>
        <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/>
          <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="50" velocity="4"/></joint>
        </robot>"""
    )
    robot = load_robot(tmp_path / "slide.urdf", "cart", gravity=(0, -9.81, 0))
    speed, width = 1e-3, 600.0
    coefficients = [[[speed, 0.0]], [[0.0, 0.1]]]
    trajectory = JointTrajectory(robot.joint_names, [0, width], coefficients)
    joints = joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([width]), 11)
    bound = rigid_body_majorant(robot, joints, np.array([width]))[:9, 0, 1]
    expected = [2 * 9.81 * (speed * width) ** k / factorial(k) for k in range(9)]
    np.testing.assert_allclose(bound, expected, rtol=1e-3)


ROTOR = """<robot name="rotor"><link name="base"/>
<link name="frame"><inertial><mass value="1"/>
  <inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rod"><inertial><mass value="1"/>
  <inertia ixx="1e-9" iyy="0.5" izz="0.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="tilt" type="continuous"><parent link="base"/><child link="frame"/>
  <axis xyz="1 0 0"/><limit effort="5" velocity="40"/></joint>
<joint name="spin" type="continuous"><parent link="frame"/><child link="rod"/>
  <axis xyz="0 0 1"/><limit effort="5" velocity="40"/></joint></robot>"""


def test_the_bound_on_spin_is_exact_for_an_axis_that_turns_uniformly(tmp_path):
    """Angular velocity p x + w z(t), where z is tilted at p: its k-th derivative is w p^k."""
    (tmp_path / "rotor.urdf").write_text(ROTOR)
    robot = load_robot(tmp_path / "rotor.urdf", "rod", gravity=(0, 0, 0))
    tilt, spin, width = 2.0, 5.0, 0.4
    trajectory = JointTrajectory(robot.joint_names, [0, width], [[[tilt, spin]], [[0.0, 0.0]]])
    joints = joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([width]), 11)
    expected = [width * spin * (width * tilt) ** k / factorial(k) for k in range(8)]
    expected[0] += width * tilt
    np.testing.assert_allclose(tool_majorant(robot, joints).spin[:8, 0], expected, rtol=1e-12)


def test_a_rods_inertia_turns_twice_as_fast_as_the_rod(tmp_path):
    """About the tilting axis it is I sin^2(w t): effort p I w sin(2 w t) at a tilting speed p."""
    (tmp_path / "rotor.urdf").write_text(ROTOR)
    robot = load_robot(tmp_path / "rotor.urdf", "rod", gravity=(0, 0, 0))
    inertia, tilt, spin, width = 0.5, 0.1, 5.0, 0.4
    trajectory = JointTrajectory(robot.joint_names, [0, width], [[[tilt, spin]], [[0.0, 0.0]]])
    t = np.linspace(0, width, 9)
    states = trajectory.at(t)
    effort = robot.inverse_dynamics(states.position, states.velocity, states.acceleration)
    expected = tilt * inertia * spin * np.sin(2 * spin * t)
    np.testing.assert_allclose(effort[:, 0], expected, atol=1e-6)
    joints = joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([width]), 11)
    bound = rigid_body_majorant(robot, joints, np.array([width]))[:9, 0, 0]
    # Over 2 w T = 4 rad, sine and cosine both reach their largest value.
    exact = [tilt * inertia * spin * (2 * spin * width) ** k / factorial(k) for k in range(1, 9)]
    assert (bound[1:] >= exact).all()


@pytest.mark.parametrize("slower", [1, 1000])
@pytest.mark.parametrize("seed", range(4))
def test_no_taylor_coefficient_exceeds_its_bound(arm, seed, slower):
    """Fast, where inertia counts; and slowly, where little but gravity does."""
    width = 0.05 * slower
    trajectory = random_trajectory(arm, seed, pieces=1, width=0.05).scaled(slower)
    joints = joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([width]), 11)
    orders = range(1, 9)
    tool = taylor_coefficients(lambda t: arm.tool_position(trajectory.position(t)), width, orders)
    bound = tool_majorant(arm, joints).position[1:9, 0]
    assert (tool <= bound[:, None] * (1 + 1e-6) + 1e-7).all()

    def efforts(t):
        return arm.inverse_dynamics(
            trajectory.position(t), trajectory.velocity(t), trajectory.acceleration(t)
        )

    orders = range(9)
    found = taylor_coefficients(efforts, width, orders)
    bound = rigid_body_majorant(arm, joints, np.array([width]))[:9, 0]
    assert (found <= bound * (1 + 1e-6) + 1e-5).all()


def testjoint_bounds_are_those_of_the_derivatives(two_link):
    trajectory = random_trajectory(two_link, 5, pieces=2)
    start, width = np.array([0.02, 0.03]), np.array([0.05, 0.06])
    bounds = joint_bounds(trajectory, np.array([0, 1]), start, width, 11)
    for i in range(2):
        t = trajectory.breakpoints[i] + start[i] + width[i] * np.linspace(0, 1, 500)
        for order in range(3):
            value = (trajectory.position, trajectory.velocity, trajectory.acceleration)[order](t)
            found = abs(value).max(axis=0) * width[i] ** order / factorial(order)
            assert (found <= bounds[order, i] * (1 + 1e-9)).all()
            assert (found >= bounds[order, i] * 0.3).all() or order > 0
    assert (bounds[6:] == 0).all()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("degree", [1, 3, 5])
def test_the_tool_is_where_it_is_said_to_be(arm, seed, degree):
    trajectory = random_trajectory(arm, seed, degree)
    enclosure = enclosed_tool(arm, trajectory, 1e-7)
    assert enclosure.error.max() <= 1e-7
    samples = trajectory.per_piece(400)
    inside = np.setdiff1d(np.arange(len(samples.time)), np.arange(3) * 400 + 399)
    off = enclosure.at(samples.time[inside]) - arm.tool_position(samples.position[inside])
    assert np.linalg.norm(off, axis=1).max() <= 1e-7
    np.testing.assert_allclose(enclosure.start[0], 0)
    np.testing.assert_allclose(np.diff(enclosure.start), enclosure.width[:-1], atol=1e-12)
    np.testing.assert_allclose(enclosure.start[-1] + enclosure.width[-1], trajectory.duration)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("degree", [1, 3, 5])
def test_efforts_are_what_they_are_said_to_be(arm, seed, degree):
    trajectory = random_trajectory(arm, seed, degree)
    tolerance = 1e-7 * arm.limits.effort
    enclosure = enclosed_efforts(arm, trajectory, tolerance)
    assert (enclosure.error <= tolerance).all()
    s = trajectory.per_piece(400)
    inside = np.setdiff1d(np.arange(len(s.time)), np.arange(3) * 400 + 399)
    tau = arm.inverse_dynamics(*(x[inside] for x in (s.position, s.velocity, s.acceleration)))
    assert (abs(enclosure.at(s.time[inside]) - tau) <= tolerance + 1e-9).all()


@pytest.mark.parametrize("seed", range(3))
def test_another_quantity_is_enclosed_by_its_values_and_its_majorant(arm, seed):
    """The velocity of the tool."""

    def values(q, v):
        jacobian = arm.tool_jacobian(q)[1]
        return np.einsum("ijk,ik->ij", jacobian, v)

    def majorant(joints, width):
        speed = derivative(tool_majorant(arm, joints).position) / width
        return np.stack([speed] * 3, axis=2)

    trajectory = random_trajectory(arm, seed)
    enclosure = enclosed(trajectory, Quantity(1, values, majorant), np.full(3, 1e-6))
    assert enclosure.error.max() <= 1e-6
    s = trajectory.per_piece(400)
    inside = np.setdiff1d(np.arange(len(s.time)), np.arange(3) * 400 + 399)
    off = enclosure.at(s.time[inside]) - values(s.position[inside], s.velocity[inside])
    assert np.linalg.norm(off, axis=1).max() <= 1e-6


def test_terms_are_added_up_with_their_bounds():
    """Of a joint that moves as t^4: position, twice the velocity and three times the jerk."""
    trajectory = JointTrajectory(["u"], [0, 0.5], [[[1.0]], *[[[0.0]]] * 4])
    terms = [
        Quantity(0, lambda q: q, lambda joints, width: joints),
        Quantity(
            1,
            lambda q, v: 2 * v,
            lambda joints, width: 2 * derivative(joints) / width[:, None],
        ),
        Quantity(
            3,
            lambda q, v, a, j: 3 * j,
            lambda joints, width: 3 * derivative(joints, 3) / width[:, None] ** 3,
        ),
    ]
    whole = total(terms)
    assert whole.derivatives == 3
    enclosure = enclosed(trajectory, whole, np.array([1e-9]))
    t = np.linspace(0, 0.499, 50)
    np.testing.assert_allclose(enclosure.at(t)[:, 0], t**4 + 8 * t**3 + 72 * t, atol=1e-9)
    width = np.array([0.5])
    joints = joint_bounds(trajectory, np.array([0]), np.zeros(1), width, 12)
    bounds = whole.majorant(joints, width)
    assert bounds.shape == (9, 1, 1)
    values = [term.majorant(joints, width)[:9] for term in terms]
    np.testing.assert_array_equal(bounds, values[0] + values[1] + values[2])
    assert (bounds[:2, 0, 0] >= [1 / 16 + 1 + 36, 1 / 4 + 3 + 36]).all()


def test_a_trajectory_that_no_machine_could_make_is_left_open(two_link):
    """A million radians within a piece: the error is not small, and says so."""
    wild = JointTrajectory(two_link.joint_names, [0, 1e-6], [[[1e11, 1e11]], [[0.0, 0.0]]])
    enclosure = enclosed_tool(two_link, wild, 1e-7)
    assert np.isfinite(enclosure.coefficients).all()
    assert enclosure.error.max() > 1e-7


def test_the_hull_of_the_polynomials_holds_the_tool(ur5):
    trajectory = random_trajectory(ur5, 3)
    enclosure = enclosed_tool(ur5, trajectory, 1e-7)
    rows = np.arange(len(enclosure.width))
    half = np.full(len(rows), 0.5)
    hull = bernstein_coefficients(enclosure.coefficients[:, rows], 0 * half, half)
    first = enclosure.start + 0.0
    middle = enclosure.at(np.nextafter(first + enclosure.width / 2, 0))
    np.testing.assert_allclose(hull[-1], middle, atol=1e-9)
    np.testing.assert_allclose(hull[0], enclosure.at(first), atol=1e-12)


def test_few_intervals_are_enough(stored):
    problem, trajectory = stored("ur5/over_the_wall", "branch-and-bound")
    robot = problem.robot
    assert len(enclosed_tool(robot, trajectory, 1e-7).width) < 40
    assert len(enclosed_efforts(robot, trajectory, 1e-7 * robot.limits.effort).width) < 80
    assert len(enclosed_tool(robot, trajectory, 1e-3).width) < 12


def test_halving_ends_after_so_many_intervals(two_link, monkeypatch):
    monkeypatch.setattr("tubeplanner.verification.enclosure._MAX_INTERVALS", 40)
    enclosure = enclosed_tool(two_link, random_trajectory(two_link, 0), 1e-25)
    assert 20 <= len(enclosure.width) < 80
    assert enclosure.error.max() > 1e-25
