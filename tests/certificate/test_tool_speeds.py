"""Tool and point speed conditions of the certificate."""

from dataclasses import replace
from math import factorial

import numpy as np
import pytest
from cases import anywhere, one_joint, quintic

from tubeplanner import (
    JointTrajectory,
    LimitOverrides,
    PlanningProblem,
    PointSpeed,
    Tolerance,
    ToolOffset,
    Tube,
    load_robot,
    verify,
)
from tubeplanner.certificate import tool_conditions as point_speed
from tubeplanner.certificate import tool_conditions as tool_speed
from tubeplanner.certificate import tube_visits
from tubeplanner.certificate.enclosure import enclosed
from tubeplanner.certificate.judged_motion import JudgedMotion
from tubeplanner.certificate.verification import JUDGED, SEGMENT_MARGINS

# The speeds of tool and points against closed forms: a bar that turns.


LEVER = 0.5
POINT = (0.3, 0.4, 0.7)  # of the bar; its lever about z is 0.5 m [m]
PEAK = 1.875 * LEVER  # of a quintic over 1 rad in 1 s [m/s]
NOT_REQUIRED = {
    "point_speed": "no point's speed is limited",
    "tool_speed": "the tool's speed is free",
}


@pytest.fixture(params=NOT_REQUIRED)
def kind(request):
    """Return which speed is limited: that of the tool or that of points."""
    return request.param


@pytest.fixture
def bar(tmp_path):
    """Return a function from limits to a bar whose tool turns on the lever, in no tube."""
    one_joint(tmp_path)

    def limited(**limits):
        robot = load_robot(
            tmp_path / "bar.urdf",
            "bar",
            tool_offset=ToolOffset(position=POINT),
            limits=LimitOverrides(**limits),
        )
        return anywhere(robot)

    return limited


def points(*speeds, link="bar"):
    return {"point_speed": [PointSpeed(link, POINT, speed) for speed in speeds]}


def limit_of(kind, speed):
    return points(speed) if kind == "point_speed" else {"tool_speed": speed}


def judged(kind, problem, trajectory):
    return verify(problem, trajectory).conditions[kind]


@pytest.mark.parametrize("limit", [0.4, 3.0])
@pytest.mark.parametrize("angle", [0.5, -2.5])
def test_the_margin_is_what_the_fastest_instant_leaves(bar, kind, limit, angle):
    duration = 1.3
    condition = judged(kind, bar(**limit_of(kind, limit)), quintic(angle, duration))
    use = PEAK * abs(angle) / duration / limit
    assert condition.margin == pytest.approx(1 - use, abs=0.02 * use)
    assert (condition.unit, condition.coverage) == ("relative", "for all t")
    where = condition.where
    if kind == "point_speed":
        assert (where.links, where.point_speed) == (("bar",), 0)
    else:
        assert where.segment == 0
    if condition.margin < 0.01:  # not merely bracketed: near the limit it is resolved
        assert where.time == pytest.approx(duration / 2, abs=0.02)


@pytest.mark.parametrize("fraction", [1 - 1e-5, 1 + 1e-5])
def test_a_hundred_thousandth_decides(bar, kind, fraction):
    certificate = verify(bar(**limit_of(kind, PEAK * fraction)), quintic(1.0, 1.0))
    condition = certificate.conditions[kind]
    assert condition.margin == pytest.approx(1 - 1 / fraction, abs=3e-7)
    assert condition.where.time == pytest.approx(0.5, abs=0.02)
    assert (kind in certificate.failures()) == (fraction < 1)


def test_without_a_limit_it_is_not_required(bar, kind):
    condition = judged(kind, bar(), quintic(1.0, 0.01))
    assert (condition.margin, condition.coverage) == (None, NOT_REQUIRED[kind])


def test_a_verdict_that_costs_too_much_is_undecided_and_safe(bar, kind, monkeypatch):
    monkeypatch.setattr(tube_visits, "_MAX_ROWS", 1)
    condition = judged(kind, bar(**limit_of(kind, PEAK)), quintic(1.0, 1.0))
    assert "undecided" in condition.coverage
    assert condition.margin < -1e-6


