"""Limits from several places: which hold, and for which arms they are."""

import numpy as np
import pytest

from tubeplanner import LimitLayer, LimitOverrides, PointSpeed, RobotError, load_robot
from tubeplanner.robot.joint_limits import resolve_limits
from tubeplanner.robot.urdf import read_urdf

INF = np.inf
LAW = {"deceleration": 6.0, "offset": 0.3, "lower": -1.0, "upper": 2.0}


@pytest.fixture
def arm(tmp_path):
    """An arm of joints j and k; f follows j twice as fast."""
    path = tmp_path / "arm.urdf"
    limit = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
    path.write_text(
        f"""<robot name="arm"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
        <joint name="j" type="revolute"><parent link="a"/><child link="b"/>{limit}</joint>
        <joint name="k" type="revolute"><parent link="b"/><child link="c"/>{limit}</joint>
        <joint name="f" type="revolute"><parent link="b"/><child link="d"/>{limit}
        <mimic joint="j" multiplier="2"/></joint></robot>"""
    )
    return read_urdf(path)


def resolved(arm, *layers):
    return resolve_limits(arm, ["j", "k"], layers)


def layer(joint_count=None, skips_others=False, notes=(), **limits):
    return LimitLayer("the ", LimitOverrides(**limits), joint_count, skips_others, notes)


def test_the_later_layer_holds_joint_by_joint(arm):
    limits = resolved(
        arm,
        layer(velocity=2.0, acceleration=[20, 30], jerk=500),
        layer(velocity=[1.0, 1.5], acceleration={"k": 25}),
        LimitOverrides(velocity={"j": 0.5}, effort=5),
    )
    np.testing.assert_array_equal(limits.velocity, [0.5, 1.5])
    np.testing.assert_array_equal(limits.acceleration, [20, 25])
    np.testing.assert_array_equal(limits.jerk, [500, 500])
    np.testing.assert_array_equal(limits.effort, [5, 5])


def test_a_number_replaces_the_list_below_it_and_inf_lifts_it(arm):
    limits = resolved(arm, layer(jerk=[500, 600], acceleration=[1, 2]), LimitOverrides(jerk=INF))
    np.testing.assert_array_equal(limits.jerk, [INF, INF])
    np.testing.assert_array_equal(limits.acceleration, [1, 2])


def test_scale_comes_last(arm):
    limits = resolved(arm, layer(velocity=1.0), LimitOverrides(scale={"velocity": 0.5}))
    np.testing.assert_array_equal(limits.velocity, [0.5, 0.5])


def test_scales_of_several_layers_are_merged_by_quantity(arm):
    scaled = [LimitOverrides(scale={"velocity": 0.5, "effort": 0.1})]
    limits = resolved(arm, *scaled, LimitOverrides(scale={"effort": 0.2}))
    np.testing.assert_array_equal(limits.velocity, [0.75, 1.5])  # j is bound by f
    np.testing.assert_array_equal(limits.effort, [2, 2])


def test_the_tools_speed_and_points_of_the_last_layer_that_has_them_hold(arm):
    low, high = PointSpeed("b", (0, 0, 0), 0.5), PointSpeed("c", (0, 0, 0), 1.5)
    limits = resolved(
        arm,
        layer(tool_speed=1.7, point_speed=[low]),
        layer(tool_speed=0.4, point_speed=[high]),
        LimitOverrides(),
    )
    assert limits.tool_speed == 0.4
    assert limits.point_speed == (high,)


def test_a_velocity_by_position_is_replaced_as_a_whole_or_taken_away(arm):
    other = {"deceleration": 5.0, "offset": 0.0}
    laws = [LAW, LAW]
    replaced = resolved(
        arm, layer(velocity_by_position=laws), layer(velocity_by_position={"k": other})
    ).velocity_by_position
    assert [law.deceleration for law in replaced] == [6.0, 5.0]
    for none in ({"j": None}, [None, LAW]):
        limits = resolved(arm, layer(velocity_by_position=laws), layer(velocity_by_position=none))
        assert [law.joint for law in limits.velocity_by_position] == [1]


@pytest.mark.parametrize("count", [1, 3])
def test_another_number_of_joints_is_refused(arm, count):
    with pytest.raises(RobotError) as caught:
        resolved(arm, layer(joint_count=count, jerk=500))
    message = f"the limits and motors are for {count} joints; the planning group has 2: j, k"
    assert str(caught.value) == message


def test_a_list_of_another_length_names_the_file(arm):
    with pytest.raises(RobotError, match=r"^the limits\.jerk has 3 values for 2 joints; give one"):
        resolved(arm, layer(jerk=[1, 2, 3]))


def test_an_unknown_joint_or_link_names_the_file(arm):
    with pytest.raises(
        RobotError, match=r"^the limits\.jerk: unknown joint 'l'; there is: j, k, f"
    ):
        resolved(arm, layer(jerk={"l": 1}))
    with pytest.raises(RobotError, match=r"^the limits\.point_speed: unknown link 'z'; there is"):
        resolved(arm, layer(point_speed=[PointSpeed("z", (0, 0, 0), 1.0)]))


def test_other_joints_are_left_out_where_a_file_may_name_them_and_followers_are_not(arm):
    limits = resolved(arm, layer(skips_others=True, velocity={"k": 2, "finger": 1, "f": 1}))
    np.testing.assert_array_equal(limits.velocity, [0.5, 2])


def test_a_file_of_other_joints_alone_is_refused(arm):
    with pytest.raises(RobotError) as caught:
        resolved(arm, layer(skips_others=True, velocity={"right": 1}, jerk={"left": 1}))
    assert str(caught.value) == (
        "the limits name no joint of the planning group, which has: j, k, f; they name left, right"
    )
    resolved(arm, layer(skips_others=True, jerk=500))


def test_notes_go_with_the_limits(arm):
    assert resolved(arm, layer(notes=("a",)), layer(notes=("b",))).notes == ("a", "b")
    assert resolved(arm, LimitOverrides()).notes == ()


def test_one_layer_may_stand_alone():
    robot = load_robot("example:two_link", "hand", limits=layer(jerk=500))
    np.testing.assert_array_equal(robot.limits.jerk, [500, 500])


@pytest.mark.parametrize("given", [["fr3"], [None], [LimitOverrides(), {"jerk": 5}]])
def test_what_are_no_limits_is_named(given):
    with pytest.raises(RobotError, match=r"^limits are .*; give LimitOverrides or a LimitLayer$"):
        load_robot("example:two_link", "hand", limits=given)
