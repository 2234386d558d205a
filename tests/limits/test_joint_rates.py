"""Velocity (also by position), acceleration and jerk limits."""

import numpy as np
import pytest
from cases import anywhere, changed, one_joint, quintic

from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.limits.rates import (
    VelocityByPositionLimit,
    approachable_range,
    require_approachable,
)
from tubeplanner.limits.speed_limits import scaled_to_limits, scaling_factor
from tubeplanner.outcome import Infeasible, PlanStatus

DECELERATION, OFFSET, LOWER, UPPER = 4.0, 0.6, -1.0, 2.0
ZONE = OFFSET**2 / (2 * DECELERATION)  # how near to its ends the joint may not move towards them
LAW = {"deceleration": DECELERATION, "offset": OFFSET, "lower": LOWER, "upper": UPPER}
FASTEST = 4.0  # the joint's velocity limit [rad/s]


@pytest.fixture
def limited(tmp_path):
    """Return a function from changes of the law to a problem of the bar and the limit."""

    def made(velocity=FASTEST, **changes):
        law = {"velocity_by_position": LAW | changes, "velocity": velocity}
        problem = anywhere(one_joint(tmp_path, **law))
        return problem, VelocityByPositionLimit(problem.robot.limits)

    return made


def path(problem, q, rate):
    q, rate = (np.atleast_1d(np.asarray(each, dtype=float))[:, None] for each in (q, rate))
    return PathSamples(problem, np.stack([q, rate, 0 * q]))


@pytest.mark.parametrize(
    ("q", "up", "down"),
    [
        (0.0, np.sqrt(16.0) - OFFSET, np.sqrt(8.0) - OFFSET),
        (UPPER - 2 * ZONE, (np.sqrt(2) - 1) * OFFSET, np.sqrt(8 * (3 - 2 * ZONE)) - OFFSET),
        (UPPER - 0.9 * ZONE, 0.0, np.sqrt(8 * (3 - 0.9 * ZONE)) - OFFSET),
        (UPPER + 0.1, 0.0, np.sqrt(8 * 3.1) - OFFSET),
        (LOWER, np.sqrt(24.0) - OFFSET, 0.0),
    ],
)
def test_it_is_the_law_each_way(limited, q, up, down):
    problem, limit = limited()
    np.testing.assert_allclose(limit.allowed(np.array([[q]])), [[up, down]], atol=1e-12)
    for rate, allowed in ((0.7, up), (-0.7, down)):
        at = path(problem, q, rate)
        used = limit.used(at)
        speed = used.largest_speed(limit.signs).min()
        assert speed == pytest.approx(allowed / 0.7, abs=1e-12)
        if allowed > 0:
            assert used.at(speed).max() == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(used.allowed * FASTEST, [[up, down]], atol=1e-12)


def test_where_it_falls_to_a_share_of_the_largest(limited):
    """Of the joint's own limit, or of the law's largest."""
    _, limit = limited()
    assert limit.limit.tolist() == [FASTEST, FASTEST]
    free = limited(velocity=np.inf)[1].limit
    assert free.tolist() == [np.sqrt(2 * DECELERATION * (UPPER - LOWER))] * 2
    np.testing.assert_allclose(limit.edge(), [UPPER - ZONE, LOWER + ZONE])
    for column, q in enumerate(limit.edge(0.5).tolist()):
        assert limit.allowed(np.array([[q]]))[0, column] == pytest.approx(0.5 * FASTEST)


@pytest.mark.parametrize("q", [UPPER, LOWER + ZONE / 2])
def test_near_an_end_a_joint_may_rest_and_leave(limited, q):
    problem, limit = limited()
    column, away = (0, -1.0) if q > 0 else (1, 1.0)

    def largest_speed(rate):
        return limit.used(path(problem, q, rate)).largest_speed(limit.signs)[0, column]

    assert [largest_speed(rate) for rate in (0.0, 1e-12, -1e-12, 0.3 * away)] == [np.inf] * 4
    assert largest_speed(-1e-6 * away) == 0.0
    # That it must not come back is asked all the same.
    assert limit.used(path(problem, q, 0.3 * away)).terms[0][0, column] == 1.0


def test_one_that_moves_on_is_refused_by_name(limited):
    problem, limit = limited()
    at = path(problem, [0.0, UPPER - ZONE / 2, UPPER - ZONE / 2], [1.0, -1.0, 1.0])
    reason = limit.refusal(at)
    assert reason.status is PlanStatus.NO_TRAJECTORY
    assert reason.location.joint == "turn"
    edge = f"{UPPER - ZONE / 2:.4f}"
    assert f"moves up at {edge}, where limits.velocity_by_position" in str(reason)
    assert f"from {UPPER - ZONE:.4f} on" in str(reason)
    assert "moves down at -1.0000" in str(limit.refusal(path(problem, LOWER, -1.0)))


