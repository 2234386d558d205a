"""What is claimed for all t, against dense evaluation and numerical derivatives."""

from math import factorial

import numpy as np
import pytest
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import chebpts1

from cases import SLIDE
from follower_arm import follower_arm
from tubeplanner import JointTrajectory, Payload, load_robot
from tubeplanner.trajectory.bernstein import bernstein_coefficients
from tubeplanner.verification.enclosure import _joint_bounds, enclosed_efforts, enclosed_tool
from tubeplanner.verification.majorants import effort_majorant, tool_majorant


@pytest.fixture(scope="module", params=["two_link", "ur5", "ur10", "panda", "slide", "followers"])
def arm(request, tmp_path_factory):
    if request.param == "ur10":
        return load_robot("example:ur10", "tool0", payload=Payload(8.0, (0.1, 0, 0.2)))
    if request.param == "slide":
        path = tmp_path_factory.mktemp("slide") / "slide.urdf"
        path.write_text(SLIDE)
        return load_robot(path, "tip")
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


@pytest.mark.parametrize("seed", range(4))
def test_no_taylor_coefficient_exceeds_its_bound(arm, seed):
    width = 0.05
    trajectory = random_trajectory(arm, seed, pieces=1, width=width)
    joints = _joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([width]))
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
    bound = effort_majorant(arm, joints, np.array([width]))[:9, 0]
    assert (found <= bound * (1 + 1e-6) + 1e-5).all()


def test_joint_bounds_are_those_of_the_derivatives(two_link):
    trajectory = random_trajectory(two_link, 5, pieces=2)
    start, width = np.array([0.02, 0.03]), np.array([0.05, 0.06])
    bounds = _joint_bounds(trajectory, np.array([0, 1]), start, width)
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
    joints = _joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([0.2]))
    expected = [0.4 * (0.2 * speed) ** k / factorial(k) for k in range(1, 9)]
    np.testing.assert_allclose(tool_majorant(robot, joints).position[1:9, 0], expected, rtol=1e-12)


@pytest.mark.parametrize(("kind", "inertia"), [("prismatic", 2.0), ("revolute", 0.7)])
def test_the_bound_is_near_for_a_joint_that_speeds_up(tmp_path, kind, inertia):
    """Effort is inertia times acceleration, 2 + 6 c t; the bound takes the largest moment."""
    robot = one_joint(tmp_path, kind)
    trajectory = JointTrajectory(["move"], [0, 0.1], [[[5.0]], [[1.0]], [[0.0]], [[0.0]]])
    joints = _joint_bounds(trajectory, np.array([0]), np.zeros(1), np.array([0.1]))
    bound = effort_majorant(robot, joints, np.array([0.1]))[:, 0, 0]
    exact = inertia * np.array([2 + 30 * 0.1, 30 * 0.1])
    if kind == "prismatic":
        np.testing.assert_allclose(bound[:2], exact, rtol=1e-12)
        np.testing.assert_allclose(bound[2:], 0, atol=1e-12)
    else:
        assert (bound[:2] >= exact).all()
        assert (bound[:2] < 2.5 * exact).all()


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
