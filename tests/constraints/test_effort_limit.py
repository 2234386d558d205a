"""Effort limits that differ by direction or position, with friction: closed forms of a bar."""

from dataclasses import replace

import numpy as np
import pytest

from cases import INERTIA, anywhere, one_joint, with_motors
from tubeplanner.constraints.effort_limit import EffortLimit
from tubeplanner.constraints.joint_effort import JointEffort
from tubeplanner.constraints.path_samples import PathSamples
from tubeplanner.constraints.speed_limits import speed_limits
from tubeplanner.outcome import PlanStatus
from tubeplanner.robot.effort_range import EffortRange

BACK, FORTH, VISCOUS = 0.9, 0.3, 0.8
FRICTION = {"backwards_friction": BACK, "forwards_friction": FORTH}
PAIR = EffortRange(0, np.zeros(1), np.array([3.0]), np.array([8.0]))
TABLE = EffortRange(0, np.array([0.0, 2.0]), np.array([4.0, 2.0]), np.array([4.0, 2.0]))


def path(robot, q, v, a):
    rows = np.array([[[q]], [[v]], [[a]]], dtype=float)
    return PathSamples(anywhere(robot), rows)


def speed(robot, q, v, a):
    limit = EffortLimit(robot.limits)
    return float(limit.used(path(robot, q, v, a)).largest_speed(limit.signs).min())


@pytest.mark.parametrize(
    ("q", "v", "a", "available"),
    [
        (0, 1, 2.0, 8 - FORTH),
        (0, 1, -2.0, 3 + FORTH),
        (0, -1, 2.0, 8 + BACK),
        (0, -1, -2, 3 - BACK),
    ],
)
def test_each_way_has_its_own_limit_and_friction(tmp_path, q, v, a, available):
    robot = with_motors(one_joint(tmp_path), [PAIR], **FRICTION)
    assert speed(robot, q, v, a) == pytest.approx(np.sqrt(available / (INERTIA * abs(a))))


@pytest.mark.parametrize(("q", "allowed"), [(-1.0, 4.0), (0.5, 3.5), (1.75, 2.25), (3.0, 2.0)])
@pytest.mark.parametrize("a", [2.0, -2.0])
def test_a_table_is_what_the_motor_has_there(tmp_path, q, allowed, a):
    robot = with_motors(one_joint(tmp_path), [TABLE])
    assert speed(robot, q, 0.5, a) == pytest.approx(np.sqrt(allowed / (INERTIA * abs(a))))


def test_shares_are_of_the_most_and_allowed_is_less(tmp_path):
    robot = with_motors(one_joint(tmp_path), [TABLE], **FRICTION)
    used = EffortLimit(robot.limits).used(path(robot, 1.0, 1.0, 2.0))
    np.testing.assert_allclose(used.allowed, [[0.75, 0.75]])
    effort = np.array([1.0, -1.0]) * (INERTIA * 2.0 + FORTH)
    np.testing.assert_allclose(used.at(1.0), [effort / 4 + 0.25])


@pytest.mark.parametrize("table", [PAIR, TABLE])
def test_its_change_with_the_path_is_that_of_differences(tmp_path, table):
    robot = with_motors(one_joint(tmp_path, mass=0.5), [table], viscous_friction=VISCOUS)
    limit, here, step = EffortLimit(robot.limits), np.array([0.7, 0.9, 2.0]), 1e-6
    exact = limit.by_path(path(robot, *here), 1.3)
    for order, shift in enumerate(step * np.eye(3)):
        sides = [limit.used(path(robot, *(here + s * shift))).at(1.3) for s in (1, -1)]
        slope = (sides[0] - sides[1]) / (2 * step)
        np.testing.assert_allclose(exact[order][:, :, 0], slope, atol=1e-8)