def test_what_the_polynomials_miss_is_taken_off(bar, kind, monkeypatch):
    """A velocity that may be off by a millimetre per second: a margin lower by as much."""

    def rough(*arguments):
        found = enclosed(*arguments)
        return replace(found, error=found.error + 1e-3)

    problem = bar(**limit_of(kind, PEAK))
    exact = judged(kind, problem, quintic(1.0, 1.0)).margin
    monkeypatch.setattr("tubeplanner.certificate.tool_conditions.enclosed", rough)
    margin = judged(kind, problem, quintic(1.0, 1.0)).margin
    assert margin == pytest.approx(exact - 1e-3 / PEAK, abs=1e-6)


def test_the_bounds_on_the_velocity_are_those_of_a_turning_lever(bar, kind):
    """At a constant rate a, the point is at r exp(i a u), with coefficients r a^k / k!."""
    robot = bar(**points(1.0)).robot
    turned, width = np.array([0.3, 2.0]), np.array([0.1, 3.0])  # per interval [rad], [s]
    joints = np.zeros((9, 2, 1))
    joints[1, :, 0] = turned
    if kind == "point_speed":
        quantity = point_speed._point_velocity(robot, robot.limits.point_speed[0])
    else:
        quantity = tool_speed._velocity(robot)
    bounds = quantity.majorant(joints, width)
    assert bounds.shape == (8, 2, 3)
    reach = np.linalg.norm(POINT)
    for k, bound in enumerate(bounds):
        true = turned ** (k + 1) / factorial(k) / width
        assert (bound >= LEVER * true[:, None]).all()
        assert (bound <= (1 + 1e-9) * reach * true[:, None]).all()


# Points of links.


def test_the_point_with_the_least_margin_is_named(bar):
    condition = judged("point_speed", bar(**points(5.0, 1.0, 3.0)), quintic(1.0, 1.0))
    assert condition.margin == pytest.approx(1 - PEAK, abs=1e-2)
    assert condition.where.point_speed == 1
    assert "bar, point_speed 1, t = " in str(condition.where)


def test_a_point_of_the_base_does_not_move(bar):
    condition = judged("point_speed", bar(**points(0.1, link="base")), quintic(1.0, 1.0))
    assert condition.margin == pytest.approx(1.0)


def test_polynomials_are_as_close_as_the_slowest_limit_asks(bar):
    condition = judged("point_speed", bar(**points(0.001)), quintic(1.0, 2000.0))
    assert condition.margin == pytest.approx(1 - PEAK / 2, abs=0.03 * PEAK / 2)


def test_the_velocity_that_is_enclosed_is_the_robots(robot):
    q, v = np.random.default_rng(3).uniform(-1, 1, (2, 20, robot.joint_count))
    velocity = tool_speed._velocity(robot).values(q, v)
    np.testing.assert_allclose(velocity, robot.tool_velocity(q, v)[0], atol=1e-12)


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


# The tool's speed in segments: a cart on a rail.


MIDDLE, END = 0.3, 0.6  # [m]
FAST, SLOW = 1.0, 0.4  # [m/s]


def cart(slider, radius=0.02, visit="ordered", own=None, **tube):
    """Return the problem of a cart that goes from 0 to 0.6 m in two segments."""
    robot = slider.robot
    robot = load_robot(robot.urdf.path, "cart", limits=LimitOverrides(tool_speed=own))
    points = [[0, 0, 0], [MIDDLE, 0, 0], [END, 0, 0]]
    return PlanningProblem(robot, Tube(points, radius, visit=visit, **tube), np.zeros(1))


def driven(*changes):
    """Return a cart that begins at 1 m/s and drives 0.6 m.

    Args:
        changes: Where it changes its speed evenly, from and to [m], and to which speed [m/s].
    """
    at, speed, rows, widths = 0.0, FAST, [], []
    for low, high, after in (*changes, (END, END, FAST)):
        if low > at:
            rows.append((0.0, speed, at))
            widths.append((low - at) / speed)
        if high > low:
            widths.append(2 * (high - low) / (speed + after))
            rows.append(((after - speed) / (2 * widths[-1]), speed, low))
            at, speed = high, after
    times = np.append(0.0, np.cumsum(widths))
    return JointTrajectory(["slide"], times, np.array(rows).T[:, :, None])


