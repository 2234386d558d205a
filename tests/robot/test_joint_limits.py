"""Limits of the planned joints: the URDF's, replaced and scaled by layers of overrides."""

import numpy as np
import pytest
from arms import joint, link, links, written
from cases import refusal
from numpy.testing import assert_array_equal as same

from tubeplanner import LimitLayer, LimitOverrides, PointSpeed, RobotError, load_robot
from tubeplanner.robot.joint_limits import VelocityByPosition, resolve_limits
from tubeplanner.robot.urdf import read_urdf

INF = np.inf
COMPLETE = '<limit lower="-1" upper="2" effort="10" velocity="3"/>'
RANGE = "give a number from 1e-06 to 1e+09, or .inf for none"
QUANTITIES = ["effort", "velocity", "acceleration", "jerk", "effort_rate"]
LAW = {"deceleration": 6.0, "offset": 0.3}
FOLLOWER = joint("f", "b", "d", limit=COMPLETE + '<mimic joint="j" multiplier="2"/>')


@pytest.fixture
def describe(tmp_path):
    """Return a function that describes an arm of joints j and k, and what else it has."""

    def describe(limit_j=COMPLETE, limit_k=COMPLETE, kind="revolute", more=""):
        joints = joint("j", "a", "b", kind, limit=limit_j), joint("k", "b", "c", limit=limit_k)
        return read_urdf(written(tmp_path, links("a", "b", "c"), *joints, more))

    return describe


@pytest.fixture
def resolve(describe):
    """Return a function from limits of a problem to those of the arm."""

    def resolve(group="jk", limit_j=COMPLETE, limit_k=COMPLETE, kind="revolute", **given):
        description = describe(limit_j, limit_k, kind)
        return resolve_limits(description, list(group), LimitOverrides(**given))

    return resolve


@pytest.fixture
def resolved(describe):
    """Return a function from layers to the limits of j and k; f follows j twice as fast."""
    return lambda *layers: resolve_limits(describe(more=link("d") + FOLLOWER), ["j", "k"], layers)


def layer(joint_count=None, skips_others=False, notes=(), **limits):
    return LimitLayer("the ", LimitOverrides(**limits), joint_count, skips_others, notes)


def two_link(*given, **options):
    return load_robot("example:two_link", "hand", limits=given, **options).limits


def require(limits, **expected):
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(limits, name), values, rtol=1e-15, err_msg=name)


def test_without_overrides_the_limits_are_those_of_the_urdf_in_group_order(resolve):
    limits = resolve("kj", limit_k='<limit lower="-4" upper="5" effort="20" velocity="6"/>')
    require(limits, lower_position=[-4, -1], upper_position=[5, 2], effort=[20, 10])
    require(limits, velocity=[6, 3], acceleration=INF, jerk=INF, effort_rate=INF)
    assert limits.velocity_by_position == limits.point_speed == ()
    require(resolve("k", limit_j=""), effort=[10])  # others need no limits
    with pytest.raises(ValueError, match="read-only"):
        limits.effort[0] = 1.0
    q = np.array([[[-5.0, 0.5], [5.0, 2.0]]])
    same(resolve().clip(q), [[[-1.0, 0.5], [2.0, 2.0]]])


RATES = COMPLETE.replace("/>", ' acceleration="12" deceleration="{}" jerk="400"/>')


@pytest.fixture
def newer(tmp_path):
    """Return a function that describes an arm of URDF 1.2 whose follower f takes twice as much."""

    def newer(limit, follower=COMPLETE):
        more = link("d") + joint(
            "f", "b", "d", limit=follower + '<mimic joint="j" multiplier="2"/>'
        )
        path = written(tmp_path, links("a", "b"), joint("j", "a", "b", limit=limit), more)
        path.write_text(path.read_text().replace("<robot", '<robot version="1.2"'))
        return read_urdf(path)

    return newer


