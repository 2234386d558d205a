"""Limits from several places: which hold, and for which arms they are."""

import numpy as np
import pytest

from refusals import refusal
from tubeplanner import LimitLayer, LimitOverrides, PointSpeed, RobotError, load_robot
from tubeplanner.robot.joint_limits import resolve_limits
from tubeplanner.robot.urdf import read_urdf

INF = np.inf
LAW = {"deceleration": 6.0, "offset": 0.3, "lower": -1.0, "upper": 2.0}
OTHER = {"deceleration": 5.0, "offset": 0.0}


@pytest.fixture
def resolved(tmp_path):
    """Return a function from layers to the limits of j and k; f follows j twice as fast."""
    path = tmp_path / "arm.urdf"
    limit = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
    path.write_text(
        f"""<robot name="arm"><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
        <joint name="j" type="revolute"><parent link="a"/><child link="b"/>{limit}</joint>
        <joint name="k" type="revolute"><parent link="b"/><child link="c"/>{limit}</joint>
        <joint name="f" type="revolute"><parent link="b"/><child link="d"/>{limit}
        <mimic joint="j" multiplier="2"/></joint></robot>"""
    )
    return lambda *layers: resolve_limits(read_urdf(path), ["j", "k"], layers)


def layer(joint_count=None, skips_others=False, notes=(), **limits):
    return LimitLayer("the ", LimitOverrides(**limits), joint_count, skips_others, notes)


# By what the later layer does, layers and the limits that they become. f binds j's velocity.
MERGED = {
    "replaces joint by joint": (
        [
            layer(velocity=2.0, acceleration=[20, 30], jerk=500),
            layer(velocity=[1.0, 1.5], acceleration={"k": 25}),
            LimitOverrides(velocity={"j": 0.5}, effort=5),
        ],
        {"velocity": [0.5, 1.5], "acceleration": [20, 25], "jerk": [500, 500], "effort": [5, 5]},
    ),
    "lifts a list by inf": (
        [layer(jerk=[500, 600], acceleration=[1, 2]), LimitOverrides(jerk=INF)],
        {"jerk": [INF, INF], "acceleration": [1, 2]},
    ),
    "scales what is below": (
        [layer(velocity=1.0), LimitOverrides(scale={"velocity": 0.5})],
        {"velocity": [0.5, 0.5]},
    ),
    "scales by quantity": (
        [layer(scale={"velocity": 0.5, "effort": 0.1}), LimitOverrides(scale={"effort": 0.2})],
        {"velocity": [0.75, 1.5], "effort": [2, 2]},
    ),
    "leaves out joints that a file may name, and no followers": (
        [layer(skips_others=True, velocity={"k": 2, "finger": 1, "f": 1})],
        {"velocity": [0.5, 2]},
    ),
    "is of all joints": ([layer(skips_others=True, jerk=500)], {"jerk": [500, 500]}),
}


@pytest.mark.parametrize(("layers", "expected"), MERGED.values(), ids=MERGED)
def test_the_later_layer(resolved, layers, expected):
    limits = resolved(*layers)
    assert {name: getattr(limits, name).tolist() for name in expected} == expected


def test_the_tools_speed_and_points_of_the_last_layer_that_has_them_hold(resolved):
    low, high = PointSpeed("b", (0, 0, 0), 0.5), PointSpeed("c", (0, 0, 0), 1.5)
    layers = layer(tool_speed=1.7, point_speed=[low]), layer(tool_speed=0.4, point_speed=[high])
    limits = resolved(*layers, LimitOverrides())
    assert (limits.tool_speed, limits.point_speed) == (0.4, (high,))


@pytest.mark.parametrize(
    ("later", "held"),
    [({"k": OTHER}, [(0, 6.0), (1, 5.0)]), ({"j": None}, [(1, 6.0)]), ([None, LAW], [(1, 6.0)])],
)
def test_a_velocity_by_position_is_replaced_as_a_whole_or_taken_away(resolved, later, held):
    layers = [layer(velocity_by_position=each) for each in ([LAW, LAW], later)]
    laws = resolved(*layers).velocity_by_position
    assert [(law.joint, law.deceleration) for law in laws] == held


@pytest.mark.parametrize(
    ("given", "message"),
    [
        *(
            (
                {"joint_count": count, "jerk": 500},
                f"the limits and motors are for {count} joints; the planning group has 2: j, k",
            )
            for count in (1, 3)
        ),
        ({"jerk": [1, 2, 3]}, "the limits.jerk has 3 values for 2 joints; give one"),
        ({"jerk": {"l": 1}}, "the limits.jerk: unknown joint 'l'; there is: j, k, f"),
        (
            {"point_speed": [PointSpeed("z", (0, 0, 0), 1.0)]},
            "the limits.point_speed: unknown link 'z'; there is",
        ),
        (
            {"skips_others": True, "velocity": {"right": 1}, "jerk": {"left": 1}},
            "the limits name no joint of the planning group, which has: j, k, f; they name left, "
            "right",
        ),
    ],
)
def test_a_layer_of_another_arm_is_refused_by_its_name(resolved, given, message):
    assert refusal(RobotError, resolved, layer(**given)).startswith(message)


def test_notes_go_with_the_limits(resolved):
    assert resolved(layer(notes=("a",)), layer(notes=("b",))).notes == ("a", "b")
    assert resolved(LimitOverrides()).notes == ()


def test_one_layer_may_stand_alone_and_what_are_no_limits_is_named():
    robot = load_robot("example:two_link", "hand", limits=layer(jerk=500))
    assert robot.limits.jerk.tolist() == [500, 500]
    for given in (["fr3"], [None], [LimitOverrides(), {"jerk": 5}]):
        message = refusal(RobotError, load_robot, "example:two_link", "hand", limits=given)
        assert message.startswith("limits are ")
        assert message.endswith("; give LimitOverrides or a LimitLayer")
