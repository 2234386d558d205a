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
from tubeplanner.verification import tube_visits
from tubeplanner.verification.conditions import JUDGED, SEGMENT_MARGINS
from tubeplanner.verification.enclosure import enclosed
from tubeplanner.verification.judged import point_speed, tool_speed
from tubeplanner.verification.judged_motion import JudgedMotion

# The speeds of points against closed forms: a bar that turns.


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


# The tool's speed against closed forms: a bar that turns, a cart on a rail.


SPEED_LEVER, MIDDLE, END = 0.8, 0.3, 0.6  # [m]
FAST, SLOW = 1.0, 0.4  # [m/s]


@pytest.fixture
def speed_bar(tmp_path):
    """Return a function from a limit [m/s] to a bar whose tool turns on a lever, in no tube."""
    one_joint(tmp_path)

    def limited(tool_speed=None):
        return anywhere(
            load_robot(
                tmp_path / "bar.urdf",
                "bar",
                tool_offset=ToolOffset(position=(0.0, SPEED_LEVER, 0.3)),
                limits=LimitOverrides(tool_speed=tool_speed),
            )
        )

    return limited


def speed_judged(problem, trajectory):
    return verify(problem, trajectory).conditions["tool_speed"]


@pytest.mark.parametrize("limit", [0.5, 1.5, 3.0, 100.0])
@pytest.mark.parametrize("angle", [0.3, -2.5])
def test_the_margin_is_what_the_fastest_instant_leaves_of_speed(speed_bar, limit, angle):
    duration = 0.9
    condition = speed_judged(speed_bar(limit), quintic(angle, duration))
    fastest = SPEED_LEVER * 1.875 * abs(angle) / duration
    assert condition.margin == pytest.approx(1 - fastest / limit, abs=0.02 * fastest / limit)
    assert condition.unit == "relative"
    if condition.margin < 0.01:  # not merely bracketed: near the limit it is resolved
        assert condition.where.time == pytest.approx(duration / 2, abs=0.02)
    assert condition.where.segment == 0
    assert condition.coverage == "for all t"


@pytest.mark.parametrize("share", [1 - 1e-5, 1 + 1e-5])
def test_a_hundred_thousandth_decides_of_speed(speed_bar, share):
    fastest = SPEED_LEVER * 1.875
    condition = speed_judged(speed_bar(fastest * share), quintic(1.0, 1.0))
    assert condition.margin == pytest.approx(1 - 1 / share, abs=3e-7)
    certificate = verify(speed_bar(fastest * share), quintic(1.0, 1.0))
    assert ("tool_speed" in certificate.failures()) == (share < 1)


def test_without_a_limit_it_is_not_required_of_speed(speed_bar):
    condition = speed_judged(speed_bar(), quintic(2.0, 0.1))
    assert condition.margin is None
    assert condition.coverage == "the tool's speed is free"


def test_a_verdict_that_costs_too_much_is_undecided_and_safe_of_speed(speed_bar, monkeypatch):
    monkeypatch.setattr(tube_visits, "_MAX_ROWS", 1)
    condition = speed_judged(speed_bar(SPEED_LEVER * 1.875), quintic(1.0, 1.0))
    assert "undecided" in condition.coverage
    assert condition.margin < -1e-6


# --- a cart on a rail: which segment an instant belongs to --------------------------------------


def cart(slider, radius=0.02, visit="ordered", own=None, **tube):
    """Return the problem of a cart that goes from 0 to 0.6 m in two segments."""
    robot = slider.robot
    robot = load_robot(robot.urdf.path, "cart", limits=LimitOverrides(tool_speed=own))
    points = [[0, 0, 0], [MIDDLE, 0, 0], [END, 0, 0]]
    return PlanningProblem(robot, Tube(points, radius, visit=visit, **tube), np.zeros(1))


def driven(*changes, end=END):
    """Return a cart that begins at 1 m/s and takes other speeds, each in a stretch.

    Args:
        changes: Where each stretch begins and ends [m], and the speed that it ends with [m/s]:
            at a constant acceleration.
        end: Where the trajectory ends [m].
    """
    at, speed, rows, widths = 0.0, FAST, [], []
    for low, high, after in (*changes, (end, end, None)):
        if low > at:
            rows.append((0.0, speed, at))
            widths.append((low - at) / speed)
        if after is not None:
            width = 2 * (high - low) / (speed + after)
            rows.append(((after - speed) / (2 * width), speed, low))
            widths.append(width)
            at, speed = high, after
    times = np.append(0.0, np.cumsum(widths))
    return JointTrajectory(["slide"], times, np.array(rows).T[:, :, None])


SLOWED = driven((0.25, 0.29, SLOW))


@pytest.mark.parametrize(
    ("limits", "own", "margin", "segment"),
    [
        ([2.0, 0.5], None, 0.2, 1),
        ([1.25, None], None, 0.2, 0),
        ([None, 0.5], None, 0.2, 1),
        ([0.9, None], None, 1 - FAST / 0.9, 0),
        ([None, 0.3], None, 1 - SLOW / 0.3, 1),
        (None, 1.25, 0.2, 0),
        ([2.0, 0.45], 1.25, 1 - SLOW / 0.45, 1),
        ([1.1, 5.0], 1.05, 1 - FAST / 1.05, 0),
        ([1.01, 5.0], 1.05, 1 - FAST / 1.01, 0),
    ],
)
def test_each_segment_has_its_own_limit_and_the_robots(slider, limits, own, margin, segment):
    condition = speed_judged(cart(slider, own=own, tool_speed=limits), SLOWED)
    assert condition.margin == pytest.approx(margin, abs=0.02 * abs(margin) + 1e-6)
    assert condition.where.segment == segment


