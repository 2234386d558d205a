"""Limits of the planned joints: the URDF's, replaced and scaled by the problem's."""

import numpy as np
import pytest

from tubeplanner.errors import RobotError
from tubeplanner.robot.joint_limits import resolve_limits
from tubeplanner.robot.limit_overrides import LimitOverrides
from tubeplanner.robot.point_speed import PointSpeed
from tubeplanner.robot.urdf import read_urdf
from tubeplanner.robot.velocity_by_position import VelocityByPosition

COMPLETE = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
INF = np.inf
WANTED = "give a number from 1e-06 to 1e+09, or .inf for none"


@pytest.fixture
def describe(tmp_path):
    """Write an arm of joints j and k, with given limits, and read it."""

    def write(limit_j=COMPLETE, limit_k=COMPLETE, kind="revolute"):
        path = tmp_path / "arm.urdf"
        path.write_text(
            f"""<robot name="arm"><link name="a"/><link name="b"/><link name="c"/>
            <joint name="j" type="{kind}"><parent link="a"/><child link="b"/>{limit_j}</joint>
            <joint name="k" type="revolute"><parent link="b"/><child link="c"/>{limit_k}</joint>
            </robot>"""
        )
        return read_urdf(path)

    return write


def test_without_overrides_the_limits_are_those_of_the_urdf_in_group_order(describe):
    other = '<limit lower="-4" upper="5" effort="20" velocity="6"/>'
    limits = resolve_limits(describe(limit_k=other), ["k", "j"], LimitOverrides())
    np.testing.assert_array_equal(limits.lower_position, [-4, -1])
    np.testing.assert_array_equal(limits.upper_position, [5, 2])
    np.testing.assert_array_equal(limits.effort, [20, 10])
    np.testing.assert_array_equal(limits.velocity, [6, 3])
    np.testing.assert_array_equal(limits.acceleration, [INF, INF])
    np.testing.assert_array_equal(limits.jerk, [INF, INF])


def test_overrides_replace_only_what_they_name(describe):
    overrides = LimitOverrides(
        effort={"j": 7},
        velocity={"k": INF},
        position={"j": (0.25, 8)},
        acceleration={"k": 9},
        jerk={"j": 11},
    )
    limits = resolve_limits(describe(), ["j", "k"], overrides)
    np.testing.assert_array_equal(limits.effort, [7, 10])
    np.testing.assert_array_equal(limits.velocity, [3, INF])
    np.testing.assert_array_equal(limits.lower_position, [0.25, -1])
    np.testing.assert_array_equal(limits.upper_position, [8, 2])
    np.testing.assert_array_equal(limits.acceleration, [INF, 9])
    np.testing.assert_array_equal(limits.jerk, [11, INF])


def test_scale_acts_on_replaced_limits_too_and_never_on_jerk_or_position(describe):
    overrides = LimitOverrides(
        effort={"j": 8},
        acceleration={"j": 6},
        jerk={"j": 4},
        scale={"effort": 0.5, "velocity": 0.1, "acceleration": 0.25},
    )
    limits = resolve_limits(describe(), ["j", "k"], overrides)
    np.testing.assert_allclose(limits.effort, [4, 5])
    np.testing.assert_allclose(limits.velocity, [0.3, 0.3])
    np.testing.assert_allclose(limits.acceleration, [1.5, INF])
    np.testing.assert_array_equal(limits.jerk, [4, INF])
    np.testing.assert_array_equal(limits.lower_position, [-1, -1])


@pytest.mark.parametrize(
    ("limit", "quantity", "found"),
    [
        ("", "effort", "none"),
        ('<limit lower="-1" upper="1" velocity="1"/>', "effort", "none"),
        ('<limit lower="-1" upper="1" effort="1"/>', "velocity", "none"),
        ('<limit lower="-1" upper="1" effort="0" velocity="1"/>', "effort", "0"),
        ('<limit lower="-1" upper="1" effort="1" velocity="0"/>', "velocity", "0"),
        ('<limit lower="-1" upper="1" effort="-5" velocity="1"/>', "effort", "-5"),
        ('<limit lower="-1" upper="1" effort="inf" velocity="1"/>', "effort", "inf"),
        ('<limit lower="-1" upper="1" effort="1" velocity="inf"/>', "velocity", "inf"),
    ],
)
def test_a_limit_the_urdf_should_have_is_asked_for(describe, limit, quantity, found):
    position = LimitOverrides(position={"j": (-1, 1)})
    with pytest.raises(RobotError) as caught:
        resolve_limits(describe(limit), ["j", "k"], position)
    assert f"joint 'j' has {quantity} limit {found}; give a positive one in " in str(caught.value)
    assert f"robot.limits.{quantity}, or .inf if there is none" in str(caught.value)
    assert "arm.urdf" in str(caught.value)


