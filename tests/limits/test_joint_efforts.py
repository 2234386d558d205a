"""Effort limits by direction, position and speed; torque-speed lines; holding efforts at rest."""

from dataclasses import replace

import numpy as np
import pytest
from cases import INERTIA, anywhere, one_joint, with_motors

from tubeplanner import PlanningProblem, Tube, plan
from tubeplanner.limits.joint_efforts import (
    EffortLimit,
    JointEffort,
    MotorCurve,
    effort_refusal,
    require_held,
)
from tubeplanner.limits.path_samples import PathSamples
from tubeplanner.limits.speed_limits import speed_limits
from tubeplanner.outcome import Infeasible, PlanStatus
from tubeplanner.robot.joint_limits import EffortRange

SPEED, LEVEL = 1.7, np.zeros(1)
LEVER, GRAVITY = 0.5, 9.81
HELD = GRAVITY * LEVER  # weight of 1 kg, the bar level [N m]; its effort limit is 5
VISCOUS, BACK, FORTH, UNSURE, ARMATURE = 0.8, 0.9, 0.3, 0.2, 0.4
DRY = {"backwards_friction": BACK, "forwards_friction": FORTH}
BY_JOINT = {"backwards_friction": np.arange(6.0) + 11, "forwards_friction": np.arange(6.0) + 1}
STALL, NO_LOAD = 6.0, 4.0
LINE = {"saturation_effort": STALL, "no_load_velocity": NO_LOAD}


def table(position, forwards, backwards=None):
    """Return the effort limits of the bar's motor, by position."""
    backwards = forwards if backwards is None else backwards
    return EffortRange(0, *(np.array(each) for each in (position, backwards, forwards)))


def pair(backwards, forwards):
    return table([0.0], [forwards], [backwards])


def dry(effort):
    return {"forwards_friction": effort, "backwards_friction": effort}


FALLING = table([0.0, 2.0], [4.0, 2.0])


@pytest.fixture
def bar(tmp_path):
    """Return a function from mass [kg] and motor to a bar that turns about a level axis."""

    def made(*ranges, mass=0.0, **motors):
        return with_motors(one_joint(tmp_path, mass=mass), ranges, **motors)

    return made


def path(robot, q, v, a):
    return PathSamples(anywhere(robot), np.array([[[q]], [[v]], [[a]]], dtype=float))


def random_samples(robot, count, seed, low=-1.0):
    states = np.random.default_rng(seed).uniform(low, 1, (3, count, robot.joint_count))
    return PathSamples(anywhere(robot), states)


def largest_speed(kind, robot, q, v, a):
    limit = kind(robot.limits if kind is EffortLimit else robot.motors)
    return float(limit.used(path(robot, q, v, a)).largest_speed(limit.signs).min())


def said(robot, joint=0, sample=0, q=(0.0,)):
    states = np.zeros((3, len(q), robot.joint_count))
    states[0, :, 0] = q
    return effort_refusal(PathSamples(anywhere(robot), states), sample, joint, 7.126, 5.0)


@pytest.mark.parametrize(
    ("motors", "against"),
    [
        ({"viscous_friction": 9.0}, "gravity alone"),
        ({"forwards_friction": 1.0}, "gravity and friction"),
        ({"backwards_friction": 1.0}, "gravity and friction"),
    ],
)
def test_friction_is_spoken_of_where_there_is_some(bar, motors, against):
    refusal = said(bar(**motors))
    assert refusal.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    expected = f"joint 'turn' needs 7.13 N m against {against}, its effort limit is 5.00; choose"
    assert str(refusal).startswith(expected)


def test_the_place_is_where_the_tool_is(slide):
    """Of the sample that is meant; forces have another unit than moments."""
    refusal = said(slide, joint=1, sample=1, q=(0.0, np.pi / 2))
    assert "needs 7.13 N against" in str(refusal)
    np.testing.assert_allclose(refusal.location.position, [0.0, 0.6, 0.5], atol=1e-9)
    assert refusal.location.joint == "extend"