@pytest.mark.parametrize("limits", [[None, 0.5], [1.2, 0.5]])
@pytest.mark.parametrize("slow_at", [0.25, 0.29, 0.31, 0.319, 0.325, 0.4])
def test_a_hand_over_is_where_both_segments_hold(slider, limits, slow_at):
    """The first capsule ends 20 mm behind the middle: until there the cart must be slow enough."""
    change = 0.02  # [m]
    share = (FAST**2 - 0.5**2) / (FAST**2 - SLOW**2)  # of the change, when 0.5 m/s is reached
    trajectory = driven((slow_at - share * change, slow_at + (1 - share) * change, SLOW))
    failures = set(verify(cart(slider, tool_speed=limits), trajectory).failures())
    failures &= {"tube", "tool_speed"}
    assert bool(failures) == (slow_at > MIDDLE + 0.02)


def test_a_hand_over_to_a_free_segment_is_as_soon_as_it_is_fast(slider):
    """The other way round: slow at first, and fast 20 mm before the middle at the earliest."""
    begin = driven((0.0, 0.01, SLOW), (0.281, 0.3, FAST))
    early = driven((0.0, 0.01, SLOW), (0.2, 0.24, FAST))
    tube = {"tool_speed": [1.01, None]}
    assert speed_judged(cart(slider, **tube), begin).margin > -1e-6
    tight = cart(slider, tool_speed=[0.45, None])
    for trajectory, passes in ((begin, True), (early, False)):
        after = trajectory.between(0.03, trajectory.duration)
        failures = set(verify(tight, after).failures()) & {"tube", "tool_speed"}
        assert bool(failures) != passes


@pytest.mark.parametrize(("fast_from", "passes"), [(0.285, True), (0.2, False)])
def test_in_a_union_any_segment_that_holds_will_do(slider, fast_from, passes):
    """Of two capsules the tool is in either: it may be fast as soon as it is in the free one."""
    slow = driven((0.0, 0.01, SLOW), (fast_from, fast_from + 0.02, FAST))
    slow = slow.between(0.03, slow.duration)
    problem = cart(slider, visit="any", tool_speed=[0.45, None])
    failures = set(verify(problem, slow).failures()) & {"tube", "tool_speed"}
    assert bool(failures) != passes


def test_segments_on_one_line_are_one_only_if_their_limits_are_the_same(slider):
    equal = cart(slider, tool_speed=0.5).joined.tube
    assert (equal.segment_count, equal.tool_speed.tolist()) == (1, [0.5])
    assert cart(slider, tool_speed=[0.5, 0.6]).joined.tube.segment_count == 2
    assert cart(slider, tool_speed=[0.5, None]).joined.tube.segment_count == 2
    condition = speed_judged(cart(slider, tool_speed=0.41), driven((0.4, 0.42, SLOW)))
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


def test_what_the_polynomials_miss_is_taken_off_of_speed(speed_bar, monkeypatch):
    """A velocity that may be off by a millimetre per second: a margin that is lower by as much."""

    def rough(*given):
        found = enclosed(*given)
        return replace(found, error=found.error + 1e-3)

    limit = SPEED_LEVER * 1.875
    exact = speed_judged(speed_bar(limit), quintic(1.0, 1.0)).margin
    monkeypatch.setattr(tool_speed, "enclosed", rough)
    margin = speed_judged(speed_bar(limit), quintic(1.0, 1.0)).margin
    assert margin == pytest.approx(exact - 1e-3 / limit, abs=1e-6)


def test_the_bounds_on_the_velocity_are_those_of_a_turning_lever_of_speed(speed_bar):
    """At a constant rate a, the tool is at r exp(i a u), with coefficients r a^k / k!."""
    problem = speed_bar(1.0)
    turned, width = np.array([0.3, 2.0]), np.array([0.1, 3.0])  # per interval [rad], [s]
    joints = np.zeros((9, 2, 1))
    joints[1, :, 0] = turned
    bounds = tool_speed._velocity(problem.robot).majorant(joints, width)
    assert bounds.shape == (8, 2, 3)
    reach = np.hypot(SPEED_LEVER, 0.3)
    for k, bound in enumerate(bounds):
        true = turned ** (k + 1) / factorial(k) / width
        assert (bound >= SPEED_LEVER * true[:, None]).all()
        assert (bound <= (1 + 1e-9) * reach * true[:, None]).all()


def test_the_velocity_that_is_enclosed_is_the_robots(robot):
    q, v = np.random.default_rng(3).uniform(-1, 1, (2, 20, robot.joint_count))
    velocity = tool_speed._velocity(robot).values(q, v)
    np.testing.assert_allclose(velocity, robot.tool_velocity(q, v)[0], atol=1e-12)