def test_joints_without_a_limit_are_left_out(ur5):
    """The others keep their own: friction and ranges are not those of a neighbour."""
    effort = np.array([np.inf, 100.0, np.inf, 28.0, 28.0, np.inf])
    arm = with_motors(ur5, forwards_friction=np.arange(6.0) + 1)
    narrow = EffortRange(3, np.zeros(1), np.array([7.0]), np.array([14.0]))
    limit = EffortLimit(replace(arm.limits, effort=effort, effort_ranges=(narrow,)))
    assert [key.joint for key in limit.keys] == [1, 3, 4]
    assert limit.joints.tolist() == [1, 3, 4, 1, 3, 4]
    assert limit.limit.tolist() == [100.0, 14.0, 28.0, 100.0, 7.0, 28.0]
    at = PathSamples(anywhere(arm), np.random.default_rng(0).uniform(0.1, 1, (3, 2, 6)))
    effort = ur5.inverse_dynamics(*at.by_path) + np.arange(6) + 1
    shares = np.hstack([effort[:, [1, 3, 4]], -effort[:, [1, 3, 4]]]) / limit.limit
    np.testing.assert_allclose(limit.used(at).at(1.0), shares)
    assert limit.key_of(at).tolist() == [[0, 1, 2, 0, 1, 2]]


def test_what_cannot_be_moved_slowly_is_named_with_what_it_lacks(tmp_path):
    """4.905 N m of weight and the friction of its way against what the table has there."""
    robot = with_motors(one_joint(tmp_path, mass=1.0), [TABLE], **FRICTION)
    at = path(robot, 0.0, 1.0, 0.0)
    assert speed(robot, 0.0, 1.0, 0.0) == 0.0
    assert speed(robot, 0.0, -1.0, 0.0) == 0.0
    refusal = EffortLimit(robot.limits).refusal(at)
    assert refusal.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    assert refusal.place.joint == "turn"
    needed = f"needs {4.905 + FORTH:.2f} N m against gravity and friction"
    assert f"{needed}, its effort limit is 4.00;" in str(refusal)
    weak = with_motors(one_joint(tmp_path, mass=1.0), [TABLE], forwards_friction=1.0)
    message = str(EffortLimit(weak.limits).refusal(path(weak, 1.0, 1.0, 0.0)))
    assert f"needs {4.905 * np.cos(1.0) + 1:.2f} N m" in message
    assert "its effort limit is 3.00;" in message
    down = one_joint(tmp_path, mass=1.0)
    pair = EffortRange(0, np.zeros(1), np.array([0.5]), np.array([9.0]))
    blocked = with_motors(down, [pair], backwards_friction=6.0)
    message = str(EffortLimit(blocked.limits).refusal(path(blocked, 0.0, -1.0, 0.0)))
    assert f"needs {6.0 - 4.905:.2f} N m" in message
    assert "its effort limit is 0.50;" in message


@pytest.mark.parametrize(
    ("motors", "ranges", "name"),
    [
        ({}, [], "JointEffort"),
        ({"viscous_friction": 1.0}, [], "JointEffort"),
        ({"armature": 1.0, "friction_uncertainty": 0.1}, [], "JointEffort"),
        ({"forwards_friction": 1.0}, [], "EffortLimit"),
        ({"backwards_friction": 1.0}, [], "EffortLimit"),
        ({"viscous_friction": 1.0, "friction_uncertainty": 0.1}, [], "EffortLimit"),
        ({}, [PAIR], "EffortLimit"),
    ],
)
def test_it_is_asked_where_the_simpler_kind_does_not_serve(tmp_path, motors, ranges, name):
    problem = anywhere(with_motors(one_joint(tmp_path), ranges, **motors))
    (own,) = [limit for limit in speed_limits(problem) if limit.kind == "effort"]
    assert type(own).__name__ == name


def test_where_both_kinds_serve_they_agree(ur5):
    arm = with_motors(ur5, viscous_friction=np.arange(6.0))
    at = PathSamples(anywhere(arm), np.random.default_rng(1).uniform(-1, 1, (3, 50, 6)))
    one, other = EffortLimit(arm.limits), JointEffort(arm.limits.effort)
    speeds = [limit.used(at).largest_speed(limit.signs).min(axis=1) for limit in (one, other)]
    np.testing.assert_allclose(*speeds, rtol=1e-12)