@pytest.mark.parametrize(("counts", "viscous"), [(True, 3.0), (False, 0.0)])
def test_coulomb_friction_counts_where_it_is_asked_for(ur5, viscous, counts):
    """And not where rounding alone says which way a joint moves."""
    arm = with_motors(ur5, viscous_friction=viscous, **BY_JOINT)
    q, v, a = np.random.default_rng(3).uniform(-1, 1, (3, 4, 6))
    v[1] *= 1e-9
    limit = np.array([150.0, np.inf, 150.0, 28.0, 28.0, 28.0])
    own = JointEffort(limit, with_coulomb_friction=counts)
    used = own.used(PathSamples(anywhere(arm), np.stack([q, v, a]))).at(SPEED)
    effort = ur5.inverse_dynamics(q, SPEED * v, SPEED**2 * a) + viscous * SPEED * v
    rubbing = np.where(v > 0, np.arange(6) + 1, -np.arange(6) - 11) * counts
    rubbing[1] = 0
    columns = [0, 2, 3, 4, 5]
    np.testing.assert_allclose(
        used, ((effort + rubbing) / limit)[:, columns], rtol=1e-10, atol=1e-12
    )


@pytest.mark.parametrize("v", [1.5, -1.5])
def test_upwards_the_most_counts_and_downwards_the_least(bar, v):
    q, a, mass = 0.3, 2.0, 0.5
    unsure = {"friction_uncertainty": UNSURE, "viscous_friction": VISCOUS}
    robot = bar(mass=mass, armature=ARMATURE, **unsure, **DRY)
    limit = EffortLimit(robot.limits)
    terms = limit.used(path(robot, q, v, a)).terms
    rubbing = FORTH if v > 0 else -BACK
    inertia = INERTIA + mass * LEVER**2 + ARMATURE
    for column, sign in enumerate((1.0, -1.0)):
        expected = {
            0: sign * (mass * HELD * np.cos(q) + rubbing) + UNSURE * abs(rubbing),
            1: sign * VISCOUS * v + UNSURE * VISCOUS * abs(v),
            2: sign * inertia * a,
        }
        used = {k: term[0, column] * limit.limit[column] for k, term in terms.items()}
        assert used == pytest.approx(expected)


@pytest.mark.parametrize(
    ("ranges", "motors", "state", "available"),
    [
        (pair(3.0, 8.0), DRY, (0, 1, 2.0), 8 - FORTH),
        (pair(3.0, 8.0), DRY, (0, 1, -2.0), 3 + FORTH),
        (pair(3.0, 8.0), DRY, (0, -1, 2.0), 8 + BACK),
        (pair(3.0, 8.0), DRY, (0, -1, -2.0), 3 - BACK),
        (FALLING, {}, (-1.0, 0.5, 2.0), 4.0),
        (FALLING, {}, (0.5, 0.5, -2.0), 3.5),
        (FALLING, {}, (3.0, 0.5, -2.0), 2.0),
    ],
)
def test_each_way_and_place_has_its_own_limit_and_friction(bar, ranges, motors, state, available):
    result = largest_speed(EffortLimit, bar(ranges, **motors), *state)
    assert result == pytest.approx(np.sqrt(available / (INERTIA * 2.0)))


def test_shares_are_of_the_most_and_allowed_is_less(bar):
    robot = bar(FALLING, **DRY)
    used = EffortLimit(robot.limits).used(path(robot, 1.0, 1.0, 2.0))
    np.testing.assert_allclose(used.allowed, [[0.75, 0.75]])
    effort = np.array([1.0, -1.0]) * (INERTIA * 2.0 + FORTH)
    np.testing.assert_allclose(used.at(1.0), [effort / 4 + 0.25])


def test_joints_without_a_limit_are_left_out(ur5):
    """The others keep their own: friction and ranges are not those of a neighbour."""
    effort = np.array([np.inf, 100.0, np.inf, 28.0, 28.0, np.inf])
    arm = with_motors(ur5, forwards_friction=np.arange(6.0) + 1)
    narrow = EffortRange(3, np.zeros(1), np.array([7.0]), np.array([14.0]))
    limit = EffortLimit(replace(arm.limits, effort=effort, effort_ranges=(narrow,)))
    assert [key.joint for key in limit.keys] == [1, 3, 4]
    assert limit.joints.tolist() == [1, 3, 4, 1, 3, 4]
    assert limit.limit.tolist() == [100.0, 14.0, 28.0, 100.0, 7.0, 28.0]
    at = random_samples(arm, 2, seed=0, low=0.1)
    effort = ur5.inverse_dynamics(*at.by_path) + np.arange(6) + 1
    fractions = np.hstack([effort[:, [1, 3, 4]], -effort[:, [1, 3, 4]]]) / limit.limit
    np.testing.assert_allclose(limit.used(at).at(1.0), fractions)
    assert limit.key_of(at).tolist() == [[0, 1, 2, 0, 1, 2]]