def test_a_urdf_has_accelerations_from_version_1_2_on_and_the_smaller_holds(newer):
    arm = newer(RATES.format(9))
    require(resolve_limits(arm, ["j"], ()), acceleration=[9], jerk=[400])
    assert arm.joints["j"].accelerations == (12, 9)
    require(resolve_limits(newer(RATES.format(15)), ["j"], ()), acceleration=[12])
    given = LimitOverrides(acceleration=20, scale={"acceleration": 0.5})
    require(resolve_limits(arm, ["j"], given), acceleration=[10], jerk=[400])
    both = newer(RATES.format(12), RATES.format(8))
    require(resolve_limits(both, ["j"], ()), acceleration=[4], jerk=[200])


def test_an_acceleration_of_a_urdf_must_be_one_unless_it_is_replaced(newer):
    arm = newer(RATES.format(0))
    message = "joint 'j' has acceleration limit 0; give a positive one in robot.limits.acceleration"
    assert message in refusal(RobotError, resolve_limits, arm, ["j"], ())
    require(resolve_limits(arm, ["j"], LimitOverrides(acceleration=3)), acceleration=[3])
    alone = newer(COMPLETE.replace('lower="-1" ', ""))
    assert "has position limits [0, 0]" in refusal(RobotError, resolve_limits, alone, ["j"], ())


def test_overrides_replace_only_what_they_name(resolve):
    replaced = {"effort": {"j": 7}, "velocity": {"k": INF}, "position": {"j": (0.25, 8)}}
    limits = resolve(**replaced, acceleration={"k": 9}, jerk={"j": 11})
    require(limits, effort=[7, 10], velocity=[3, INF], acceleration=[INF, 9], jerk=[11, INF])
    require(limits, lower_position=[0.25, -1], upper_position=[8, 2])
    require(resolve("kj", position=[(-1, 1), (-2, 2)]), upper_position=[2, 1])


def test_scale_acts_on_replaced_limits_too_and_never_on_other_quantities(resolve):
    scale = {"effort": 0.5, "velocity": 0.25, "acceleration": 0.25}
    given = {"effort": {"j": 8}, "acceleration": {"j": 6}, "jerk": {"j": 4}}
    limits = resolve(**given, effort_rate={"k": 1000}, scale=scale)
    require(limits, effort=[4, 5], velocity=[0.75, 0.75], acceleration=[1.5, INF], jerk=[4, INF])
    require(limits, effort_rate=[INF, 1000], lower_position=[-1, -1])


