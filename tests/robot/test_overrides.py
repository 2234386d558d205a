"""LimitOverrides, MotorOverrides of a problem: per joint, by direction or position, of points."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal as same

from refusals import refusal
from tubeplanner import (
    LimitLayer,
    LimitOverrides,
    MotorOverrides,
    PointSpeed,
    RobotError,
    load_robot,
)
from tubeplanner.robot.effort_range import EffortRange
from tubeplanner.robot.motor_overrides import MOTOR_QUANTITIES

INF = np.inf
TABLE = {"position": [-1.0, 0.0, 2.0], "effort": [10, 20, 16]}

# Effort limits by direction and position: what they allow, what of limits they become.


def limits(*given, **options):
    return load_robot("example:two_link", "hand", limits=given, **options).limits


def test_a_pair_holds_by_direction_everywhere():
    both = limits(LimitOverrides(effort={"joint2": [30, 20]}))
    (one,) = both.effort_ranges
    q = np.linspace(-4, 4, 5)
    assert (one.joint, both.effort[1]) == (1, 30)
    same(one.allowed(q, -1), np.full(5, 30))
    same(one.allowed(q, 1), np.full(5, 20))
    same(one.slope(q, 1), np.zeros(5))


def test_a_table_is_linear_between_its_positions_and_constant_beyond():
    both = limits(LimitOverrides(effort={"joint1": TABLE}))
    (one,) = both.effort_ranges
    q = np.array([-5, -1, -0.5, 0, 1, 2, 9])
    for way in (-1, 1):
        np.testing.assert_allclose(one.allowed(q, way), [10, 10, 15, 20, 18, 16, 16])
        np.testing.assert_allclose(one.slope(q, way), [0, 10, 10, -2, -2, 0, 0])
    assert both.effort[0] == 20
    one = EffortRange(0, np.zeros(1), np.ones(1), np.ones(1))
    for name in ("position", "backwards", "forwards"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(one, name)[0] = 2.0


def test_the_scale_holds_for_all_of_it():
    scale = {"effort": 0.5}
    both = limits(LimitOverrides(effort={"joint1": TABLE, "joint2": (4, 8)}, scale=scale))
    table, pair = both.effort_ranges
    same(both.effort, [10, 4])
    same(table.forwards, [5, 10, 8])
    same(table.position, TABLE["position"])
    assert (pair.backwards, pair.forwards) == ([2], [4])


def test_what_is_the_same_everywhere_is_a_number():
    table, longer = {"position": [0], "effort": [7]}, {"position": [0, 1], "effort": [7, 7]}
    for each in ([7, 7], table, longer):
        both = limits(LimitOverrides(effort={"joint1": each}))
        assert (both.effort_ranges, both.effort[0]) == ((), 7)


def test_a_later_layer_replaces_it_as_a_whole_and_the_group_decides_the_order():
    given = LimitOverrides(effort={"joint1": TABLE, "joint2": [1, 2]})
    both = limits(LimitLayer("preset a: ", given), LimitOverrides(effort={"joint1": 5}))
    assert [one.joint for one in both.effort_ranges] == [1]
    assert both.effort[0] == 5
    both = limits(given, joints=["joint2", "joint1"])
    assert [(one.joint, len(one.position)) for one in both.effort_ranges] == [(0, 1), (1, 3)]


MAGNITUDES = "give magnitudes from 1e-06 to 1e+09"
AS_MANY = "; give as many numbers in position as in effort, at least one"
INCREASE = "give finite numbers that increase"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([1, 0], f"[1, 0] has 0; {MAGNITUDES}"),
        ([-1, 2], f"[-1, 2] has -1; {MAGNITUDES}"),
        ([1, INF], f"[1, inf] has inf; {MAGNITUDES}"),
        ([1, "a"], f"[1, 'a'] has 'a'; {MAGNITUDES}"),
        (
            [1, 2, 3],
            "[1, 2, 3]; give a number from 1e-06 to 1e+09, [backwards, forwards], or a map with "
            "position and effort",
        ),
        (
            {"position": [0, 1], "efort": [1, 2]},
            "{'position': [0, 1], 'efort': [1, 2]}: unknown key 'efort' (did you mean 'effort'?); "
            "there is: position, effort",
        ),
        *(
            (each, f"{each}{AS_MANY}")
            for each in (
                {"position": [0, 1], "effort": [1]},
                {"position": [0]},
                {"position": [], "effort": []},
            )
        ),
        ({"position": [0, 0], "effort": [1, 2]}, f"position [0, 0]; {INCREASE}"),
        ({"position": [0, INF], "effort": [1, 2]}, f"position [0, inf]; {INCREASE}"),
        ({"position": [0, 1], "effort": [1, -2]}, f"effort [1, -2] has -2; {MAGNITUDES}"),
    ],
)
def test_an_effort_that_is_none_is_refused_at_once(value, message):
    refused = refusal(RobotError, LimitOverrides, effort={"j": value})
    assert refused == f"robot.limits.effort: joint 'j' at {message}"


def test_only_a_map_holds_efforts_by_direction():
    message = refusal(RobotError, LimitOverrides, effort=[[1, 2], 3])
    assert message.startswith("robot.limits.effort[0] is [1, 2]; give a numb")


# Limits on the speed of points: what they may be.


def test_a_point_is_three_numbers_however_they_come_and_a_speed():
    for position in ((0, 0, 1), [0, 0, 1], np.array([0.0, 0.0, 1.0])):
        assert PointSpeed("hand", position, 1) == PointSpeed("hand", (0.0, 0.0, 1.0), 1)
    for position in ((0, 0), 3, "abc", (0, 0, INF), (0, [1], 0), (0, True, 0)):
        with pytest.raises(RobotError, match=r"of link 'hand': position is .*; give \[x, y, z\] i"):
            PointSpeed("hand", position, 1.0)
    for speed in (0, -1.0, np.nan, INF, 2e9, True, "fast", None):
        with pytest.raises(RobotError, match=r"of link 'hand': speed is .*; give a number from 1e"):
            PointSpeed("hand", (0, 0, 0), speed)


# Motors that a problem gives: what is refused at once, and in which words.

AMOUNT = "give a number from 0 to 1e+09"
LINE = "give a number from 1e-06 to 1e+09, or .inf where there is no torque-speed line"
SHARE = "give a share from 0, below 1"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"armature": -0.1}, f"armature is -0.1; {AMOUNT}"),
        ({"armature": [1, INF]}, f"armature[1] is inf; {AMOUNT}"),
        ({"armature": {"j": np.nan}}, f"armature: joint 'j' at nan; {AMOUNT}"),
        ({"armature": [[1, 2]]}, f"armature[0] is [1, 2]; {AMOUNT}"),
        ({"viscous_friction": {"j": 2e9}}, f"viscous_friction: joint 'j' at 2e+09; {AMOUNT}"),
        ({"viscous_friction": [True]}, f"viscous_friction[0] is True; {AMOUNT}"),
        ({"saturation_effort": 0}, f"saturation_effort is 0; {LINE}"),
        ({"no_load_velocity": {"j": -1}}, f"no_load_velocity: joint 'j' at -1; {LINE}"),
        ({"friction_from_urdf": 1}, "friction_from_urdf is 1; it must be true or false"),
        (
            {"armature": "a"},
            "armature is 'a'; it must be one number for all joints, a list with one for each, or "
            "a map by name, such as {'elbow_joint': 1.5}",
        ),
        *(
            (
                {"coulomb_friction": {"j": value}},
                f"coulomb_friction: joint 'j' at {value!r}; {AMOUNT}, or [backwards, forwards] of "
                "such",
            )
            for value in (-1, [1, -1], [1], [1, 2, 3], [1, INF], [1, True], "12", None)
        ),
        *(
            ({"friction_uncertainty": value}, f"friction_uncertainty is {shown}; {SHARE}")
            for value, shown in ((-0.1, "-0.1"), (1.0, "1"), (np.nan, "nan"), (True, "True"))
        ),
    ],
)
def test_a_senseless_motor_is_refused_at_once(given, message):
    assert refusal(RobotError, MotorOverrides, **given) == f"robot.motors.{message}"


def test_bounds_of_motors_themselves_are_allowed():
    MotorOverrides(
        armature=0,
        viscous_friction=1e9,
        coulomb_friction=[[0, 1e9], (0, 0), np.zeros(2)],
        saturation_effort=[1e-6, INF],
        no_load_velocity={"j": 1e9},
        friction_from_urdf=False,
        friction_uncertainty=0,
    )


@pytest.mark.parametrize("quantity", MOTOR_QUANTITIES)
def test_numbers_lists_and_maps_go_by_name(quantity):
    def by_name(given):
        return dict(MotorOverrides(**{quantity: given}).by_name(quantity, ["j", "k"], "here"))

    assert by_name(2) == {"j": 2, "k": 2}
    assert by_name([2, 3]) == {"j": 2, "k": 3}
    assert by_name({"other": 2}) == {"other": 2}
    message = refusal(RobotError, by_name, [2])
    assert message.startswith("here has 1 values for 2 joints; give one for all jo")
