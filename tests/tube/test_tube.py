"""Tube: points, radii, rotation, joint signs; narrowed tubes, merged segments."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tubeplanner import Tube
from tubeplanner.errors import ProblemError
from tubeplanner.tube.joined_segments import joined_segments
from tubeplanner.tube.narrowed_tube import narrowed_tube

# The tube's geometry against brute force, and everything that can be wrong with a tube.


POINTS = [[0, 0, 0], [1, 0, 0], [1, 2, 0], [0.5, 2, 0.5]]
LINE = [[0, 0, 0], [1, 0, 0]]
CORNER = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
INF = np.inf
SPEED = "it must be from 1e-06 to 10000 m/s, or null where the tool's speed is free"


def random_points(count=100):
    return np.random.default_rng(1).uniform(-1, 3, (count, 3))


def test_distances_agree_with_brute_force_along_every_segment():
    tube, p = Tube(POINTS, 0.1), random_points()
    along = np.linspace(0, 1, 2001)[:, None]
    for k in range(tube.segment_count):
        samples = tube.points[k] + along * (tube.points[k + 1] - tube.points[k])
        brute = np.linalg.norm(p[:, None] - samples, axis=2).min(axis=1)
        found = tube.distance(p)[:, k]
        assert (found <= brute + 1e-12).all()
        assert (found >= brute - 1e-3).all()


@pytest.mark.parametrize(
    ("point", "nearest", "distance"),
    [
        ([0.3, 0.4, 0], [0.3, 0, 0], 0.4),
        ([-3, 4, 0], [0, 0, 0], 5.0),
        ([2, 0, 0], [1, 0, 0], 1.0),
        ([0.5, 0, 0], [0.5, 0, 0], 0.0),
    ],
    ids=["beside", "before the start", "beyond the end", "on the segment"],
)
def test_the_nearest_point_is_on_the_segment(point, nearest, distance):
    tube = Tube(LINE, 0.1)
    p = np.array([point], dtype=float)
    np.testing.assert_allclose(tube.nearest(p), [[nearest]], atol=1e-15)
    np.testing.assert_allclose(tube.distance(p), [[distance]], atol=1e-15)


def test_the_margin_is_what_is_left_of_each_effective_radius():
    tube = Tube(CORNER, [0.3, 0.5], tool_radius=0.1)
    np.testing.assert_allclose(tube.effective_radius, [0.2, 0.4])
    np.testing.assert_allclose(tube.margin(np.array([[0.5, 0.05, 0]])), [[0.15, -0.1]])


def test_part_of_the_segments_can_be_asked_for():
    tube, p, part = Tube(POINTS, [0.1, 0.2, 0.3]), random_points(), slice(1, 3)
    np.testing.assert_array_equal(tube.nearest(p, part), tube.nearest(p)[:, part])
    np.testing.assert_array_equal(tube.distance(p, part), tube.distance(p)[:, part])
    np.testing.assert_array_equal(tube.margin(p, part), tube.margin(p)[:, part])


def test_one_radius_serves_all_segments():
    np.testing.assert_array_equal(Tube(POINTS, 0.2).radius, [0.2, 0.2, 0.2])
    np.testing.assert_array_equal(Tube(POINTS, [0.1, 0.2, 0.3]).radius, [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("sign", "expected"),
    [
        ("+", (0, INF)),
        (1, (0, INF)),
        ("-", (-INF, 0)),
        (-1, (-INF, 0)),
        ("0", (-INF, INF)),
        (0, (-INF, INF)),
        ([-0.5, 2], (-0.5, 2)),
        ((0.3, 0.3), (0.3, 0.3)),
        ([-INF, 1.0], (-INF, 1.0)),
    ],
)
def test_a_sign_is_a_range(sign, expected):
    assert Tube(LINE, 0.1, joint_signs={"j": sign}).joint_ranges == ({"j": expected},)


def test_one_map_of_signs_serves_all_segments_and_other_joints_are_free():
    lower, upper = Tube(CORNER, 0.1, joint_signs={"j": "+"}).ranges_of(["i", "j"])
    np.testing.assert_array_equal(lower, [[-INF, 0], [-INF, 0]])
    np.testing.assert_array_equal(upper, [[INF, INF], [INF, INF]])


def test_a_map_per_segment_holds_in_its_segment():
    tube = Tube(CORNER, 0.1, joint_signs=[{"j": "-"}, {"j": [0, 2], "i": "+"}])
    lower, upper = tube.ranges_of(["i", "j"])
    np.testing.assert_array_equal(lower, [[-INF, -INF], [0, 0]])
    np.testing.assert_array_equal(upper, [[INF, 0], [INF, 2]])


def test_without_signs_every_joint_is_free():
    lower, upper = Tube(CORNER, 0.1).ranges_of(["i"])
    np.testing.assert_array_equal(lower, [[-INF], [-INF]])
    np.testing.assert_array_equal(upper, [[INF], [INF]])


@pytest.mark.parametrize(
    ("points", "radius", "options", "message"),
    [
        (5, 1, {}, "tube.points has shape (); at least two points [x, y, z] are needed"),
        ([[0, 0, 0]], 1, {}, "tube.points has shape (1, 3); at least two points"),
        ([[0, 0], [1, 0]], 1, {}, "tube.points has shape (2, 2); at least two points"),
        ([[0, 0, 0], [1, 0]], 1, {}, "tube.points: [[0, 0, 0], [1, 0]] is no list of points"),
        ([[0, 0, "a"], [1, 0, 0]], 1, {}, "is no list of points [x, y, z]"),
        ([[0, 0, 0], [1, 0, np.nan]], 1, {}, "tube.points must be finite numbers"),
        ([[0, 0, 0], [INF, 0, 0]], 1, {}, "tube.points must be finite numbers"),
        ([[0, 0, 0], [2e4, 0, 0]], 1, {}, "tube.points must be finite numbers within 10000 m"),
        ([[0, 0, 0], [1e-7, 0, 0]], 1, {}, "tube.points: points 0 and 1 are the same"),
        (
            [[0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0]],
            [1, 2, 3],
            {},
            "points 1 and 2 are the same within 1e-06 m; segment 1 between them would be left out",
        ),
        (
            CORNER,
            [1, 1, 1],
            {},
            "tube.radius has 3 values for 2 segments; give one, or one each",
        ),
        (LINE, 0, {}, "tube.radius[0] is 0 m; it must be from 1e-06 to 10000 m"),
        (CORNER, [0.1, -0.2], {}, "tube.radius[1] is -0.2 m; it must be from 1e-06 to 10000 m"),
        (LINE, np.nan, {}, "tube.radius[0] is nan m; it must be from 1e-06 to 10000 m"),
        (LINE, INF, {}, "tube.radius[0] is inf m; it must be from 1e-06 to 10000 m"),
        (
            CORNER,
            [0.3, 0.2],
            {"tool_radius": 0.2},
            "tube.tool_radius 0.2 m must be >= 0 and below the smallest radius, 0.2 m",
        ),
        (LINE, 1, {"tool_radius": -0.1}, "tube.tool_radius -0.1 m must be >= 0"),
        (LINE, 1, {"tool_radius": np.nan}, "tube.tool_radius nan m must be >= 0"),
        (
            LINE,
            1,
            {"visit": "order"},
            "tube.visit: unknown value 'order' (did you mean 'ordered'?); there is: ordered, any",
        ),
        (
            LINE,
            1,
            {"joint_signs": [{}, {}]},
            "tube.joint_signs has 2 maps for 1 segments; give one, or one each",
        ),
        (
            LINE,
            1,
            {"joint_signs": {"j": "++"}},
            "tube.joint_signs: joint 'j': '++' is none of '+', '-', '0', 1, -1, 0, [lower, upper]",
        ),
        (LINE, 1, {"joint_signs": {"j": 2}}, "joint 'j': 2 is none of '+', '-'"),
        (LINE, 1, {"joint_signs": {"j": True}}, "joint 'j': True is none of '+', '-'"),
        (LINE, 1, {"joint_signs": {"j": None}}, "joint 'j': None is none of '+', '-'"),
        (LINE, 1, {"joint_signs": {"j": [1, 0]}}, "joint 'j': the range [1, 0] is reversed"),
        (LINE, 1, {"joint_signs": {"j": [0, 1, 2]}}, "joint 'j': [0, 1, 2] is none of"),
        (
            LINE,
            1,
            {"joint_signs": {"j": [np.nan, 1]}},
            "joint 'j': the range [nan, 1] is reversed or no number",
        ),
        (
            CORNER,
            1,
            {"joint_signs": [{"j": [0, 1]}, {"j": [1.5, 2]}]},
            "tube.joint_signs: joint 'j' has the range [0.0, 1.0] in segment 0 and [1.5, 2.0] in "
            "segment 1, which do not meet",
        ),
        (LINE, 1, {"tool_speed": 0}, f"tube.tool_speed[0] is 0; {SPEED}"),
        (CORNER, 1, {"tool_speed": [None, -1.5]}, f"tube.tool_speed[1] is -1.5; {SPEED}"),
        (LINE, 1, {"tool_speed": np.nan}, f"tube.tool_speed[0] is nan; {SPEED}"),
        (LINE, 1, {"tool_speed": 9e-7}, f"tube.tool_speed[0] is 9e-07; {SPEED}"),
        (LINE, 1, {"tool_speed": 1e5}, f"tube.tool_speed[0] is 100000.0; {SPEED}"),
        (LINE, 1, {"tool_speed": -INF}, f"tube.tool_speed[0] is -inf; {SPEED}"),
        (LINE, 1, {"tool_speed": True}, f"tube.tool_speed[0] is True; {SPEED}"),
        (LINE, 1, {"tool_speed": "fast"}, f"tube.tool_speed[0] is 'fast'; {SPEED}"),
        (LINE, 1, {"tool_speed": [[1.0]]}, f"tube.tool_speed[0] is [1.0]; {SPEED}"),
        (LINE, 1, {"tool_speed": np.ones((1, 2))}, f"tube.tool_speed[0] is [1.0, 1.0]; {SPEED}"),
        (
            CORNER,
            1,
            {"tool_speed": [1.0, 1.0, None]},
            "tube.tool_speed has 3 values for 2 segments; give one, or one each, null where the "
            "tool's speed is free",
        ),
        (CORNER, 1, {"tool_speed": []}, "tube.tool_speed has 0 values for 2 segments; give one"),
    ],
)
def test_a_fault_is_named(points, radius, options, message):
    with pytest.raises(ProblemError) as caught:
        Tube(points, radius, **options)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "signs",
    [
        [{"j": "+"}, {"j": "-"}],
        [{"j": [0, 1]}, {"j": [1, 2]}],
        [{"j": [0, 1]}, {"i": [5, 6]}],
    ],
    ids=["a sign change at zero", "ranges that touch", "different joints"],
)
def test_ranges_that_meet_across_a_switching_time_are_accepted(signs):
    assert Tube(CORNER, 0.1, joint_signs=signs).segment_count == 2


def test_a_tube_keeps_its_own_copy_that_cannot_be_written_to():
    points = np.array(CORNER, dtype=float)
    tube = Tube(points, 0.1)
    points[0] = 9.0
    np.testing.assert_array_equal(tube.points, CORNER)
    for array in (tube.points, tube.radius):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_a_field_can_be_replaced():
    quaternions = [[0, 0, 0, 1], [0, 0, 1, 0], [0, 0, 0, 1]]
    tube = Tube(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0]],
        [0.1, 0.2],
        tool_radius=0.02,
        joint_signs=[{"j": "+"}, {"j": [0.1, 0.5]}],
        visit="any",
        orientations=[[0, 0, 0, 1], [0, 0, 0.1, 0.995], [0, 0, 0, 1]],
        rotation_tolerance=[0.1, (0.1, 0.2, np.inf)],
    )
    wider = dataclasses.replace(tube, radius=0.3)
    assert wider.radius.tolist() == [0.3, 0.3]
    assert wider.joint_ranges == tube.joint_ranges == ({"j": (0, np.inf)}, {"j": (0.1, 0.5)})
    assert (wider.tool_radius, wider.visit) == (0.02, "any")
    np.testing.assert_allclose(wider.rotation.bounds, tube.rotation.bounds)
    with pytest.raises(ProblemError, match="below the smallest radius"):
        dataclasses.replace(tube, radius=0.01)
    with pytest.raises(ProblemError, match="180 degrees"):
        dataclasses.replace(tube, orientations=quaternions)


def test_joint_signs_that_are_no_maps_are_bad_input():
    with pytest.raises(ProblemError, match=r"tube.joint_signs: '\+' is no map"):
        Tube(LINE, 0.1, joint_signs="+")


@pytest.mark.parametrize("radius", [1e-320, 9.9e-7, 0.0, np.nan, 1e5])
def test_a_radius_makes_sense_for_an_arm(radius):
    with pytest.raises(ProblemError, match=r"tube.radius\[0\] is .* m; it must be from 1e-06"):
        Tube([[0, 0, 0], [1, 0, 0]], radius)


@pytest.mark.parametrize("tool_radius", [0.1 - 1e-9, "a", None, True])
def test_a_tool_radius_leaves_a_tube(tool_radius):
    with pytest.raises(ProblemError, match=r"by at least 1e-06 m"):
        Tube([[0, 0, 0], [1, 0, 0]], 0.1, tool_radius=tool_radius)


@pytest.mark.parametrize("radius", [True, 1j, "1", np.ma.masked_all(1)])
def test_a_radius_is_a_number(radius):
    with pytest.raises(ProblemError, match="is no number or list of numbers"):
        Tube([[0, 0, 0], [1, 0, 0]], radius)


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        (0.5, [0.5, 0.5]),
        (np.float64(0.5), [0.5, 0.5]),
        (np.array(0.5), [0.5, 0.5]),
        ([None, 2], [INF, 2.0]),
        ((0.3, INF), [0.3, INF]),
        (np.array([0.3, INF]), [0.3, INF]),
    ],
)
def test_a_speed_is_one_or_one_each(given, kept):
    tube = Tube(CORNER, 0.1, tool_speed=given)
    assert tube.tool_speed.tolist() == kept
    assert tube.with_radius(0.2).tool_speed.tolist() == kept
    with pytest.raises(ValueError, match="read-only"):
        tube.tool_speed[0] = 1.0


@pytest.mark.parametrize("given", [None, INF, [None, None], [INF, None]])
def test_a_speed_that_is_free_everywhere_is_none(given):
    assert Tube(CORNER, 0.1, tool_speed=given).tool_speed is None


def test_some_points_keep_the_speeds_of_their_segments():
    tube = Tube([*CORNER, [5, 5, 5]], 0.1, tool_speed=[0.1, None, 0.3])
    assert tube.with_points([0, 2, 3], [1, 2]).tool_speed.tolist() == [INF, 0.3]
    assert tube.with_points([0, 1, 2], [1, 1]).tool_speed is None


NARROWED_POINTS = [[0, 0, 0], [0.4, 0, 0], [0.4, 0.3, 0.1]]
TURNED = [[0, 0, 0, 1], [0, 0, 0.5**0.5, 0.5**0.5], [0, 0, 0.5**0.5, 0.5**0.5]]
BOX = {"box": [0.06, 0.1], "up": [0, 0, 1]}
BY = np.array([0.01, 0.004])
NOT_TURNED = np.zeros(2)


@pytest.mark.parametrize(
    "tube",
    [
        Tube(NARROWED_POINTS, [0.03, 0.05]),
        Tube(NARROWED_POINTS, [0.03, 0.05], tool_radius=0.015),
        Tube(NARROWED_POINTS, [None, 0.05], cross_section=[BOX, None]),
        Tube(NARROWED_POINTS, None, cross_section=BOX, tool_radius=0.01),
    ],
    ids=["discs", "with a tool", "box and disc", "boxes"],
)
def test_every_point_is_inside_by_as_much_less(tube):
    """Also outside of it, where a corner of a box is nearest; there by no less than that."""
    tool = np.random.default_rng(0).uniform(-0.05, 0.45, (400, 3)) * [1, 1, 0.3]
    before, after = tube.margin(tool), narrowed_tube(tube, BY, NOT_TURNED).margin(tool)
    inside = after >= 0
    assert inside.any() and not inside.all()
    taken = before - after
    assert taken[:, ~tube.is_box] == pytest.approx(
        np.broadcast_to(BY, taken.shape)[:, ~tube.is_box]
    )
    assert (taken <= BY + 1e-12).all()
    assert taken[inside] == pytest.approx(np.broadcast_to(BY, taken.shape)[inside])


def test_rotation_tolerances_are_less_by_an_angle_free_ones_stay_free():
    tolerance = [0.2, (0.1, np.inf, 0.3)]
    tube = Tube(NARROWED_POINTS, 0.03, orientations=TURNED, rotation_tolerance=tolerance)
    narrowed = narrowed_tube(tube, np.zeros(2), np.array([0.05, 0.02]))
    bounds = narrowed.rotation.bounds
    assert bounds[0, 3] == pytest.approx(0.15)
    assert bounds[1, :3] == pytest.approx([0.08, np.inf, 0.28])
    assert (narrowed.points == tube.points).all()


def test_tools_in_boxes_turn_less_as_well():
    tube = Tube(
        NARROWED_POINTS,
        None,
        cross_section=BOX,
        orientations=TURNED,
        rotation_tolerance=[0.2, (0.1, 1, 1)],
    )
    bounds = narrowed_tube(tube, BY, np.array([0.05, 0.02])).rotation.bounds
    assert bounds[0, 3] == pytest.approx(0.15)
    assert bounds[1, :3] == pytest.approx([0.08, 0.98, 0.98])


def test_what_else_is_asked_stays():
    tube = Tube(
        NARROWED_POINTS,
        0.03,
        joint_signs={"joint2": "-"},
        pass_through_points="all",
        tool_speed=[0.2, None],
        numbers=[0, 3, 4],
    )
    narrowed = narrowed_tube(tube, BY, NOT_TURNED)
    assert narrowed.joint_ranges == tube.joint_ranges
    assert narrowed.tool_speed.tolist() == tube.tool_speed.tolist()
    assert narrowed.numbers.tolist() == [0, 3, 4]
    assert narrowed.pass_through_points == "all"


def test_nothing_left_is_no_tube():
    with pytest.raises(ProblemError, match=r"tube\.radius\[1\] is -0\.02 m"):
        narrowed_tube(Tube(NARROWED_POINTS, 0.03), np.array([0.0, 0.05]), NOT_TURNED)


JOINED_SEGMENTS_CORNER = np.array([[0, 0, 0], [0.7, 0, 0.1], [0.7, 0.9, 0.1]])
QUATERNIONS = Rotation.from_rotvec([[0, 0, 0.1], [0, 1.2, 0.3], [0.5, 1.0, 0]]).as_quat()


def divided(parts, quaternions=None, **options):
    """Return the corner's tube with every segment divided."""
    places = np.arange(2 * parts + 1) / parts
    points = np.array(
        [np.interp(places, [0, 1, 2], column) for column in JOINED_SEGMENTS_CORNER.T]
    ).T
    points[::parts] = JOINED_SEGMENTS_CORNER
    signs = [{"elbow": "+"}] * parts + [{"elbow": [0.0, 2.0]}] * parts
    if quaternions is not None:
        turned = Slerp([0, 1, 2], Rotation.from_quat(quaternions))(places).as_quat()
        turned[::parts] = quaternions
        options |= {"orientations": turned, "rotation_tolerance": [0.2] * parts + [0.3] * parts}
    speeds = [0.5] * parts + [None] * parts
    return Tube(
        points, np.repeat([0.1, 0.2], parts), joint_signs=signs, tool_speed=speeds, **options
    )