@pytest.mark.parametrize(
    ("values", "quantity", "value"),
    [
        (None, "effort", "none"),
        ('effort="1"', "velocity", "none"),
        ('effort="1" velocity="-5"', "velocity", "-5"),
        ('effort="inf" velocity="1"', "effort", "inf"),
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


def test_an_empty_position_range_is_refused(resolve):
    empty = '<limit lower="2" upper="1" effort="1" velocity="1"/>'
    message = refusal(RobotError, resolve, limit_j=empty)
    assert "arm.urdf: joint 'j' has position limits [2, 1], an empty range; give them in" in message
    for given, shown in (((3, -3), "[3, -3]"), ((np.nan, 1), "[nan, 1]"), ((0, 0), "[0, 0]")):
        message = refusal(RobotError, resolve, position={"j": given})
        assert f"robot.limits.position: joint 'j' has position limits {shown}" in message


@pytest.mark.parametrize("margin", [0.25, [0.25, 0.25], {"j": 0.25, "k": 0.25}])
def test_a_margin_comes_off_the_position_limits_of_any_source(resolve, margin):
    """But not off the ends that a velocity by position falls towards."""
    position, law = {"k": [-3.0, 3.0]}, {"velocity_by_position": {"j": LAW}}
    limits = resolve(position=position, position_margin=margin, **law)
    require(limits, lower_position=[-0.75, -2.75], upper_position=[1.75, 2.75])
    require(limits, position_margin=[0.25, 0.25])
    assert (limits.velocity_by_position[0].lower, limits.velocity_by_position[0].upper) == (-1, 2)
    endless = resolve("j", kind="continuous", position_margin=0.25)
    require(endless, lower_position=[-INF], upper_position=[INF])


def test_a_margin_that_leaves_no_range_is_refused(resolve):
    require(resolve(position_margin={"j": 1.4}), lower_position=[0.4, -1], upper_position=[0.6, 2])
    assert refusal(RobotError, resolve, position_margin={"j": 1.5}) == (
        "robot.limits.position_margin: joint 'j' at 1.5 has nothing left of its range [-1, 2]; "
        "give less than 1.5"
    )


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


MAGNITUDES = "give magnitudes from 1e-06 to 1e+09"
AS_MANY = "; give as many numbers in position as in effort, at least one"
NO_EFFORTS = (
    ([1, 0], f"[1, 0] has 0; {MAGNITUDES}"),
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
    ({"position": [0, 1], "effort": [1]}, f"{{'position': [0, 1], 'effort': [1]}}{AS_MANY}"),
    ({"position": [], "effort": []}, f"{{'position': [], 'effort': []}}{AS_MANY}"),
    ({"position": [0, 0], "effort": [1, 2]}, "position [0, 0]; give finite numbers that increase"),
    ({"position": [0, 1], "effort": [1, -2]}, f"effort [1, -2] has -2; {MAGNITUDES}"),
)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"effort": {"j": 0}}, f"effort: joint 'j' at 0; {RANGE}"),
        ({"acceleration": {"j": np.nan}}, f"acceleration: joint 'j' at nan; {RANGE}"),
        ({"effort": {"j": 1e10}}, f"effort: joint 'j' at 1e+10; {RANGE}"),
        ({"velocity": {"j": True}}, f"velocity: joint 'j' at True; {RANGE}"),
        ({"effort_rate": -1}, f"effort_rate is -1; {RANGE}"),
        ({"jerk": [1, 0]}, f"jerk[1] is 0; {RANGE}"),
        ({"effort": [3, [1, 2]]}, f"effort[1] is [1, 2]; {RANGE}"),  # only a map has pairs
        ({"effort": "strong"}, "effort is 'strong'; it must be one number for all joints, a list"),
        ({"position_margin": -0.1}, "position_margin is -0.1; give a number from 0 to 1e+09"),
        (
            {"position_margin": {"j": INF}},
            "position_margin: joint 'j' at inf; give a num",
        ),
        ({"position": 5}, "position is 5; it must be a map by name, or a list"),
        ({"position": {"j": [1]}}, "position: joint 'j' at [1]; give [lower, upper"),
        ({"position": [[0, [1]], [0, 1]]}, "position[0] is [0, [1]]; give [low"),
        ({"scale": "effort"}, "scale is 'effort'; it must be a map by name"),
        ({"scale": {"effort": 0}}, "scale: effort at 0 must be in (0, 1]"),
        (
            {"scale": {"efort": 1}},
            "scale: unknown quantity 'efort' (did you mean 'effort'?); there is: effort, velocity, "
            "acceleration",
        ),
        *(({"effort": {"j": value}}, f"effort: joint 'j' at {m}") for value, m in NO_EFFORTS),
        *(
            ({"tool_speed": value}, f"tool_speed is {value!r}; give a number from 1e-06 m/s")
            for value in (0, np.nan, True, [1.0])
        ),
        *(
            ({"point_speed": value}, f"point_speed is {value!r}; give a list of Point")
            for value in (3, [{"link": "c"}], "c")
        ),
    ],
)
def test_a_senseless_override_is_refused_at_once(given, message):
    assert refusal(RobotError, LimitOverrides, **given).startswith(f"robot.limits.{message}")


@pytest.mark.parametrize(("given", "held"), [(None, INF), (1, 1.0)])
def test_the_tools_speed_is_free_unless_it_is_given(resolve, given, held):
    assert resolve(tool_speed=given, scale={"velocity": 0.5}).tool_speed == held


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


TABLE = {"position": [-1.0, 0.0, 2.0], "effort": [10, 20, 16]}