@pytest.mark.parametrize(
    ("motors", "ranges", "name"),
    [
        ({"viscous_friction": 1.0}, [], "JointEffort"),
        ({"armature": 1.0, "friction_uncertainty": 0.1}, [], "JointEffort"),
        ({"forwards_friction": 1.0}, [], "EffortLimit"),
        ({"backwards_friction": 1.0}, [], "EffortLimit"),
        ({"viscous_friction": 1.0, "friction_uncertainty": 0.1}, [], "EffortLimit"),
        ({}, [pair(3.0, 8.0)], "EffortLimit"),
    ],
)
def test_it_is_asked_where_the_simpler_kind_does_not_serve(bar, motors, ranges, name):
    problem = anywhere(bar(*ranges, **motors))
    (own,) = [limit for limit in speed_limits(problem) if limit.kind == "effort"]
    assert type(own).__name__ == name


# Torque-speed lines: closed forms of a bar, and which speeds a motor can have.


@pytest.mark.parametrize(("sign", "drives"), [(1.0, True), (-1.0, True), (1.0, False)])
def test_who_drives_has_less_than_who_brakes(bar, sign, drives):
    """(I a) s^2 / S +- v s / V = 1, whose first root counts."""
    assert largest_speed(MotorCurve, bar(**LINE), 0.0, sign * 2.0, 0.0) == pytest.approx(
        NO_LOAD / 2
    )
    v, a = sign * 2.0, sign * (3.0 if drives else -3.0)
    inertia, slope = INERTIA * 3.0 / STALL, 2.0 / NO_LOAD
    roots = np.roots([inertia, slope if drives else -slope, -1])
    assert largest_speed(MotorCurve, bar(**LINE), 0.0, v, a) == pytest.approx(max(roots))


def test_only_joints_with_a_line_have_one(ur5):
    stall, no_load = np.full((2, 6), np.inf)
    stall[[1, 4]], no_load[[1, 4]] = (300.0, 40.0), (3.0, 5.0)
    arm = with_motors(ur5, saturation_effort=stall, no_load_velocity=no_load)
    limit, at = MotorCurve(arm.motors), random_samples(arm, 7, seed=0)
    assert [key.joint for key in limit.keys] == [1, 4]
    effort, v = ur5.inverse_dynamics(*at.by_path)[:, [1, 4]], at.by_path[1][:, [1, 4]]
    fractions = effort / [300.0, 40.0] + v / [3.0, 5.0]
    np.testing.assert_allclose(limit.used(at).at(1.0), np.hstack([fractions, -fractions]))
    assert limit.key_of(at).tolist() == [[0, 1, 0, 1]]
    assert MotorCurve(ur5.motors).keys == ()


@pytest.mark.parametrize(
    ("kind", "ranges", "motors", "state", "needed", "limit"),
    [
        (EffortLimit, [FALLING], DRY, (0.0, 1.0), HELD + FORTH, 4.0),
        (EffortLimit, [FALLING], DRY, (0.0, -1.0), HELD - BACK, 4.0),
        (EffortLimit, [FALLING], dry(1.0), (1.0, 1.0), HELD * np.cos(1.0) + 1, 3.0),
        (EffortLimit, [pair(0.5, 9.0)], dry(6.0), (0.0, -1.0), 6 - HELD, 0.5),
        (MotorCurve, [], LINE | dry(1.203), (0.0, 1.0), HELD + 1.203, STALL),
        (MotorCurve, [], LINE | dry(11.103), (0.0, -1.0), 11.103 - HELD, STALL),
    ],
)
def test_what_cannot_be_moved_slowly_is_named_with_what_it_lacks(
    bar, kind, ranges, motors, state, needed, limit
):
    """Weight and the friction of its way against what the motor has there."""
    robot = bar(*ranges, mass=1.0, **motors)
    assert largest_speed(kind, robot, *state, 0.0) == 0.0
    own = kind(robot.limits if kind is EffortLimit else robot.motors)
    refusal = own.refusal(path(robot, *state, 0.0))
    assert (refusal.status, refusal.location.joint) == (PlanStatus.GRAVITY_EXCEEDS_EFFORT, "turn")
    assert f"needs {needed:.2f} N m against gravity and friction" in str(refusal)
    assert f"its effort limit is {limit:.2f};" in str(refusal)