@pytest.mark.parametrize("parts", [2, 3, 16])
@pytest.mark.parametrize("quaternions", [None, QUATERNIONS], ids=["free", "turned"])
@pytest.mark.parametrize("visit", ["ordered", "any"])
def test_a_divided_line_is_one_segment_to_the_last_digit(parts, quaternions, visit):
    whole = divided(1, quaternions, visit=visit, tool_radius=0.01)
    given = divided(parts, quaternions, visit=visit, tool_radius=0.01)
    joined = joined_segments(given)
    np.testing.assert_array_equal(joined.points, whole.points)
    np.testing.assert_array_equal(joined.tool_speed, whole.tool_speed)
    np.testing.assert_array_equal(joined.radius, whole.radius)
    assert joined.joint_ranges == whole.joint_ranges
    assert (joined.visit, joined.tool_radius) == (visit, 0.01)
    assert joined.parts is given
    assert joined.numbers.tolist() == [0, parts, 2 * parts]
    if quaternions is not None:
        np.testing.assert_array_equal(joined.rotation.begin, whole.rotation.begin)
        np.testing.assert_array_equal(joined.rotation.turn, whole.rotation.turn)
        np.testing.assert_array_equal(joined.rotation.bounds, whole.rotation.bounds)
    assert joined_segments(joined) is joined