def test_a_table_is_linear_between_its_positions_and_a_pair_holds_by_direction_everywhere():
    effort = {"joint1": TABLE, "joint2": [60, 40]}
    limits = two_link(LimitOverrides(effort=effort, scale={"effort": 0.5}))
    table, pair = limits.effort_ranges
    q = np.array([-5, -1, -0.5, 0, 1, 2, 9])
    for sign, allowed in ((-1, 30), (1, 20)):
        np.testing.assert_allclose(table.allowed(q, sign), [5, 5, 7.5, 10, 9, 8, 8])
        np.testing.assert_allclose(table.slope(q, sign), [0, 5, 5, -1, -1, 0, 0])
        same(pair.allowed(q, sign), np.full(7, allowed))
        same(pair.slope(q, sign), np.zeros(7))
    assert [one.joint for one in limits.effort_ranges] == [0, 1]
    same(limits.effort, [10, 30])
    same(table.position, TABLE["position"])
    for name in ("position", "backwards", "forwards"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(table, name)[0] = 2.0


def test_what_is_the_same_everywhere_is_a_number():
    table, longer = {"position": [0], "effort": [7]}, {"position": [0, 1], "effort": [7, 7]}
    for each in ([7, 7], table, longer):
        both = two_link(LimitOverrides(effort={"joint1": each}))
        assert (both.effort_ranges, both.effort[0]) == ((), 7)


def test_a_later_layer_replaces_it_as_a_whole_and_the_group_decides_the_order():
    given = LimitOverrides(effort={"joint1": TABLE, "joint2": [1, 2]})
    both = two_link(LimitLayer("preset a: ", given), LimitOverrides(effort={"joint1": 5}))
    assert [one.joint for one in both.effort_ranges] == [1]
    assert both.effort[0] == 5
    both = two_link(given, joints=["joint2", "joint1"])
    assert [(one.joint, len(one.position)) for one in both.effort_ranges] == [(0, 1), (1, 3)]


def test_a_point_is_three_numbers_however_they_come_and_a_speed():
    for position in ((0, 0, 1), [0, 0, 1], np.array([0.0, 0.0, 1.0])):
        assert PointSpeed("hand", position, 1) == PointSpeed("hand", (0.0, 0.0, 1.0), 1)
    for position in ((0, 0), 3, (0, 0, INF), (0, True, 0)):
        message = refusal(RobotError, PointSpeed, "hand", position, 1.0)
        assert "of link 'hand': position is " in message and "; give [x, y, z] i" in message
    for speed in (0, INF, 2e9, True):
        message = refusal(RobotError, PointSpeed, "hand", (0, 0, 0), speed)
        assert "of link 'hand': speed is " in message and "; give a number from 1e" in message


WHOLE = LAW | {"lower": -1.0, "upper": 2.0}
OTHER = {"deceleration": 5.0, "offset": 0.0}
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
    "has its margin from a limit of an earlier one": (
        [layer(position={"k": [-2.0, 2.0]}, position_margin=0.5), layer(position_margin={"j": 0})],
        {"lower_position": [-0.5, -1.5], "upper_position": [1, 1.5], "position_margin": [0, 0.5]},
    ),
    "lifts a list by inf": (
        [layer(jerk=[500, 600], acceleration=[1, 2]), LimitOverrides(jerk=INF)],
        {"jerk": [INF, INF], "acceleration": [1, 2]},
    ),
    "scales by quantity what is below": (
        [layer(effort=5, scale={"velocity": 0.5, "effort": 0.1}), layer(scale={"effort": 0.2})],
        {"velocity": [0.75, 1.5], "effort": [1, 1]},
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
    [({"k": OTHER}, [(0, 6.0), (1, 5.0)]), ({"j": None}, [(1, 6.0)]), ([None, WHOLE], [(1, 6.0)])],
)
def test_a_velocity_by_position_is_replaced_as_a_whole_or_taken_away(resolved, later, held):
    layers = [layer(velocity_by_position=each) for each in ([WHOLE, WHOLE], later)]
    laws = resolved(*layers).velocity_by_position
    assert [(law.joint, law.deceleration) for law in laws] == held


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"joint_count": 3, "jerk": 500},
            "the limits and motors are for 3 joints; the planning group has 2: j, k",
        ),
        ({"jerk": {"l": 1}}, "the limits.jerk: unknown joint 'l'; there is: j, k, f"),
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
    alone = load_robot("example:two_link", "hand", limits=layer(jerk=500))
    same(alone.limits.jerk, [500, 500])
    for given in ("fr3", {"jerk": 5}):
        message = refusal(RobotError, two_link, LimitOverrides(), given)
        assert message.startswith("limits are ")
        assert message.endswith("; give LimitOverrides or a LimitLayer")