def passes(problem, trajectory):
    return not {"tube", "tool_speed"} & set(verify(problem, trajectory).failures())


SLOWED = driven((0.25, 0.29, SLOW))


@pytest.mark.parametrize(
    ("limits", "own", "margin", "segment"),
    [
        ([2.0, 0.5], None, 0.2, 1),
        ([0.9, None], None, 1 - FAST / 0.9, 0),
        ([None, 0.3], None, 1 - SLOW / 0.3, 1),
        (None, 1.25, 0.2, 0),
        ([2.0, 0.45], 1.25, 1 - SLOW / 0.45, 1),
        ([1.1, 5.0], 1.05, 1 - FAST / 1.05, 0),
        ([1.01, 5.0], 1.05, 1 - FAST / 1.01, 0),
    ],
)
def test_each_segment_has_its_own_limit_and_the_robots(slider, limits, own, margin, segment):
    condition = judged("tool_speed", cart(slider, own=own, tool_speed=limits), SLOWED)
    assert condition.margin == pytest.approx(margin, abs=0.02 * abs(margin) + 1e-6)
    assert condition.where.segment == segment


@pytest.mark.parametrize("limits", [[None, 0.5], [1.2, 0.5]])
@pytest.mark.parametrize("slow_at", [0.29, 0.319, 0.325])
def test_a_hand_over_is_where_both_segments_hold(slider, limits, slow_at):
    """The first capsule ends 20 mm behind the middle: until there the cart must be slow enough."""
    change = 0.02  # [m]
    fraction = (FAST**2 - 0.5**2) / (FAST**2 - SLOW**2)  # of the change, when 0.5 m/s is reached
    trajectory = driven((slow_at - fraction * change, slow_at + (1 - fraction) * change, SLOW))
    assert passes(cart(slider, tool_speed=limits), trajectory) == (slow_at <= MIDDLE + 0.02)


@pytest.mark.parametrize("visit", ["ordered", "any"])
@pytest.mark.parametrize(("fast_from", "holds"), [(0.285, True), (0.2, False)])
def test_a_hand_over_to_a_free_segment_is_as_soon_as_it_is_fast(slider, visit, fast_from, holds):
    """The other way round: slow at first, and fast 20 mm before the middle at the earliest."""
    motion = driven((0.0, 0.01, SLOW), (fast_from, fast_from + 0.02, FAST))
    slow = motion.between(0.03, motion.duration)
    assert passes(cart(slider, visit=visit, tool_speed=[0.45, None]), slow) is holds


def test_segments_on_one_line_are_one_only_if_their_limits_are_the_same(slider):
    for speeds, count in ((0.5, 1), ([0.5, 0.6], 2), ([0.5, None], 2)):
        assert cart(slider, tool_speed=speeds).joined.tube.segment_count == count
    condition = judged("tool_speed", cart(slider, tool_speed=0.41), driven((0.4, 0.42, SLOW)))
    assert condition.where.segment in (0, 1)
    assert condition.margin == pytest.approx(1 - FAST / 0.41, abs=0.03)


def test_margins_at_switching_times_are_those_of_the_condition(slider):
    """One column per segment, or one segment each, as the choice of switching times asks."""
    problem = cart(slider, tool_speed=[2.0, 0.5])
    (margin,) = (found for make in SEGMENT_MARGINS if (found := make(problem, SLOWED)) is not None)
    time = np.array([0.0, 0.1, SLOWED.duration])
    expected = 1 - np.array([FAST, FAST, SLOW])[:, None] / [2.0, 0.5]
    np.testing.assert_allclose(margin.at(time), expected, atol=1e-12)
    segment = np.array([1, 0, 1])
    np.testing.assert_allclose(margin.within(segment, time), expected[np.arange(3), segment])
    free = cart(slider)
    assert all(make(free, SLOWED) is None for make in SEGMENT_MARGINS)


def test_no_limit_is_looked_at_where_none_is(slider):
    motion = JudgedMotion(cart(slider).joined, SLOWED, Tolerance())
    assert JUDGED["tool_speed"](motion).margin is None
    assert "visits" not in motion.__dict__