@pytest.mark.parametrize(
    ("mass", "ranges", "motors"),
    [
        (1.0, [], dry(2.0)),  # upwards it is blocked, downwards not
        (2.0, [], dry(5.0)),  # friction holds what the motor could not
        (1.0, [pair(5.0, 4.0)], dry(1.0)),
        (1.0, [pair(0.1, 5.0)], {"backwards_friction": 9.0}),  # downwards it is
        (1.0, [], dry(12.0)),  # neither way: it stands still
        (1.0, [], {"saturation_effort": 5.0, "no_load_velocity": 1.0}),
    ],
)
def test_one_way_is_enough(bar, mass, ranges, motors):
    require_held(anywhere(bar(*ranges, mass=mass, **motors)), LEVEL)


@pytest.mark.parametrize(
    ("mass", "ranges", "motors", "needed", "limit"),
    [
        (2.0, [], dry(1.0), 2 * HELD - 1, 5.0),
        (1.0, [pair(2.0, 4.0)], {}, HELD, 4.0),
        (1.0, [pair(2.0, 4.0)], dry(7.0), 7.0 - HELD, 2.0),
        (1.0, [], {"saturation_effort": 4.5, "no_load_velocity": 1.0}, HELD, 4.5),
        # Less of both: what is lost is the same, and friction may hold less.
        (2.0, [], dry(4.7) | {"friction_uncertainty": 0.5}, 2 * HELD - 4.7 * 0.5, 5.0),
    ],
)
def test_blocked_both_ways_is_refused_with_joint_and_place(
    bar, mass, ranges, motors, needed, limit
):
    with pytest.raises(Infeasible) as caught:
        require_held(anywhere(bar(*ranges, mass=mass, **motors)), LEVEL)
    assert caught.value.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    assert caught.value.location.joint == "turn"
    assert np.shape(caught.value.location.position) == (3,)
    assert f"needs {needed:.2f} N m against gravity" in str(caught.value)
    assert f"its effort limit is {limit:.2f};" in str(caught.value)


def test_the_table_counts_where_the_joint_is(bar):
    problem = anywhere(bar(table([0.0, 1.0], [9.0, 1.0]), mass=1.0))
    require_held(problem, LEVEL)
    with pytest.raises(Infeasible, match=r"needs 2\.65 N m .* limit is 1\.00;"):
        require_held(problem, np.ones(1))


def test_where_friction_locks_every_joint_nothing_leaves(ur5):
    """The joint that lacks most is named; one joint that can go backwards is enough."""
    q = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
    friction = np.array([200.0, 300.0, 400.0, 200.0, 100.0, 100.0])
    backwards = friction - np.array([200.0, 0, 0, 0, 0, 0])
    locked = with_motors(ur5, forwards_friction=friction, backwards_friction=friction)
    require_held(anywhere(locked), q)
    with pytest.raises(Infeasible, match="elbow_joint") as caught:
        require_held(anywhere(locked), q, must_leave=True)
    effort = abs(ur5.gravity_effort(q[None])[0, 2])
    assert f"needs {400 - effort:.2f} N m against gravity and friction" in str(caught.value)
    arm = with_motors(ur5, forwards_friction=friction, backwards_friction=backwards)
    require_held(anywhere(arm), q, must_leave=True)


def test_planning_refuses_it(bar):
    tube = Tube([[0.0, 0, 0], [1.0, 0, 0]], 1000.0)
    problem = PlanningProblem(bar(mass=2.0), tube, LEVEL, np.array([0.5]), self_collision=False)
    assert plan(problem).status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