def test_away_from_its_end_and_where_it_must_not_move_the_place_does_not_count(limited):
    """No row is made of what is not asked: the slope of the law is 0 there."""
    problem, limit = limited()
    at = path(problem, [1.5, 1.5, UPPER - ZONE / 2], [0.5, -0.5, 0.5])
    slope = limit.by_path(at, 2.0)[0][..., 0] * FASTEST
    root_up, root_down = np.sqrt(8 * 0.5), np.sqrt(8 * 2.5)
    expected = [[DECELERATION / root_up, 0], [0, -DECELERATION / root_down], [0, 0]]
    np.testing.assert_allclose(slope, expected, atol=1e-12)
    rate = limit.by_path(at, 2.0)[1][..., 0] * FASTEST
    np.testing.assert_allclose(rate, [[2.0, -2.0]] * 3)
    assert limit.used(at).terms[0][0, 1] == 0.0
    assert [(key.kind, key.joint) for key in limit.keys] == [("velocity_by_position", 0)]
    assert limit.key_of(at).tolist() == [[0, 0]]
    # At the very end of a law without an offset the slope is finite.
    problem, limit = limited(offset=0.0)
    slope = limit.by_path(path(problem, [UPPER - 1e-15, LOWER + 1e-15], [0.1, -0.1]), 1.0)[0]
    assert np.isfinite(slope).all()
    assert 1.0 < slope[0, 0, 0] < 1e4


@pytest.mark.parametrize("sign", [1, -1])
def test_a_shape_is_run_as_fast_as_the_law_lets_it(limited, sign):
    """From 0 to nine tenths of the way to the zone: against samples of the closed form."""
    problem, limit = limited()
    end = UPPER - ZONE if sign > 0 else LOWER + ZONE
    shape = quintic(0.9 * end, 1.0)
    at = shape.at(np.linspace(0, 1, 50_001)[1:-1])
    allowed = limit.allowed(at.position)[:, 0 if sign > 0 else 1]
    slowest = (abs(at.velocity[:, 0]) / allowed).max()
    factor = scaling_factor(problem, at.position, at.velocity, at.acceleration)
    assert factor.min() == pytest.approx(1 / slowest)
    assert scaled_to_limits(problem, shape).duration == pytest.approx(slowest, rel=1e-6)
    with pytest.raises(Infeasible, match="moves up" if sign > 0 else "moves down"):
        scaled_to_limits(problem, quintic(end + sign * ZONE / 2, 1.0))


def test_the_range_ends_where_a_hundredth_of_the_largest_velocity_is_left(limited, tmp_path):
    """But start and goal are inside; no law, or one that leaves no range, bounds nothing."""
    problem, limit = limited()
    lower, upper = approachable_range(problem)
    assert limit.allowed(upper[None])[0, 0] == pytest.approx(0.01 * FASTEST)
    assert limit.allowed(lower[None])[0, 1] == pytest.approx(0.01 * FASTEST)
    for start, goal in ((1.99, 0.0), (-0.99, 1.99)):
        ends = changed(problem, start=np.array([start]), goal=np.array([goal]))
        assert approachable_range(ends)[0][0] == min(lower[0], start, goal)
        assert approachable_range(ends)[1][0] == max(upper[0], start, goal)
    free = anywhere(one_joint(tmp_path))
    for unbounded in (free, limited(offset=30.0)[0]):
        assert np.ravel(approachable_range(unbounded)).tolist() == [-np.inf, np.inf]
    require_approachable(free, np.zeros(1), np.full(1, 8.9))


@pytest.mark.parametrize(
    ("start", "goal", "offset", "passes"),
    [
        (0.0, UPPER - ZONE - 1e-6, 0.6, True),
        (0.0, UPPER - ZONE, 0.6, False),
        (2.0, UPPER - ZONE / 2, 0.6, True),
        (UPPER - ZONE / 2, UPPER - ZONE / 2, 0.6, True),
        (UPPER - ZONE / 2, 2.0, 0.6, False),
        (-1.0, LOWER + ZONE / 2, 0.6, True),
        (0.0, 2.1, 0.0, False),
    ],
)
def test_a_goal_is_come_to_only_where_the_law_lets_one(limited, start, goal, offset, passes):
    problem, ends = limited(offset=offset)[0], (np.array([start]), np.array([goal]))
    if passes:
        require_approachable(problem, *ends)
        return
    with pytest.raises(Infeasible, match="allows it no velocity that way") as caught:
        require_approachable(problem, *ends)
    assert caught.value.location.joint == "turn"
