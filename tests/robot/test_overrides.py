"""LimitOverrides, MotorOverrides of a problem: per joint, by direction or position, of points."""

import numpy as np
import pytest

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

# Effort limits by direction and position: what they allow, what of limits they become.


TABLE = {"position": [-1.0, 0.0, 2.0], "effort": [10, 20, 16]}


def limits(*given, **options):
    return load_robot("example:two_link", "hand", limits=given, **options).limits


def test_a_pair_holds_by_direction_everywhere():
    found = limits(LimitOverrides(effort={"joint2": [30, 20]}))
    (one,) = found.effort_ranges
    q = np.linspace(-4, 4, 5)
    assert one.joint == 1
    np.testing.assert_array_equal(one.allowed(q, -1), np.full(5, 30))
    np.testing.assert_array_equal(one.allowed(q, 1), np.full(5, 20))
    np.testing.assert_array_equal(one.slope(q, 1), np.zeros(5))
    assert found.effort[1] == 30


def test_a_table_is_linear_between_its_positions_and_constant_beyond():
    found = limits(LimitOverrides(effort={"joint1": TABLE}))
    (one,) = found.effort_ranges
    q = np.array([-5, -1, -0.5, 0, 1, 2, 9])
    for way in (-1, 1):
        np.testing.assert_allclose(one.allowed(q, way), [10, 10, 15, 20, 18, 16, 16])
        np.testing.assert_allclose(one.slope(q, way), [0, 10, 10, -2, -2, 0, 0])
    assert found.effort[0] == 20


def test_the_scale_holds_for_all_of_it():
    scaled = LimitOverrides(effort={"joint1": TABLE, "joint2": (4, 8)}, scale={"effort": 0.5})
    found = limits(scaled)
    table, pair = found.effort_ranges
    np.testing.assert_array_equal(found.effort, [10, 4])
    np.testing.assert_array_equal(table.forwards, [5, 10, 8])
    np.testing.assert_array_equal(table.position, TABLE["position"])
    assert (pair.backwards, pair.forwards) == ([2], [4])


@pytest.mark.parametrize(
    "same", [[7, 7], {"position": [0], "effort": [7]}, {"position": [0, 1], "effort": [7, 7]}]
)
def test_what_is_the_same_everywhere_is_a_number(same):
    found = limits(LimitOverrides(effort={"joint1": same}))
    assert found.effort_ranges == ()
    assert found.effort[0] == 7


def test_a_later_layer_replaces_it_as_a_whole():
    below = LimitLayer("preset a: ", LimitOverrides(effort={"joint1": TABLE, "joint2": [1, 2]}))
    found = limits(below, LimitOverrides(effort={"joint1": 5}))
    assert [one.joint for one in found.effort_ranges] == [1]
    assert found.effort[0] == 5


def test_the_group_decides_the_order():
    given = LimitOverrides(effort={"joint1": TABLE, "joint2": [1, 2]})
    found = limits(given, joints=["joint2", "joint1"])
    assert [(one.joint, len(one.position)) for one in found.effort_ranges] == [(0, 1), (1, 3)]


def test_it_cannot_be_written_to():
    one = EffortRange(0, np.zeros(1), np.ones(1), np.ones(1))
    for name in ("position", "backwards", "forwards"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(one, name)[0] = 2.0


WHERE = "robot.limits.effort: joint 'j' at"
MAGNITUDES = "give magnitudes from 1e-06 to 1e+09"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([1, 0], f"{WHERE} [1, 0] has 0; {MAGNITUDES}"),
        ([-1, 2], f"{WHERE} [-1, 2] has -1; {MAGNITUDES}"),
        ([1, np.inf], f"{WHERE} [1, inf] has inf; {MAGNITUDES}"),
        ([1, "a"], f"{WHERE} [1, 'a'] has 'a'; {MAGNITUDES}"),
        (
            [1, 2, 3],
            f"{WHERE} [1, 2, 3]; give a number from 1e-06 to 1e+09, [backwards, forwards], or a "
            "map with position and effort",
        ),
        (
            {"position": [0, 1], "efort": [1, 2]},
            f"{WHERE} {{'position': [0, 1], 'efort': [1, 2]}}: unknown key 'efort' (did you mean "
            "'effort'?); there is: position, effort",
        ),
        (
            {"position": [0, 1], "effort": [1]},
            f"{WHERE} {{'position': [0, 1], 'effort': [1]}}; give as many numbers in position as "
            "in effort, at least one",
        ),
        (
            {"position": [0]},
            f"{WHERE} {{'position': [0]}}; give as many numbers in position as in effort, at least "
            "one",
        ),
        (
            {"position": [], "effort": []},
            f"{WHERE} {{'position': [], 'effort': []}}; give as many numbers in position as in "
            "effort, at least one",
        ),
        (
            {"position": [0, 0], "effort": [1, 2]},
            f"{WHERE} position [0, 0]; give finite numbers that increase",
        ),
        (
            {"position": [0, np.inf], "effort": [1, 2]},
            f"{WHERE} position [0, inf]; give finite numbers that increase",
        ),
        (
            {"position": [0, 1], "effort": [1, -2]},
            f"{WHERE} effort [1, -2] has -2; {MAGNITUDES}",
        ),
    ],
)
def test_what_is_none_is_refused_at_once(given, message):
    with pytest.raises(RobotError) as caught:
        LimitOverrides(effort={"j": given})
    assert str(caught.value) == message