def test_a_joint_outside_the_group_needs_no_limits(describe):
    limits = resolve_limits(describe(limit_j=""), ["k"], LimitOverrides())
    np.testing.assert_array_equal(limits.effort, [10])


@pytest.mark.parametrize(
    "given",
    [
        {"effort": {"j": INF}},
        {"velocity": {"j": INF}},
        {"effort": {"j": INF}, "velocity": {"j": INF}, "acceleration": {"j": 5}},
    ],
)
def test_infinity_on_purpose_is_allowed_while_something_bounds_the_speed(describe, given):
    limits = resolve_limits(describe(), ["j", "k"], LimitOverrides(**given))
    for quantity, values in given.items():
        assert getattr(limits, quantity)[0] == values["j"]


def test_a_joint_without_any_finite_limit_is_named(describe):
    overrides = LimitOverrides(effort={"k": INF}, velocity={"k": INF}, jerk={"k": 1})
    with pytest.raises(RobotError) as caught:
        resolve_limits(describe(), ["j", "k"], overrides)
    assert str(caught.value) == (
        "joint 'k' has no finite limit among effort, velocity and acceleration, so its speed is "
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
        (COMPLETE, {"j": (1, 1)}, "robot.limits.position: joint 'j' has position limits [1, 1]"),
        (COMPLETE, {"j": (3, -3)}, "robot.limits.position: joint 'j' has position limits [3, -3]"),
        (
            COMPLETE,
            {"j": (np.nan, 1)},
            "robot.limits.position: joint 'j' has position limits [nan, 1]",
        ),
    ],
)
def test_an_empty_position_range_is_refused(describe, limit, position, message):
    with pytest.raises(RobotError) as caught:
        resolve_limits(describe(limit), ["j", "k"], LimitOverrides(position=position))
    assert message in str(caught.value)


def test_a_continuous_joint_is_unbounded_unless_the_problem_bounds_it(describe):
    free = resolve_limits(describe(kind="continuous"), ["j", "k"], LimitOverrides())
    assert (free.lower_position[0], free.upper_position[0]) == (-INF, INF)
    bounded = resolve_limits(
        describe(kind="continuous"), ["j", "k"], LimitOverrides(position={"j": (0, 10)})
    )
    assert (bounded.lower_position[0], bounded.upper_position[0]) == (0, 10)


@pytest.mark.parametrize(
    "quantity",
    [
        "effort",
        "velocity",
        "position",
        "acceleration",
        "jerk",
        "effort_rate",
        "velocity_by_position",
    ],
)
def test_an_override_for_an_unknown_joint_lists_the_joints(describe, quantity):
    value = (0, 1) if quantity == "position" else 1.0
    with pytest.raises(RobotError) as caught:
        resolve_limits(describe(), ["j", "k"], LimitOverrides(**{quantity: {"l": value}}))
    assert str(caught.value) == f"robot.limits.{quantity}: unknown joint 'l'; there is: j, k"


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"effort": {"j": 0}}, f"robot.limits.effort: joint 'j' at 0; {WANTED}"),
        ({"velocity": {"j": -2.5}}, f"robot.limits.velocity: joint 'j' at -2.5; {WANTED}"),
        ({"acceleration": {"j": np.nan}}, f"robot.limits.acceleration: joint 'j' at nan; {WANTED}"),
        ({"jerk": {"j": -INF}}, f"robot.limits.jerk: joint 'j' at -inf; {WANTED}"),
        ({"effort_rate": {"j": 0}}, f"robot.limits.effort_rate: joint 'j' at 0; {WANTED}"),
        ({"effort": -1}, f"robot.limits.effort is -1; {WANTED}"),
        ({"jerk": [1, 0]}, f"robot.limits.jerk[1] is 0; {WANTED}"),
        ({"effort": {"j": 1e-7}}, f"robot.limits.effort: joint 'j' at 1e-07; {WANTED}"),
        ({"effort": {"j": 1e10}}, f"robot.limits.effort: joint 'j' at 1e+10; {WANTED}"),
        ({"scale": {"effort": 0}}, "robot.limits.scale: effort at 0 must be in (0, 1]"),
        ({"scale": {"velocity": 1.1}}, "robot.limits.scale: velocity at 1.1 must be in (0, 1]"),
        ({"scale": {"effort": np.nan}}, "robot.limits.scale: effort at nan must be in (0, 1]"),
        (
            {"scale": {"efort": 1}},
            "robot.limits.scale: unknown quantity 'efort' (did you mean 'effort'?); there is: "
            "effort, velocity, acceleration",
        ),
    ],
)
def test_a_senseless_override_is_refused_at_once(given, message):
    with pytest.raises(RobotError) as caught:
        LimitOverrides(**given)
    assert str(caught.value) == message