def test_a_segment_is_called_by_the_part_that_is_meant():
    joined = joined_segments(divided(4))
    assert [joined.segment_number(k) for k in (0, 1)] == [0, 4]
    near_the_end = np.array([0.69, 0.05, 0.1])
    assert joined.segment_number(0, near_the_end) == 3
    assert joined.segment_number(1, JOINED_SEGMENTS_CORNER[2]) == 7
    assert [joined.segment_index(number) for number in range(8)] == [0] * 4 + [1] * 4


JOINED_SEGMENTS_LINE = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
UP = [0, 0, 0, 1]


@pytest.mark.parametrize(
    ("points", "radius", "options"),
    [
        (JOINED_SEGMENTS_LINE, [0.1, 0.2], {}),
        (JOINED_SEGMENTS_LINE, 0.1, {"joint_signs": [{"elbow": "+"}, {"elbow": "0"}]}),
        (JOINED_SEGMENTS_LINE, 0.1, {"pass_through_points": "all"}),
        (JOINED_SEGMENTS_LINE, 0.1, {"tool_speed": [0.5, 0.6]}),
        (JOINED_SEGMENTS_LINE, 0.1, {"tool_speed": [None, 0.6]}),
        (JOINED_SEGMENTS_LINE, 0.1, {"orientations": [UP] * 3, "rotation_tolerance": [0.1, 0.2]}),
        (
            JOINED_SEGMENTS_LINE,
            0.1,
            {
                "orientations": [UP, [0, 0, np.sin(0.1), np.cos(0.1)], UP],
                "rotation_tolerance": 0.1,
            },
        ),
        ([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]], 0.1, {}),
        ([[0, 0, 0], [1, 0, 0], [0, 0, 0]], 0.1, {}),
        ([[0, 0, 0], [1, 2e-8, 0], [2, 0, 0]], 0.1, {}),
    ],
    ids=[
        "radius",
        "signs",
        "all",
        "speed",
        "free speed",
        "tolerance",
        "turn",
        "back",
        "there and back",
        "off",
    ],
)
def test_segments_that_ask_for_different_things_stay_apart(points, radius, options):
    tube = Tube(points, radius, **options)
    assert joined_segments(tube) is tube


@pytest.mark.parametrize("step", [1.0, np.pi / 4])
def test_segments_join_only_as_long_as_the_short_way_round_is_the_same(step):
    angles = np.arange(5) * step
    turned = Rotation.from_rotvec(angles[:, None] * [0, 0, 1]).as_quat()
    points = np.arange(5)[:, None] * [1.0, 0, 0]
    tube = Tube(points, 0.1, orientations=turned, rotation_tolerance=0.1)
    assert joined_segments(tube).numbers.tolist() == [0, 3, 4]


def test_orientations_that_bound_nothing_are_no_reason():
    turned = {"orientations": [UP, [1, 0, 0, 0], UP], "rotation_tolerance": np.inf}
    turned["orientations"][1] = [0, 0, np.sin(0.3), np.cos(0.3)]
    assert joined_segments(Tube(JOINED_SEGMENTS_LINE, 0.1, **turned)).segment_count == 1