def test_only_a_map_holds_it():
    with pytest.raises(RobotError, match=r"^robot\.limits\.effort\[0\] is \[1, 2\]; give a numb"):
        LimitOverrides(effort=[[1, 2], 3])
    with pytest.raises(RobotError, match=r"^robot\.limits\.velocity: joint 'j' at \[1, 2\]; give"):
        LimitOverrides(velocity={"j": [1, 2]})


# Limits on the speed of points: what they may be.


@pytest.mark.parametrize("position", [(0, 0, 1), [0, 0, 1], np.array([0.0, 0.0, 1.0])])
def test_a_point_is_three_numbers_however_they_come(position):
    assert PointSpeed("hand", position, 1) == PointSpeed("hand", (0.0, 0.0, 1.0), 1)


@pytest.mark.parametrize("position", [(0, 0), 3, "abc", (0, 0, np.inf), (0, [1], 0), (0, True, 0)])
def test_a_position_that_is_none_is_refused(position):
    with pytest.raises(RobotError, match=r"of link 'hand': position is .*; give \[x, y, z\] in m"):
        PointSpeed("hand", position, 1.0)


@pytest.mark.parametrize("speed", [0, -1.0, np.nan, np.inf, 2e9, True, "fast", None])
def test_a_speed_out_of_bounds_is_refused(speed):
    with pytest.raises(RobotError, match=r"of link 'hand': speed is .*; give a number from 1e-06"):
        PointSpeed("hand", (0, 0, 0), speed)


# Motors that a problem gives: what is refused at once, and in which words.


INF = np.inf
WANTED = "give a number from 0 to 1e+09"
LINE = "give a number from 1e-06 to 1e+09, or .inf where there is no torque-speed line"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"armature": -0.1}, f"robot.motors.armature is -0.1; {WANTED}"),
        ({"armature": [1, INF]}, f"robot.motors.armature[1] is inf; {WANTED}"),
        ({"armature": {"j": np.nan}}, f"robot.motors.armature: joint 'j' at nan; {WANTED}"),
        ({"armature": [[1, 2]]}, f"robot.motors.armature[0] is [1, 2]; {WANTED}"),
        (
            {"viscous_friction": {"j": 2e9}},
            f"robot.motors.viscous_friction: joint 'j' at 2e+09; {WANTED}",
        ),
        ({"viscous_friction": [True]}, f"robot.motors.viscous_friction[0] is True; {WANTED}"),
        ({"saturation_effort": 0}, f"robot.motors.saturation_effort is 0; {LINE}"),
        (
            {"no_load_velocity": {"j": -1}},
            f"robot.motors.no_load_velocity: joint 'j' at -1; {LINE}",
        ),
        (
            {"friction_from_urdf": 1},
            "robot.motors.friction_from_urdf is 1; it must be true or false",
        ),
        (
            {"armature": "a"},
            "robot.motors.armature is 'a'; it must be one number for all joints, a list with one "
            "for each, or a map by name, such as {'elbow_joint': 1.5}",
        ),
    ],
)
def test_a_senseless_motor_is_refused_at_once(given, message):
    with pytest.raises(RobotError) as caught:
        MotorOverrides(**given)
    assert str(caught.value) == message


@pytest.mark.parametrize("value", [-1, [1, -1], [1], [1, 2, 3], [1, INF], [1, True], "12", None])
def test_a_coulomb_friction_is_an_amount_or_two(value):
    with pytest.raises(RobotError) as caught:
        MotorOverrides(coulomb_friction={"j": value})
    shown = repr(value)
    assert str(caught.value) == (
        f"robot.motors.coulomb_friction: joint 'j' at {shown}; {WANTED}, or [backwards, forwards] "
        "of such"
    )


@pytest.mark.parametrize("share", [-0.1, 1, 1.0, np.nan, True, "a"])
def test_an_uncertainty_is_a_share_below_one(share):
    with pytest.raises(RobotError) as caught:
        MotorOverrides(friction_uncertainty=share)
    assert str(caught.value).endswith("; give a share from 0, below 1")
    assert str(caught.value).startswith("robot.motors.friction_uncertainty is ")


def test_bounds_themselves_are_allowed():
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
    with pytest.raises(RobotError, match=r"^here has 1 values for 2 joints; give one for all jo"):
        by_name([2])
