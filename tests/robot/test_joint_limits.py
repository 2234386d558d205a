"""Limits of the planned joints: the URDF's, replaced and scaled by the problem's."""

import numpy as np
import pytest

from tubeplanner.errors import RobotError
from tubeplanner.robot.joint_limits import LimitOverrides, resolve_limits
from tubeplanner.robot.urdf import read_urdf

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


@pytest.mark.parametrize("quantity", ["effort", "velocity", "position", "acceleration", "jerk"])
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
        ("effort", [1, 2], r"robot.limits.effort is \[1, 2\]; it must be a map by name"),
        ("position", 5, "robot.limits.position is 5; it must be a map by name"),
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