def test_clip_moves_any_stack_of_configurations_into_the_limits(describe):
    limits = resolve_limits(describe(), ["j", "k"], LimitOverrides())
    q = np.array([[[-5.0, 0.5], [5.0, 2.0]]])
    np.testing.assert_array_equal(limits.clip(q), [[[-1.0, 0.5], [2.0, 2.0]]])


def test_limits_cannot_be_written_to(describe):
    limits = resolve_limits(describe(), ["j", "k"], LimitOverrides())
    with pytest.raises(ValueError, match="read-only"):
        limits.effort[0] = 1.0


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("effort", "strong", "robot.limits.effort is 'strong'; it must be one number for all"),
        ("jerk", True, "robot.limits.jerk is True; it must be one number for all joints, a list"),
        ("effort_rate", None, "robot.limits.effort_rate is None; it must be one number for all"),
        ("position", 5, "robot.limits.position is 5; it must be a map by name, or a list"),
        ("velocity_by_position", 5, "robot.limits.velocity_by_position is 5; it must be a map by"),
        ("scale", "effort", "robot.limits.scale is 'effort'; it must be a map by name"),
        ("effort", {"j": "a"}, "robot.limits.effort: joint 'j' at 'a'; give a number from 1e-06"),
        ("velocity", {"j": True}, "robot.limits.velocity: joint 'j' at True; give a number"),
        ("position", {"j": [1]}, r"robot.limits.position: joint 'j' at \[1\]; give \[lower, upper"),
        ("position", {"j": ["a", "b"]}, r"joint 'j' at \['a', 'b'\]; give \[lower, upper"),
        ("scale", {"effort": "a"}, "robot.limits.scale: effort at 'a' must be in"),
    ],
)
def test_overrides_of_the_wrong_kind_are_refused(field, value, message):
    with pytest.raises(RobotError, match=message):
        LimitOverrides(**{field: value})


@pytest.mark.parametrize(("given", "kept"), [(None, INF), (0.25, 0.25), (1, 1.0), (INF, INF)])
def test_the_tools_speed_is_free_unless_it_is_given(describe, given, kept):
    overrides = LimitOverrides(tool_speed=given, scale={"velocity": 0.5})
    limits = resolve_limits(describe(), ["j", "k"], overrides)
    assert limits.tool_speed == kept
    assert isinstance(limits.tool_speed, float)


@pytest.mark.parametrize("given", [0, -1.0, np.nan, -INF, True, "fast", [1.0], {"j": 1.0}])
def test_a_tools_speed_that_is_none_is_named(given):
    with pytest.raises(RobotError) as caught:
        LimitOverrides(tool_speed=given)
    text = repr(given) if not isinstance(given, float) else f"{given}"
    assert str(caught.value) == (f"robot.limits.tool_speed is {text}; give a number from 1e-06 m/s")


QUANTITIES = ["effort", "velocity", "acceleration", "jerk", "effort_rate"]


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_one_number_serves_for_all_joints(describe, quantity):
    limits = resolve_limits(describe(), ["j", "k"], LimitOverrides(**{quantity: 7}))
    np.testing.assert_array_equal(getattr(limits, quantity), [7, 7])


@pytest.mark.parametrize("quantity", QUANTITIES)
@pytest.mark.parametrize("kind", [list, tuple, np.array])
def test_a_list_is_in_the_order_of_the_chain_whatever_that_of_the_group(describe, quantity, kind):
    overrides = LimitOverrides(**{quantity: kind([3.0, 4.0])})
    for group, expected in ((["j", "k"], [3, 4]), (["k", "j"], [4, 3])):
        limits = resolve_limits(describe(), group, overrides)
        np.testing.assert_array_equal(getattr(limits, quantity), expected)


def test_ranges_may_be_a_list_too(describe):
    limits = resolve_limits(describe(), ["k", "j"], LimitOverrides(position=[(-1, 1), (-2, 2)]))
    np.testing.assert_array_equal(limits.upper_position, [2, 1])


@pytest.mark.parametrize("quantity", [*QUANTITIES, "position", "velocity_by_position"])
@pytest.mark.parametrize("count", [1, 3])
def test_a_list_of_another_length_than_the_chain_is_refused(describe, quantity, count):
    value = {"position": (0, 1), "velocity_by_position": None}.get(quantity, 1.0)
    with pytest.raises(RobotError) as caught:
        resolve_limits(describe(), ["j", "k"], LimitOverrides(**{quantity: [value] * count}))
    alone = "one for all joints, " if quantity in QUANTITIES else ""
    assert str(caught.value) == (
        f"robot.limits.{quantity} has {count} values for 2 joints; give {alone}a map by name, or "
        "a list in the order of the chain: j, k"
    )


