"""Tube: points, radii, rotation, joint signs; narrowed tubes, merged segments."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from tubeplanner import Tube
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube.tube import joined_segments, narrowed_tube

POINTS = [[0, 0, 0], [1, 0, 0], [1, 2, 0], [0.5, 2, 0.5]]
LINE = [[0, 0, 0], [1, 0, 0]]
CORNER = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
STRAIGHT = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
UP = [0, 0, 0, 1]
INF = np.inf


# --- positions -----------------------------------------------------------------------------------


def test_distances_agree_with_brute_force_along_every_segment():
    tube, p = Tube(POINTS, [0.1, 0.2, 0.3]), np.random.default_rng(1).uniform(-1, 3, (100, 3))
    along, distance = np.linspace(0, 1, 2001)[:, None], tube.distance(p)
    for k in range(tube.segment_count):
        samples = tube.points[k] + along * (tube.points[k + 1] - tube.points[k])
        brute = np.linalg.norm(p[:, None] - samples, axis=2).min(axis=1)
        assert (distance[:, k] <= brute + 1e-12).all()
        assert (distance[:, k] >= brute - 1e-3).all()
    part = slice(1, 3)
    for of in (tube.nearest, tube.distance, tube.margin):
        np.testing.assert_array_equal(of(p, part), of(p)[:, part])


def test_the_nearest_point_is_on_the_segment():
    """Beside it, before its start, beyond its end, and where the point itself is."""
    tube, p = Tube(LINE, 0.1), np.array([[0.3, 0.4, 0], [-3, 4, 0], [2, 0, 0], [0.5, 0, 0]])
    nearest = [[0.3, 0, 0], [0, 0, 0], [1, 0, 0], [0.5, 0, 0]]
    np.testing.assert_allclose(tube.nearest(p)[:, 0], nearest, atol=1e-15)
    np.testing.assert_allclose(tube.distance(p)[:, 0], [0.4, 5, 1, 0], atol=1e-15)


def test_the_margin_is_what_is_left_of_each_effective_radius():
    tube = Tube(CORNER, [0.3, 0.5], tool_radius=0.1)
    np.testing.assert_allclose(tube.effective_radius, [0.2, 0.4])
    np.testing.assert_allclose(tube.margin(np.array([[0.5, 0.05, 0]])), [[0.15, -0.1]])


def test_a_tube_keeps_its_own_copy_that_cannot_be_written_to():
    points = np.array(CORNER, dtype=float)
    tube = Tube(points, 0.1)
    points[0] = 9.0
    np.testing.assert_array_equal(tube.points, CORNER)
    for array in (tube.points, tube.radius):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_a_field_can_be_replaced():
    tube = Tube(
        CORNER,
        [0.1, 0.2],
        tool_radius=0.02,
        joint_signs=[{"j": "+"}, {"j": [0.1, 0.5]}],
        visit="any",
        orientations=[UP, [0, 0, 0.1, 0.995], UP],
        rotation_tolerance=[0.1, (0.1, 0.2, INF)],
    )
    wider = replace(tube, radius=0.3)
    assert wider.radius.tolist() == [0.3, 0.3]
    assert wider.joint_ranges == tube.joint_ranges == ({"j": (0, INF)}, {"j": (0.1, 0.5)})
    assert (wider.tool_radius, wider.visit) == (0.02, "any")
    np.testing.assert_allclose(wider.rotation.bounds, tube.rotation.bounds)
    with pytest.raises(ProblemError, match="below the smallest radius"):
        replace(tube, radius=0.01)
    with pytest.raises(ProblemError, match="180 degrees"):
        replace(tube, orientations=[UP, [0, 0, 1, 0], UP])


# --- joint signs and tool speeds -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("sign", "expected"),
    [
        ("+", (0, INF)),
        ("-", (-INF, 0)),
        ("0", (-INF, INF)),
        ((0.3, 0.3), (0.3, 0.3)),
        ([-INF, 1.0], (-INF, 1.0)),
    ],
)
def test_a_sign_is_a_range(sign, expected):
    assert Tube(LINE, 0.1, joint_signs={"j": sign}).joint_ranges == ({"j": expected},)


@pytest.mark.parametrize(
    ("signs", "lower", "upper"),
    [
        (None, [[-INF, -INF]] * 2, [[INF, INF]] * 2),
        ({"j": "+"}, [[-INF, 0]] * 2, [[INF, INF]] * 2),
        ([{"j": "-"}, {"j": [0, 2], "i": "+"}], [[-INF, -INF], [0, 0]], [[INF, 0], [INF, 2]]),
        ([{"j": [0, 1]}, {"j": [1, 2]}], [[-INF, 0], [-INF, 1]], [[INF, 1], [INF, 2]]),
    ],
    ids=["none", "one map", "a sign change at zero", "ranges that touch"],
)
def test_one_map_serves_all_segments_or_each_has_its_own(signs, lower, upper):
    tube = Tube(CORNER, 0.1) if signs is None else Tube(CORNER, 0.1, joint_signs=signs)
    np.testing.assert_array_equal(tube.ranges_of(["i", "j"]), [lower, upper])


@pytest.mark.parametrize(
    ("speeds", "kept"),
    [
        (0.5, [0.5, 0.5]),
        (np.array(0.5), [0.5, 0.5]),
        ([None, 2], [INF, 2.0]),
        (np.array([0.3, INF]), [0.3, INF]),
    ],
)
def test_a_speed_is_one_or_one_each(speeds, kept):
    tube = Tube(CORNER, 0.1, tool_speed=speeds)
    assert tube.tool_speed.tolist() == kept
    assert tube.with_radius(0.2).tool_speed.tolist() == kept
    with pytest.raises(ValueError, match="read-only"):
        tube.tool_speed[0] = 1.0


@pytest.mark.parametrize("speeds", [None, INF, [None, None], [INF, None]])
def test_a_speed_that_is_free_everywhere_is_none(speeds):
    assert Tube(CORNER, 0.1, tool_speed=speeds).tool_speed is None


def test_some_points_keep_the_speeds_of_their_segments():
    tube = Tube([*CORNER, [5, 5, 5]], 0.1, tool_speed=[0.1, None, 0.3])
    assert tube.with_points([0, 2, 3], [1, 2]).tool_speed.tolist() == [INF, 0.3]
    assert tube.with_points([0, 1, 2], [1, 1]).tool_speed is None


# --- refusals ------------------------------------------------------------------------------------

COUNT = "has shape ({}); at least two points"
FINITE = "tube.points must be finite numbers"
NO_NUMBER = "is no number or list of numbers"
RADIUS = "m; it must be from 1e-06 to 10000 m"
TOOL_RADIUS = "must be >= 0 and below the smallest radius, {} m, by at least 1e-06 m"
SIGN = "is none of '+', '-', '0', 1, -1, 0, [lower, upper]"
SPEED = "it must be from 1e-06 to 10000 m/s, or null where the tool's speed is free"


def fault(message, points=LINE, radius=1, **options):
    return points, radius, options, message


def sign_fault(message, sign):
    return fault(f"tube.joint_signs: joint 'j': {message}", joint_signs={"j": sign})


def speed_fault(shown, speed, points=LINE, at=0):
    return fault(f"tube.tool_speed[{at}] is {shown}; {SPEED}", points, tool_speed=speed)


@pytest.mark.parametrize(
    ("points", "radius", "options", "message"),
    [
        fault(f"tube.points {COUNT.format('1, 3')} [x, y, z] are needed", [[0, 0, 0]]),
        fault(COUNT.format("2, 2"), [[0, 0], [1, 0]]),
        fault("tube.points: [[0, 0, 0], [1, 0]] is no list of points [", [[0, 0, 0], [1, 0]]),
        fault(FINITE, [[0, 0, 0], [1, 0, np.nan]]),
        fault(f"{FINITE} within 10000 m", [[0, 0, 0], [2e4, 0, 0]]),
        fault("tube.points: points 0 and 1 are the same", [[0, 0, 0], [1e-7, 0, 0]]),
        fault("tube.radius has 3 values for 2 segments; give one, or one each", CORNER, [1, 1, 1]),
        fault(f"tube.radius[0] is 0 {RADIUS}", LINE, 0),
        fault(f"tube.radius[1] is -0.2 {RADIUS}", CORNER, [0.1, -0.2]),
        fault(f"tube.radius[0] is nan {RADIUS}", LINE, np.nan),
        fault(f"tube.radius[0] is 9.9e-07 {RADIUS}", LINE, 9.9e-7),
        fault(NO_NUMBER, LINE, True),
        fault(NO_NUMBER, LINE, np.ma.masked_all(1)),
        fault("tube.tool_radius -0.1 m must be >= 0", tool_radius=-0.1),
        fault(TOOL_RADIUS.format(1), tool_radius=1 - 1e-9),
        fault(TOOL_RADIUS.format(1), tool_radius="a"),
        fault(
            "unknown value 'order' (did you mean 'ordered'?); there is: ordered, any", visit="order"
        ),
        fault("tube.joint_signs has 2 maps for 1 segments; give one, or one", joint_signs=[{}, {}]),
        fault("tube.joint_signs: '+' is no map", joint_signs="+"),
        sign_fault(f"'++' {SIGN}", "++"),
        sign_fault(f"True {SIGN}", True),
        sign_fault("the range [1, 0] is reversed", [1, 0]),
        sign_fault("the range [nan, 1] is reversed or no number", [np.nan, 1]),
        fault(
            "tube.joint_signs: joint 'j' has the range [0.0, 1.0] in segment 0 and [1.5, 2.0] in "
            "segment 1, which do not meet; give ranges that share a value; proved: there is no "
            "motion",
            CORNER,
            joint_signs=[{"j": [0, 1]}, {"j": [1.5, 2]}],
        ),
        speed_fault("-1.5", [None, -1.5], CORNER, 1),
        speed_fault("nan", np.nan),
        speed_fault("9e-07", 9e-7),
        speed_fault("True", True),
        speed_fault("'fast'", "fast"),
        fault("3 values for 2 segments; give one, or one each, null", CORNER, tool_speed=[1, 1, 1]),
    ],
)
def test_a_fault_is_named(points, radius, options, message):
    with pytest.raises(ProblemError) as caught:
        Tube(points, radius, **options)
    assert message in str(caught.value)


# --- narrowed tubes ------------------------------------------------------------------------------

AWAY = [[0, 0, 0], [0.4, 0, 0], [0.4, 0.3, 0.1]]
TURNED = [[0, 0, 0, 1], [0, 0, 0.5**0.5, 0.5**0.5], [0, 0, 0.5**0.5, 0.5**0.5]]
BOX = {"box": [0.06, 0.1], "up": [0, 0, 1]}
BY = np.array([0.01, 0.004])
NOT_TURNED = np.zeros(2)


@pytest.mark.parametrize(
    "tube",
    [
        Tube(AWAY, [0.03, 0.05]),
        Tube(AWAY, [0.03, 0.05], tool_radius=0.015),
        Tube(AWAY, [None, 0.05], cross_section=[BOX, None]),
        Tube(AWAY, None, cross_section=BOX, tool_radius=0.01),
    ],
    ids=["discs", "with a tool", "box and disc", "boxes"],
)
def test_every_point_is_inside_by_as_much_less(tube):
    """Also outside of it, where a corner of a box is nearest; there by no less than that."""
    tool = np.random.default_rng(0).uniform(-0.05, 0.45, (400, 3)) * [1, 1, 0.3]
    before, after = tube.margin(tool), narrowed_tube(tube, BY, NOT_TURNED).margin(tool)
    inside = after >= 0
    assert inside.any() and not inside.all()
    reduction, by = before - after, np.broadcast_to(BY, before.shape)
    assert reduction[:, ~tube.is_box] == pytest.approx(by[:, ~tube.is_box])
    assert (reduction <= by + 1e-12).all()
    assert reduction[inside] == pytest.approx(by[inside])


@pytest.mark.parametrize("shape", [{"radius": 0.03}, {"radius": None, "cross_section": BOX}])
def test_rotation_tolerances_are_less_by_an_angle_and_free_ones_stay_free(shape):
    tolerance = [0.2, (0.1, INF, 0.3)]
    tube = Tube(AWAY, **shape, orientations=TURNED, rotation_tolerance=tolerance)
    narrowed = narrowed_tube(tube, BY, np.array([0.05, 0.02]))
    bounds = narrowed.rotation.bounds
    assert bounds[0, 3] == pytest.approx(0.15)
    assert bounds[1, :3] == pytest.approx([0.08, INF, 0.28])
    assert (narrowed.points == tube.points).all()


def test_all_other_demands_stay():
    others = {"joint_signs": {"joint2": "-"}, "pass_through_points": "all", "numbers": [0, 3, 4]}
    tube = Tube(AWAY, 0.03, tool_speed=[0.2, None], **others)
    narrowed = narrowed_tube(tube, BY, NOT_TURNED)
    assert narrowed.joint_ranges == tube.joint_ranges
    assert narrowed.tool_speed.tolist() == tube.tool_speed.tolist()
    assert (narrowed.numbers.tolist(), narrowed.pass_through_points) == ([0, 3, 4], "all")


def test_nothing_left_is_no_tube():
    with pytest.raises(ProblemError, match=r"tube\.radius\[1\] is -0\.02 m"):
        narrowed_tube(Tube(AWAY, 0.03), np.array([0.0, 0.05]), NOT_TURNED)


# --- joined segments -----------------------------------------------------------------------------

BENT = np.array([[0, 0, 0], [0.7, 0, 0.1], [0.7, 0.9, 0.1]])
QUATERNIONS = Rotation.from_rotvec([[0, 0, 0.1], [0, 1.2, 0.3], [0.5, 1.0, 0]]).as_quat()
SIDEWAYS = [0, 0, np.sin(0.1), np.cos(0.1)]


def divided(parts, quaternions=None, **options):
    """Return the bent tube with every segment divided."""
    at = np.arange(2 * parts + 1) / parts
    points = np.array([np.interp(at, [0, 1, 2], column) for column in BENT.T]).T
    points[::parts] = BENT
    signs = [{"elbow": "+"}] * parts + [{"elbow": [0.0, 2.0]}] * parts
    if quaternions is not None:
        orientations = Slerp([0, 1, 2], Rotation.from_quat(quaternions))(at).as_quat()
        orientations[::parts] = quaternions
        options |= {
            "orientations": orientations,
            "rotation_tolerance": [0.2] * parts + [0.3] * parts,
        }
    speeds, radius = [0.5] * parts + [None] * parts, np.repeat([0.1, 0.2], parts)
    return Tube(points, radius, joint_signs=signs, tool_speed=speeds, **options)


@pytest.mark.parametrize("parts", [2, 3, 16])
@pytest.mark.parametrize(("quaternions", "visit"), [(None, "ordered"), (QUATERNIONS, "any")])
def test_a_divided_line_is_one_segment_to_the_last_digit(parts, quaternions, visit):
    whole = divided(1, quaternions, visit=visit, tool_radius=0.01)
    original = divided(parts, quaternions, visit=visit, tool_radius=0.01)
    joined = joined_segments(original)
    for name in ("points", "tool_speed", "radius"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(whole, name))
    assert joined.joint_ranges == whole.joint_ranges
    assert (joined.visit, joined.tool_radius) == (visit, 0.01)
    assert joined.parts is original
    assert joined.numbers.tolist() == [0, parts, 2 * parts]
    if quaternions is not None:
        for name in ("begin", "rotation_change", "bounds"):
            mine, others = (getattr(tube.rotation, name) for tube in (joined, whole))
            np.testing.assert_array_equal(mine, others)
    assert joined_segments(joined) is joined


def test_a_segment_is_called_by_the_part_that_is_meant():
    joined = joined_segments(divided(4))
    assert [joined.segment_number(k) for k in (0, 1)] == [0, 4]
    near_the_end = np.array([0.69, 0.05, 0.1])
    assert joined.segment_number(0, near_the_end) == 3
    assert joined.segment_number(1, BENT[2]) == 7
    assert [joined.segment_index(number) for number in range(8)] == [0] * 4 + [1] * 4


def apart(name, points=STRAIGHT, radius=0.1, **options):
    return pytest.param(points, radius, options, id=name)


@pytest.mark.parametrize(
    ("points", "radius", "options"),
    [
        apart("radius", radius=[0.1, 0.2]),
        apart("signs", joint_signs=[{"elbow": "+"}, {"elbow": "0"}]),
        apart("all", pass_through_points="all"),
        apart("speed", tool_speed=[0.5, 0.6]),
        apart("tolerance", orientations=[UP] * 3, rotation_tolerance=[0.1, 0.2]),
        apart("turn", orientations=[UP, SIDEWAYS, UP], rotation_tolerance=0.1),
        apart("back", [[0, 0, 0], [1, 0, 0], [0.5, 0, 0]]),
        apart("there and back", [[0, 0, 0], [1, 0, 0], [0, 0, 0]]),
        apart("off", [[0, 0, 0], [1, 2e-8, 0], [2, 0, 0]]),
    ],
)
def test_segments_of_different_demands_stay_apart(points, radius, options):
    tube = Tube(points, radius, **options)
    assert joined_segments(tube) is tube


@pytest.mark.parametrize("step", [1.0, np.pi / 4])
def test_segments_join_only_as_long_as_the_short_way_round_is_the_same(step):
    orientations = Rotation.from_rotvec(np.arange(5)[:, None] * [0, 0, step]).as_quat()
    points = np.arange(5)[:, None] * [1.0, 0, 0]
    tube = Tube(points, 0.1, orientations=orientations, rotation_tolerance=0.1)
    assert joined_segments(tube).numbers.tolist() == [0, 3, 4]


def test_orientations_that_bound_nothing_are_no_reason():
    rotation = {"orientations": [UP, SIDEWAYS, UP], "rotation_tolerance": INF}
    assert joined_segments(Tube(STRAIGHT, 0.1, **rotation)).segment_count == 1
