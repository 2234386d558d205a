"""The speeds of points against closed forms: a bar that turns."""

from dataclasses import replace
from math import factorial

import numpy as np
import pytest

from cases import anywhere, one_joint, quintic
from tubeplanner import LimitOverrides, PointSpeed, load_robot, verify
from tubeplanner.verification import tube_visits
from tubeplanner.verification.enclosure import enclosed
from tubeplanner.verification.judged import point_speed

LEVER = 0.5
PLACE = (0.3, 0.4, 0.7)  # on the lever about z [m]
PEAK = 1.875 * LEVER  # of a quintic over 1 rad in 1 s [m/s]


@pytest.fixture
def bar(tmp_path):
    one_joint(tmp_path)

    def limited(*speeds, place=PLACE, link="bar"):
        points = [PointSpeed(link, place, speed) for speed in speeds]
        limits = LimitOverrides(point_speed=points)
        return anywhere(load_robot(tmp_path / "bar.urdf", "bar", limits=limits))

    return limited


def judged(problem, trajectory):
    return verify(problem, trajectory).conditions["point_speed"]


@pytest.mark.parametrize("limit", [0.4, 1.0, 3.0])
@pytest.mark.parametrize("angle", [0.5, -2.5])
def test_the_margin_is_what_the_fastest_instant_leaves(bar, limit, angle):
    duration = 1.3
    condition = judged(bar(limit), quintic(angle, duration))
    fastest = PEAK * abs(angle) / duration
    assert condition.margin == pytest.approx(1 - fastest / limit, abs=0.03 * fastest / limit)
    assert condition.unit == "relative"
    assert condition.coverage == "for all t"
    assert (condition.where.links, condition.where.point_speed) == (("bar",), 0)


@pytest.mark.parametrize("share", [1 - 1e-5, 1 + 1e-5])
def test_a_hundred_thousandth_decides(bar, share):
    certificate = verify(bar(PEAK * share), quintic(1.0, 1.0))
    condition = certificate.conditions["point_speed"]
    assert condition.margin == pytest.approx(1 - 1 / share, abs=3e-7)
    assert condition.where.time == pytest.approx(0.5, abs=0.02)
    assert ("point_speed" in certificate.failures()) == (share < 1)


@pytest.mark.parametrize("speeds", [(5.0, 1.0, 3.0), (1.0, 2.0), (4.0, 3.0, 1.0)])
def test_the_point_with_the_least_margin_is_named(bar, speeds):
    condition = judged(bar(*speeds), quintic(1.0, 1.0))
    assert condition.margin == pytest.approx(1 - PEAK, abs=1e-2)
    assert condition.where.point_speed == speeds.index(1.0)
    assert f"bar, point_speed {speeds.index(1.0)}, t = " in str(condition.where)


def test_a_point_of_the_base_does_not_move(bar):
    assert judged(bar(0.1, link="base"), quintic(1.0, 1.0)).margin == pytest.approx(1.0)


def test_without_a_limit_it_is_not_required(bar):
    condition = judged(bar(), quintic(1.0, 0.01))
    assert (condition.margin, condition.coverage) == (None, "no point's speed is limited")


def test_a_verdict_that_costs_too_much_is_undecided_and_safe(bar, monkeypatch):
    monkeypatch.setattr(tube_visits, "_MAX_ROWS", 1)
    condition = judged(bar(PEAK), quintic(1.0, 1.0))
    assert "undecided" in condition.coverage
    assert condition.margin < -1e-6


def test_what_the_polynomials_miss_is_taken_off(bar, monkeypatch):
    def rough(*given):
        found = enclosed(*given)
        return replace(found, error=found.error + 1e-3)

    exact = judged(bar(PEAK), quintic(1.0, 1.0)).margin
    monkeypatch.setattr(point_speed, "enclosed", rough)
    margin = judged(bar(PEAK), quintic(1.0, 1.0)).margin
    assert margin == pytest.approx(exact - 1e-3 / PEAK, abs=1e-6)


def test_polynomials_are_as_close_as_the_slowest_limit_asks(bar):
    problem = bar(0.001)
    motion = quintic(1.0, 2000.0)
    exact = 1 - PEAK / 2000 / 0.001
    assert judged(problem, motion).margin == pytest.approx(exact, abs=0.03 * PEAK / 2)


def test_the_bounds_on_the_velocity_are_those_of_a_turning_lever(bar):
    """At a constant rate a, the point is at r exp(i a u), with coefficients r a^k / k!."""
    robot = bar(1.0).robot
    turned, width = np.array([0.3, 2.0]), np.array([0.1, 3.0])  # per interval [rad], [s]
    joints = np.zeros((9, 2, 1))
    joints[1, :, 0] = turned
    quantity = point_speed._point_velocity(robot, robot.limits.point_speed[0])
    bounds = quantity.majorant(joints, width)
    assert bounds.shape == (8, 2, 3)
    reach = np.linalg.norm(PLACE)
    for k, bound in enumerate(bounds):
        true = turned ** (k + 1) / factorial(k) / width
        assert (bound >= LEVER * true[:, None]).all()
        assert (bound <= (1 + 1e-9) * reach * true[:, None]).all()


def test_the_velocity_that_is_enclosed_is_the_points(robot):
    link = robot.urdf.joints[robot.joint_names[1]].child
    point = PointSpeed(link, (0.1, -0.2, 0.3), 1.0)
    q, v = np.random.default_rng(3).uniform(-1, 1, (2, 20, robot.joint_count))
    velocity = point_speed._point_velocity(robot, point).values(q, v)
    body, in_body = robot.link_body[link], robot.link_placement[link] @ [*point.position, 1.0]
    sides = []
    for sign in (1e-6, -1e-6):
        rotation, position = robot.body_poses(q + sign * v)
        sides.append(rotation[:, body] @ in_body[:3] + position[:, body])
    np.testing.assert_allclose(velocity, (sides[0] - sides[1]) / 2e-6, atol=1e-7)


def test_the_bounds_know_how_far_the_link_is_away(two_link):
    """The first joint turns the stretched arm: the whole distance from its axis counts."""
    point = PointSpeed("link2", (0.3, 0.0, 0.0), 1.0)
    quantity = point_speed._point_velocity(two_link, point)
    away = np.linalg.norm(quantity.values(np.zeros((1, 2)), np.array([[1.0, 0.0]])))
    assert away > 0.4
    joints = np.zeros((9, 1, 2))
    joints[1, :, 0] = 0.5
    bounds = quantity.majorant(joints, np.ones(1))
    for k, bound in enumerate(bounds):
        assert (bound >= (1 - 1e-9) * away * 0.5 ** (k + 1) / factorial(k)).all()
