"""Limits of the planned joints: the URDF's, replaced and scaled by the problem's."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal as same

from refusals import refusal
from tubeplanner.errors import RobotError
from tubeplanner.robot.joint_limits import resolve_limits
from tubeplanner.robot.limit_overrides import LimitOverrides
from tubeplanner.robot.point_speed import PointSpeed
from tubeplanner.robot.urdf import read_urdf
from tubeplanner.robot.velocity_by_position import VelocityByPosition

INF = np.inf
COMPLETE = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
RANGE = "give a number from 1e-06 to 1e+09, or .inf for none"
QUANTITIES = ["effort", "velocity", "acceleration", "jerk", "effort_rate"]
LAW = {"deceleration": 6, "offset": 0.3}


@pytest.fixture
def resolve(tmp_path):
    """Return a function from limits of a problem to those of an arm of joints j and k."""

    def resolve(group="jk", limit_j=COMPLETE, limit_k=COMPLETE, kind="revolute", **given):
        path = tmp_path / "arm.urdf"
        path.write_text(
            f"""<robot name="arm"><link name="a"/><link name="b"/><link name="c"/>
            <joint name="j" type="{kind}"><parent link="a"/><child link="b"/>{limit_j}</joint>
            <joint name="k" type="revolute"><parent link="b"/><child link="c"/>{limit_k}</joint>
            </robot>"""
        )
        return resolve_limits(read_urdf(path), list(group), LimitOverrides(**given))

    return resolve


def require(limits, **expected):
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(limits, name), values, rtol=1e-15, err_msg=name)


def test_without_overrides_the_limits_are_those_of_the_urdf_in_group_order(resolve):
    limits = resolve("kj", limit_k='<limit lower="-4" upper="5" effort="20" velocity="6"/>')
    require(limits, lower_position=[-4, -1], upper_position=[5, 2], effort=[20, 10])
    require(limits, velocity=[6, 3], acceleration=[INF, INF], jerk=[INF, INF])
    require(limits, effort_rate=[INF, INF])
    assert limits.velocity_by_position == limits.point_speed == ()
    require(resolve("k", limit_j=""), effort=[10])  # others need no limits
    with pytest.raises(ValueError, match="read-only"):
        limits.effort[0] = 1.0
    q = np.array([[[-5.0, 0.5], [5.0, 2.0]]])
    same(resolve().clip(q), [[[-1.0, 0.5], [2.0, 2.0]]])


def test_overrides_replace_only_what_they_name(resolve):
    replaced = {"effort": {"j": 7}, "velocity": {"k": INF}, "position": {"j": (0.25, 8)}}
    limits = resolve(**replaced, acceleration={"k": 9}, jerk={"j": 11})
    require(limits, effort=[7, 10], velocity=[3, INF], acceleration=[INF, 9], jerk=[11, INF])
    require(limits, lower_position=[0.25, -1], upper_position=[8, 2])


def test_scale_acts_on_replaced_limits_too_and_never_on_other_quantities(resolve):
    limits = resolve(
        effort={"j": 8},
        acceleration={"j": 6},
        jerk={"j": 4},
        effort_rate={"k": 1000},
        scale={"effort": 0.5, "velocity": 0.1, "acceleration": 0.25},
    )
    require(limits, effort=[4, 5], acceleration=[1.5, INF], jerk=[4, INF], lower_position=[-1, -1])
    np.testing.assert_allclose(limits.velocity, [0.3, 0.3])
    require(limits, effort_rate=[INF, 1000])


@pytest.mark.parametrize(
    ("values", "quantity", "value"),
    [
        (None, "effort", "none"),
        ('velocity="1"', "effort", "none"),
        ('effort="1"', "velocity", "none"),
        ('effort="0" velocity="1"', "effort", "0"),
        ('effort="1" velocity="0"', "velocity", "0"),
        ('effort="-5" velocity="1"', "effort", "-5"),
        ('effort="inf" velocity="1"', "effort", "inf"),
        ('effort="1" velocity="inf"', "velocity", "inf"),
    ],
)
def test_a_limit_the_urdf_should_have_is_asked_for(resolve, values, quantity, value):
    limit = f'<limit lower="-1" upper="1" {values}/>' if values else ""
    message = refusal(RobotError, resolve, limit_j=limit, position={"j": (-1, 1)})
    assert f"joint 'j' has {quantity} limit {value}; give a positive one in " in message
    assert f"robot.limits.{quantity}, or .inf if there is none" in message
    assert "arm.urdf" in message


def test_infinity_on_purpose_is_allowed_while_something_bounds_the_speed(resolve):
    free = {"effort": {"j": INF}, "velocity": {"j": INF}}
    for given in ({"effort": {"j": INF}}, {"velocity": {"j": INF}}, {**free, "acceleration": 5}):
        limits = resolve(**given)
        assert all(getattr(limits, name)[0] == INF for name in given if name != "acceleration")
    assert refusal(RobotError, resolve, **free, jerk={"j": 1}) == (
        "joint 'j' has no finite limit among effort, velocity and acceleration, so its speed is "
        "unbounded; give one in robot.limits"
    )


@pytest.mark.parametrize(
    ("limit", "position", "message"),
    [
        ('<limit effort="1" velocity="1"/>', {}, "arm.urdf: joint 'j' has position limits [0, 0]"),
        (
            '<limit lower="2" upper="1" effort="1" velocity="1"/>',
            {},
            "arm.urdf: joint 'j' has position limits [2, 1], an empty range; give them in "
            "robot.limits.position",
        ),
        *(
            (COMPLETE, {"j": each}, f"robot.limits.position: joint 'j' has position limits {shown}")
            for each, shown in (((1, 1), "[1, 1]"), ((3, -3), "[3, -3]"), ((np.nan, 1), "[nan, 1]"))
        ),
    ],
)
def test_an_empty_position_range_is_refused(resolve, limit, position, message):
    assert message in refusal(RobotError, resolve, limit_j=limit, position=position)


def test_a_continuous_joint_is_unbounded_unless_the_problem_bounds_it(resolve):
    require(resolve(kind="continuous"), lower_position=[-INF, -1], upper_position=[INF, 2])
    bounded = resolve(kind="continuous", position={"j": (0, 10)})
    require(bounded, lower_position=[0, -1], upper_position=[10, 2])


@pytest.mark.parametrize("quantity", [*QUANTITIES, "position", "velocity_by_position"])
def test_numbers_lists_and_maps_go_by_name_and_others_are_refused(resolve, quantity):
    """A list is in the order of the chain, whatever that of the group."""
    one = {"position": (0, 1), "velocity_by_position": None}.get(quantity, 1.0)
    message = refusal(RobotError, resolve, **{quantity: {"l": one or LAW}})
    assert message == f"robot.limits.{quantity}: unknown joint 'l'; there is: j, k"
    alone = "one for all joints, " if quantity in QUANTITIES else ""
    for count in (1, 3):
        assert refusal(RobotError, resolve, **{quantity: [one] * count}) == (
            f"robot.limits.{quantity} has {count} values for 2 joints; give {alone}a map by name, "
            "or a list in the order of the chain: j, k"
        )
    if quantity in QUANTITIES:
        require(resolve(**{quantity: 7}), **{quantity: [7, 7]})
        for kind in (list, tuple, np.array):
            require(resolve("jk", **{quantity: kind([3.0, 4.0])}), **{quantity: [3, 4]})
            require(resolve("kj", **{quantity: kind([3.0, 4.0])}), **{quantity: [4, 3]})
    if quantity == "position":
        require(resolve("kj", position=[(-1, 1), (-2, 2)]), upper_position=[2, 1])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"effort": {"j": 0}}, f"effort: joint 'j' at 0; {RANGE}"),
        ({"velocity": {"j": -2.5}}, f"velocity: joint 'j' at -2.5; {RANGE}"),
        ({"acceleration": {"j": np.nan}}, f"acceleration: joint 'j' at nan; {RANGE}"),
        ({"jerk": {"j": -INF}}, f"jerk: joint 'j' at -inf; {RANGE}"),
        ({"effort_rate": {"j": 0}}, f"effort_rate: joint 'j' at 0; {RANGE}"),
        ({"effort": -1}, f"effort is -1; {RANGE}"),
        ({"jerk": [1, 0]}, f"jerk[1] is 0; {RANGE}"),
        ({"effort": {"j": 1e-7}}, f"effort: joint 'j' at 1e-07; {RANGE}"),
        ({"effort": {"j": 1e10}}, f"effort: joint 'j' at 1e+10; {RANGE}"),
        ({"scale": {"effort": 0}}, "scale: effort at 0 must be in (0, 1]"),
        ({"scale": {"velocity": 1.1}}, "scale: velocity at 1.1 must be in (0, 1]"),
        ({"scale": {"effort": np.nan}}, "scale: effort at nan must be in (0, 1]"),
        (
            {"scale": {"efort": 1}},
            "scale: unknown quantity 'efort' (did you mean 'effort'?); there is: effort, velocity, "
            "acceleration",
        ),
        ({"effort": "strong"}, "effort is 'strong'; it must be one number for all"),
        ({"jerk": True}, "jerk is True; it must be one number for all joints, a list"),
        ({"effort_rate": None}, "effort_rate is None; it must be one number for all"),
        ({"position": 5}, "position is 5; it must be a map by name, or a list"),
        ({"velocity_by_position": 5}, "velocity_by_position is 5; it must be a map by"),
        ({"scale": "effort"}, "scale is 'effort'; it must be a map by name"),
        ({"effort": {"j": "a"}}, "effort: joint 'j' at 'a'; give a number from 1e-06"),
        ({"velocity": {"j": True}}, "velocity: joint 'j' at True; give a number"),
        ({"velocity": {"j": [1, 2]}}, "velocity: joint 'j' at [1, 2]; give a number"),
        ({"position": {"j": [1]}}, "position: joint 'j' at [1]; give [lower, upper"),
        ({"position": {"j": ["a", "b"]}}, "position: joint 'j' at ['a', 'b']; give [lower, upper"),
        ({"position": [[0, [1]], [0, 1]]}, "position[0] is [0, [1]]; give [low"),
        ({"effort": [1, [2]]}, "effort[1] is [2]; give a number from 1e-06"),
        ({"effort": np.array(3.0)}, "effort is array(3.); it must be one number"),
        ({"scale": {"effort": "a"}}, "scale: effort at 'a' must be in"),
        *(
            ({"tool_speed": value}, f"tool_speed is {value!r}; give a number from 1e-06 m/s")
            for value in (0, -1.0, np.nan, -INF, True, "fast", [1.0], {"j": 1.0})
        ),
        *(
            ({"point_speed": value}, f"point_speed is {value!r}; give a list of Point")
            for value in (3, {"link": "c"}, [{"link": "c"}], "c")
        ),
    ],
)
def test_a_senseless_override_is_refused_at_once(given, message):
    assert refusal(RobotError, LimitOverrides, **given).startswith(f"robot.limits.{message}")


@pytest.mark.parametrize(("given", "held"), [(None, INF), (0.25, 0.25), (1, 1.0), (INF, INF)])
def test_the_tools_speed_is_free_unless_it_is_given(resolve, given, held):
    limits = resolve(tool_speed=given, scale={"velocity": 0.5})
    assert limits.tool_speed == held
    assert isinstance(limits.tool_speed, float)


def test_a_velocity_by_position_has_the_position_limits_unless_it_gives_its_own(resolve):
    limits = resolve(
        "kj",
        velocity_by_position={"j": LAW | {"lower": None}, "k": LAW | {"lower": -0.5, "upper": 1.5}},
        position={"j": (-3, 2.5)},
        scale={"velocity": 0.5, "acceleration": 0.5},
    )
    assert limits.velocity_by_position == (
        VelocityByPosition(0, 6.0, 0.3, -0.5, 1.5),
        VelocityByPosition(1, 6.0, 0.3, -3.0, 2.5),
    )
    some = resolve(velocity_by_position=[None, {"deceleration": 6, "offset": 0}])
    assert some.velocity_by_position == (VelocityByPosition(1, 6.0, 0.0, -1.0, 2.0),)


ORDER = "give finite ones, lower below upper"


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (LAW | {"deceleration": 0}, ".deceleration is 0; give a number from 1e-06 to 1e+09"),
        (LAW | {"deceleration": None}, ".deceleration is None; give a number from 1e-06 to 1e+09"),
        (LAW | {"deceleration": True}, ".deceleration is True; give a number from 1e-06 to 1e+09"),
        (LAW | {"offset": -0.1}, ".offset is -0.1; give a number from 0 to 1e+09"),
        (LAW | {"offset": INF}, ".offset is inf; give a number from 0 to 1e+09"),
        (LAW | {"lower": 2}, f" has lower 2 and upper 2; {ORDER}"),
        (LAW | {"upper": INF}, f" has lower -1 and upper inf; {ORDER}"),
        (
            LAW | {"uper": 1},
            ": unknown key 'uper' (did you mean 'upper'?); there is: deceleration, offset, lower, "
            "upper",
        ),
        (3, " is 3; give a map with deceleration, offset, lower, upper"),
    ],
)
def test_a_senseless_velocity_by_position_is_named(resolve, law, message):
    refused = refusal(RobotError, resolve, velocity_by_position={"j": law})
    assert refused == f"robot.limits.velocity_by_position.j{message}"


def test_points_of_the_arm_have_a_speed_and_a_link_that_there_is(resolve):
    limits = resolve(point_speed=[PointSpeed("c", [0, 0, 0.1], 0.25)])
    assert limits.point_speed == (PointSpeed("c", (0.0, 0.0, 0.1), 0.25),)
    message = refusal(RobotError, resolve, point_speed=[PointSpeed("d", (0, 0, 0), 1.0)])
    assert message == "robot.limits.point_speed: unknown link 'd'; there is: a, b, c"