def test_an_effort_rate_is_free_unless_it_is_given_and_never_scaled(describe):
    free = resolve_limits(describe(), ["j", "k"], LimitOverrides())
    np.testing.assert_array_equal(free.effort_rate, [INF, INF])
    overrides = LimitOverrides(
        effort_rate={"k": 1000}, scale={"effort": 0.5, "velocity": 0.5, "acceleration": 0.5}
    )
    limits = resolve_limits(describe(), ["j", "k"], overrides)
    np.testing.assert_array_equal(limits.effort_rate, [INF, 1000])


def test_a_velocity_by_position_has_the_position_limits_unless_it_gives_its_own(describe):
    given = {"deceleration": 6, "offset": 0.3}
    overrides = LimitOverrides(
        velocity_by_position={"j": given, "k": given | {"lower": -0.5, "upper": 1.5}},
        position={"j": (-3, 2.5)},
        scale={"velocity": 0.5, "acceleration": 0.5},
    )
    limits = resolve_limits(describe(), ["k", "j"], overrides)
    assert limits.velocity_by_position == (
        VelocityByPosition(0, 6.0, 0.3, -0.5, 1.5),
        VelocityByPosition(1, 6.0, 0.3, -3.0, 2.5),
    )


def test_a_list_of_velocities_by_position_may_leave_joints_out(describe):
    overrides = LimitOverrides(velocity_by_position=[None, {"deceleration": 6, "offset": 0}])
    laws = resolve_limits(describe(), ["j", "k"], overrides).velocity_by_position
    assert laws == (VelocityByPosition(1, 6.0, 0.0, -1.0, 2.0),)
    assert resolve_limits(describe(), ["j", "k"], LimitOverrides()).velocity_by_position == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"deceleration": 0},
            ".j.deceleration is 0; give a number from 1e-06 to 1e+09",
        ),
        ({"deceleration": None}, ".j.deceleration is None; give a number from 1e-06 to 1e+09"),
        ({"deceleration": True}, ".j.deceleration is True; give a number from 1e-06 to 1e+09"),
        ({"offset": -0.1}, ".j.offset is -0.1; give a number from 0 to 1e+09"),
        ({"offset": INF}, ".j.offset is inf; give a number from 0 to 1e+09"),
        (
            {"lower": 2},
            ".j has lower 2 and upper 2; give finite ones, lower below upper",
        ),
        (
            {"upper": INF},
            ".j has lower -1 and upper inf; give finite ones, lower below upper",
        ),
        (
            {"uper": 1},
            ".j: unknown key 'uper' (did you mean 'upper'?); there is: deceleration, offset, "
            "lower, upper",
        ),
    ],
)
def test_a_senseless_velocity_by_position_is_named(describe, change, message):
    law = {"deceleration": 6, "offset": 0.3} | change
    with pytest.raises(RobotError) as caught:
        resolve_limits(describe(), ["j", "k"], LimitOverrides(velocity_by_position={"j": law}))
    assert str(caught.value) == f"robot.limits.velocity_by_position{message}"


def test_a_velocity_by_position_that_is_no_map_is_named(describe):
    with pytest.raises(RobotError) as caught:
        resolve_limits(describe(), ["j", "k"], LimitOverrides(velocity_by_position={"j": 3}))
    assert str(caught.value) == (
        "robot.limits.velocity_by_position.j is 3; give a map with deceleration, offset, lower, "
        "upper"
    )


def test_points_of_the_arm_have_a_speed(describe):
    point = PointSpeed("c", [0, 0, 0.1], 0.25)
    limits = resolve_limits(describe(), ["j", "k"], LimitOverrides(point_speed=[point]))
    assert limits.point_speed == (PointSpeed("c", (0.0, 0.0, 0.1), 0.25),)
    assert resolve_limits(describe(), ["j", "k"], LimitOverrides()).point_speed == ()


def test_a_point_of_an_unknown_link_lists_the_links(describe):
    overrides = LimitOverrides(point_speed=[PointSpeed("d", (0, 0, 0), 1.0)])
    with pytest.raises(RobotError) as caught:
        resolve_limits(describe(), ["j", "k"], overrides)
    assert str(caught.value) == ("robot.limits.point_speed: unknown link 'd'; there is: a, b, c")


@pytest.mark.parametrize("given", [3, {"link": "c"}, [{"link": "c"}], "c"])
def test_what_is_no_list_of_points_is_named(given):
    with pytest.raises(RobotError, match=r"robot\.limits\.point_speed is .*; give a list of Point"):
        LimitOverrides(point_speed=given)
