"""Convex regions about segments, capsules and boxes, and their planes, native and NumPy."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tubeplanner import Tube
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube import regions
from tubeplanner.geometry.tube.regions import BoxRegions, Capsules
from tubeplanner.native.library import LIBRARY
from tubeplanner.optimizer import region_constraints
from tubeplanner.optimizer.region_constraints import EvaluatedRegions, Planes

NEEDS_LIBRARY = pytest.mark.skipif(LIBRARY.functions is None, reason="the library is left out")
LINE = [[0, 0, 0], [1, 0, 0]]
CORNER = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
FLAT = {"box": [0.2, 0.04], "up": [0, 0, 1]}  # 100 mm to either side in y, 20 mm up and down
FIRST = np.zeros(1, dtype=np.int64)


def unit_vectors(rng, count):
    normal = rng.normal(size=(count, 3))
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


# --- nearest points ------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [{"radius": 0.1}, {"radius": None, "cross_section": FLAT}])
def test_nearest_points_are_inside_and_nothing_inside_is_nearer(shape):
    rng, region = np.random.default_rng(4), Tube(LINE, **shape).regions
    p, segment = rng.uniform([-0.5] * 3, [1.5, 0.5, 0.5], (200, 3)), np.zeros(200, dtype=np.int64)
    nearest, is_inside = region.nearest(p, segment), region.margin(p, segment) >= 0
    assert 0 < is_inside.sum() < 200
    np.testing.assert_array_equal(nearest[is_inside], p[is_inside])
    assert region.margin(nearest, segment).min() > -1e-12
    # Of convex regions: all of them lies beyond the plane through the nearest point.
    ahead = np.einsum("pi,qpi->qp", p - nearest, p[is_inside, None] - nearest)
    assert ahead.max() < 1e-12


# --- native and NumPy ----------------------------------------------------------------------------

RNG = np.random.default_rng(2)
BEGIN = RNG.normal(size=(4, 3))
END = np.vstack([RNG.normal(size=(3, 3)), BEGIN[3:]])  # the last one is a ball
RANDOM_CAPSULES = Capsules(BEGIN, END, np.array([0.1, 0.3, 0.2, np.inf]))


@NEEDS_LIBRARY
@pytest.mark.parametrize("shape", [(20, 3), (5, 20, 3), (5, 1, 3), (0, 20, 3)])
def test_points_are_as_far_from_axes(shape, monkeypatch):
    p, segment = RNG.normal(size=shape), np.arange(20) % 4
    compiled = RANDOM_CAPSULES.margin(p, segment)
    monkeypatch.setattr(regions, "_away", None)
    np.testing.assert_allclose(compiled, RANDOM_CAPSULES.margin(p, segment), rtol=1e-13)


@NEEDS_LIBRARY
def test_normals_point_the_same_way(monkeypatch):
    p, segment = RNG.normal(size=(20, 3)), np.arange(20) % 4
    p[:4] = BEGIN
    compiled = RANDOM_CAPSULES.outward(p, segment)
    assert not compiled[:4].any()
    monkeypatch.setattr(regions, "_away", None)
    np.testing.assert_allclose(compiled, RANDOM_CAPSULES.outward(p, segment), atol=1e-14)


@NEEDS_LIBRARY
@pytest.mark.parametrize("bend", [None, RNG.normal(size=(8, 3))])
def test_planes_have_the_same_slack(bend, monkeypatch):
    tool, backoff, own = RNG.normal(size=(8, 3)), RNG.uniform(0, 0.1, 8), np.arange(8) % 4
    at = EvaluatedRegions(None, tool, None, RANDOM_CAPSULES, own, backoff, None)
    sample, other = np.array([[0, 1, 2, 4, 5, 6, 3, 7], [1, 2, 0, 0, 1, 0, 3, 3]])
    planes = Planes(sample, unit_vectors(RNG, 8), other, np.arange(8) % 2 == 0)
    compiled = at.slack(planes, bend)
    monkeypatch.setattr(region_constraints, "_plane_slack", None)
    np.testing.assert_allclose(compiled, at.slack(planes, bend), rtol=1e-11, atol=1e-12)


# --- capsules ------------------------------------------------------------------------------------

AXES = np.array([[0.0, 0, 0], [1, 0, 0], [1, 2, 0]])
CAPSULES = Capsules(AXES[:-1], AXES[1:], np.array([0.1, 0.5]))
SEGMENT = np.array([0, 0, 1, 1])
POINTS = np.array([[0.5, 0.05, 0], [-0.3, 0.4, 0], [1.0, 1.0, 0.25], [1.0, 3.0, 0.0]])


def test_distances_and_normals_are_those_to_the_axis_and_its_ends():
    distance, radius = np.array([0.05, 0.5, 0.25, 1.0]), np.array([0.1, 0.1, 0.5, 0.5])
    np.testing.assert_allclose(CAPSULES.margin(POINTS, SEGMENT), radius - distance)
    np.testing.assert_allclose(CAPSULES.fraction(POINTS, SEGMENT), distance / radius)
    rows = np.stack([POINTS, POINTS + 0.1, POINTS - 0.2])
    each = [CAPSULES.margin(row, SEGMENT) for row in rows]
    np.testing.assert_array_equal(CAPSULES.margin(rows, SEGMENT), each)
    outward = [[0, 1, 0], [-0.6, 0.8, 0], [0, 0, 1], [0, 1, 0]]
    np.testing.assert_allclose(CAPSULES.outward(POINTS, SEGMENT), outward, atol=1e-15)
    on_axis = np.array([[0.4, 0.0, 0.0], [0.4, 1e-12, 0.0]])
    np.testing.assert_array_equal(CAPSULES.outward(on_axis, np.array([0, 0])), np.zeros((2, 3)))
    assert CAPSULES.kinds(0) == ("radius",)
    assert CAPSULES.kind(POINTS, SEGMENT).tolist() == [0] * len(POINTS)


def test_both_caps_are_faces_and_a_ball_has_none():
    along, back = CAPSULES.faces(np.array([0, 1]))
    np.testing.assert_allclose(along, [[1, 0, 0], [0, 1, 0]])
    np.testing.assert_allclose(back, -along)
    ball = Capsules(AXES[:1], AXES[:1], np.array([0.3]))
    assert not np.any(ball.faces(np.array([0])))


def test_a_point_is_inside_just_if_no_plane_is_before_it():
    """n.p <= max(n.A, n.B) + extent for every n; and the outward plane touches the capsule."""
    rng = np.random.default_rng(0)
    p, segment = rng.uniform(-1, 3, (400, 3)), rng.integers(0, 2, 400)

    def beyond(n):
        ends = (CAPSULES.begin[segment], CAPSULES.end[segment])
        reach = np.maximum(*(np.einsum("ri,ri->r", n, end) for end in ends))
        return np.einsum("ri,ri->r", n, p) - reach - CAPSULES.extent(n, segment)

    margin = CAPSULES.margin(p, segment)
    assert (beyond(unit_vectors(rng, 400)) <= -margin + 1e-12).all()
    np.testing.assert_allclose(beyond(CAPSULES.outward(p, segment)), -margin, atol=1e-12)


# --- boxes ---------------------------------------------------------------------------------------

TURN = Rotation.from_rotvec([0.3, -1.1, 0.7])
CENTRE = np.array([0.3, -0.2, 0.5])


def box_tube(section=FLAT, points=LINE, radius=None, **others):
    return Tube(points, radius, cross_section=section, **others)


def turned(up):
    """Return a tube along a slanted line, whose upward direction may lean along it."""
    return box_tube(FLAT | {"up": TURN.apply(up).tolist()}, TURN.apply(LINE) + CENTRE)


def placed(p):
    return TURN.apply(np.array(p, dtype=float)) + CENTRE


TUBES = {
    "straight": (box_tube(), np.array),
    "turned": (turned([0, 0, 1]), placed),
    "slanted up": (turned([3, 0, 1]), placed),
    "long up": (turned([0, 0, 40]), placed),
}
# The tool in the straight tube, its margin, its fraction and the normal there.
PLACES = {
    "beside": ([0.5, 0.08, 0.01], 0.01, 0.8, [0, 1, 0]),
    "beside, out": ([0.5, -0.15, 0.01], -0.05, 1.5, [0, -1, 0]),
    "above": ([0.5, 0.02, 0.015], 0.005, 0.75, [0, 0, 1]),
    "below, out": ([0.2, 0.0, -0.03], -0.01, 1.5, [0, 0, -1]),
    "beyond the end": ([1.015, 0.0, 0.0], 0.005, 0.75, [1, 0, 0]),
    "before the begin, out": ([-0.03, 0.05, 0.0], -0.01, 1.5, [-1, 0, 0]),
    "in an edge": ([0.5, 0.1, 0.01], 0.0, 1.0, [0, 1, 0]),
}


@pytest.mark.parametrize("which", TUBES)
def test_margin_share_and_normal_have_closed_forms(which):
    tube, put = TUBES[which]
    for where, margin, fraction, normal in PLACES.values():
        p = put(where)[None]
        assert tube.margin(p)[0, 0] == pytest.approx(margin, abs=1e-12)
        assert tube.regions.margin(p, FIRST)[0] == pytest.approx(margin, abs=1e-12)
        assert tube.regions.fraction(p, FIRST)[0] == pytest.approx(fraction, abs=1e-9)
        expected = put(normal) - put([0, 0, 0])
        np.testing.assert_allclose(tube.regions.outward(p, FIRST)[0], expected, atol=1e-9)
    on_axis = put([0.4, 0, 0])[None]
    assert tube.regions.fraction(on_axis, FIRST)[0] == pytest.approx(0.0, abs=1e-12)
    exactly = np.array([[0.4, 0.0, 0.0]])
    np.testing.assert_array_equal(box_tube().regions.outward(exactly, FIRST), [[0, 0, 0]])


@pytest.mark.parametrize("which", TUBES)
def test_the_largest_component_of_a_deviation_is_the_used_fraction(which):
    tube, put = TUBES[which]
    for where, _, fraction, _ in PLACES.values():
        vector, _ = tube.regions.deviation(put(where)[None], FIRST)
        assert abs(vector).max() == pytest.approx(fraction, abs=1e-9)


def test_the_length_of_a_deviation_in_a_capsule_is_the_used_fraction():
    rng, segment = np.random.default_rng(5), np.arange(200) % 2
    p, capsules = rng.uniform(-0.5, 1.5, (200, 3)), Tube(CORNER, [0.1, 0.2]).regions
    length = np.linalg.norm(capsules.deviation(p, segment)[0], axis=1)
    np.testing.assert_allclose(length, capsules.fraction(p, segment), rtol=1e-12)


def test_a_box_has_six_faces_with_its_half_sides_as_extents():
    regions = box_tube().regions
    faces = [normal[0].tolist() for normal in regions.faces(FIRST)]
    assert sorted(faces) == sorted((sign * row).tolist() for sign in (1, -1) for row in np.eye(3))
    for normal, extent in zip(np.eye(3), (0.02, 0.1, 0.02), strict=True):
        assert regions.extent(normal[None], FIRST)[0] == pytest.approx(extent)
    aslant = np.array([[0.0, 0.6, 0.8]])
    assert regions.extent(aslant, FIRST)[0] == pytest.approx(0.6 * 0.1 + 0.8 * 0.02)


@pytest.mark.parametrize(
    ("normal", "flat", "tall"),
    [
        ([0, 1, 0], "width", "width"),
        ([0, 0, -1], "height", "height"),
        ([1, 0, 0], "height", "width"),  # the reach beyond the ends follows the smaller side
    ],
)
def test_each_face_has_a_tolerance(normal, flat, tall):
    for box, expected in (([0.2, 0.04], flat), ([0.04, 0.2], tall)):
        regions = box_tube({"box": box, "up": [0, 0, 1]}).regions
        assert regions.kinds(0) == ("width", "height")
        kind = regions.kind(np.array([normal], dtype=float), FIRST)[0]
        assert regions.kinds(0)[kind] == expected


def test_a_disc_among_boxes_is_a_capsule():
    tube = Tube(CORNER, [0.03, None], cross_section=[None, FLAT])
    plain = Capsules(tube.points[:-1], tube.points[1:], tube.effective_radius)
    p = np.random.default_rng(1).uniform(-0.1, 1.1, (50, 3)) * [1, 1, 0.1]
    zeros = np.zeros(50, dtype=np.int64)
    regions = tube.regions
    assert isinstance(regions, BoxRegions)
    np.testing.assert_array_equal(tube.is_box, [False, True])
    for name in ("margin", "fraction", "outward", "extent"):
        mine, others = (getattr(each, name)(p, zeros) for each in (regions, plain))
        np.testing.assert_array_equal(mine, others)
    assert regions.kinds(0) == ("radius",)
    np.testing.assert_array_equal(regions.kind(p, zeros), zeros)
    sides = [normal[0] for normal in regions.faces(FIRST)][2:]
    np.testing.assert_array_equal(sides, np.zeros((4, 3)))


def test_the_tool_radius_is_taken_off_every_half_side():
    tube = box_tube(tool_radius=0.005)
    np.testing.assert_allclose(tube.radius, [0.02])
    np.testing.assert_allclose(tube.effective_radius, [0.015])
    np.testing.assert_allclose(tube.reach, [0.095])
    p = np.array([[0.5, 0.09, 0.0], [0.5, 0.0, 0.01], [1.01, 0.0, 0.0]])
    np.testing.assert_allclose(tube.margin(p)[:, 0], [0.005, 0.005, 0.005])


@pytest.fixture(params=range(3))
def scene(request):
    """Return random numbers, a random box, and 300 places about it: about half are inside."""
    rng = np.random.default_rng(request.param)
    points = rng.uniform(-1, 1, (2, 3))
    section = {"box": rng.uniform(0.05, 0.6, 2).tolist(), "up": rng.normal(size=3).tolist()}
    return rng, box_tube(section, points), random_places(points, rng)


def random_places(points, rng):
    along = rng.uniform(-0.2, 1.2, (300, 1)) * (points[1] - points[0])
    return points[0] + along + rng.uniform(-0.25, 0.25, (300, 3))


def test_of_random_places_margin_and_share_tell_the_same(scene):
    _, whole, p = scene
    tube, zeros = replace(whole, tool_radius=0.01), np.zeros(300, dtype=np.int64)
    margin, fraction = tube.regions.margin(p, zeros), tube.regions.fraction(p, zeros)
    assert 10 < (margin >= 0).sum() < 290
    np.testing.assert_array_equal(fraction <= 1, margin >= 0)
    np.testing.assert_array_equal(tube.margin(p)[:, 0], margin)
    capsule = Tube(tube.points, tube.radius, tool_radius=0.01)
    assert (margin >= capsule.margin(p)[:, 0] - 1e-12).all()  # which is inside the box


def test_the_margin_is_concave_and_changes_by_no_more_than_the_point_moves(scene):
    rng, tube, p = scene
    q, fraction = random_places(tube.points, rng), rng.uniform(size=(300, 1))
    at_p, at_q, between = (tube.margin(x)[:, 0] for x in (p, q, p + fraction * (q - p)))
    assert (between >= at_p + fraction[:, 0] * (at_q - at_p) - 1e-12).all()
    assert (abs(at_p - at_q) <= np.linalg.norm(p - q, axis=1) + 1e-12).all()


def test_a_box_is_behind_every_plane_and_meets_it_in_a_corner(scene):
    rng, tube, p = scene
    regions, p = tube.regions, p[tube.margin(p)[:, 0] >= 0]
    normals = np.concatenate([unit_vectors(rng, 50), *regions.faces(FIRST)])
    zeros = np.zeros(len(normals), dtype=np.int64)
    behind = (normals @ tube.points.T).max(axis=1) + regions.extent(normals, zeros)
    assert (p @ normals.T <= behind + 1e-12).all()
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
    steps = (signs * regions.half[0]) @ regions.frame[0]
    corners = np.where(signs[:, 2:] < 0, tube.points[0], tube.points[1]) + steps
    np.testing.assert_allclose(tube.margin(corners), 0.0, atol=1e-12)
    np.testing.assert_allclose((corners @ normals.T).max(axis=0), behind, atol=1e-12)


def test_the_normal_is_where_the_share_grows(scene):
    _, tube, p = scene
    zeros, step = np.zeros(300, dtype=np.int64), 1e-7
    normal, fraction = tube.regions.outward(p, zeros), tube.regions.fraction(p, zeros)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0)
    grown = (tube.regions.fraction(p + step * normal, zeros) - fraction) / step
    face = abs(tube.regions.frame[0] @ normal.T).argmax(axis=0)
    np.testing.assert_allclose(grown, 1 / tube.regions.half[0, face], rtol=1e-5)


def test_radii_or_a_factor_scale_the_whole_box():
    tube = Tube(CORNER, [None, 0.03], cross_section=[FLAT, None], tool_radius=0.005)
    wide = tube.regions_of(2 * tube.effective_radius)
    np.testing.assert_allclose(wide.half[0], [0.19, 0.03, 0.03])
    assert wide.margin(np.array([[0.5, 0.18, 0.0]]), FIRST)[0] == pytest.approx(0.01)
    np.testing.assert_allclose(wide.radius, [0.03, 0.05])
    twice = tube.scaled(2.0)
    np.testing.assert_allclose(twice.radius, [0.04, 0.06])
    np.testing.assert_allclose(twice.cross_section[0], [0.4, 0.08, 0, 0, 1])
    assert twice.tool_radius == 0.005
    np.testing.assert_allclose(twice.regions.half[0], [0.195, 0.035, 0.035])
    np.testing.assert_array_equal(Tube(LINE, 0.02).scaled(1.5).radius, [0.03])
    of_discs = Tube(CORNER, 0.05, cross_section=[FLAT, None])
    np.testing.assert_allclose(of_discs.radius, [0.02, 0.05])


@pytest.mark.parametrize("nothing", [None, [None, None]])
def test_without_a_box_there_are_discs(nothing):
    tube = Tube(CORNER, 0.1, cross_section=nothing)
    assert tube.cross_section is None
    assert not tube.is_box.any()
    assert type(tube.regions) is Capsules
    np.testing.assert_array_equal(tube.reach, [0.1, 0.1])


def test_a_tube_made_from_a_tube_is_the_same_to_the_last_digit():
    up = [0.1, 0.2, 0.3]
    tube = Tube(CORNER, None, cross_section={"box": [0.2, 0.05], "up": up})
    again = replace(replace(tube, numbers=[3, 4, 5]), visit="any")
    np.testing.assert_array_equal(again.cross_section, tube.cross_section)
    np.testing.assert_array_equal(again.radius, tube.radius)


GIVE = "give box: [w, h] and up: [x, y, z]"


def bad(section, message, points=LINE, radius=None, **others):
    return section, points, radius, others, message


@pytest.mark.parametrize(
    ("section", "points", "radius", "others", "message"),
    [
        bad([FLAT, FLAT], "give one map with box and up, or 1, one for each segment"),
        bad(5, "tube.cross_section is 5; give one map"),
        bad({}, f"tube.cross_section[0] is {{}}; {GIVE}", radius=1),
        bad(FLAT | {"radius": 1}, GIVE),
        bad([FLAT, {"up": [0, 0, 1]}], "tube.cross_section[1] is {'up'", CORNER),
        bad(FLAT | {"box": [1]}, "tube.cross_section[0].box is [1]; give [w, h] [m], finite"),
        bad(FLAT | {"box": [0.1, 0]}, "box is [0.1, 0.0]; sides are from 2e-06 to 10000 m"),
        bad(FLAT | {"box": [np.nan, 0.1]}, "box is [nan, 0.1]; give [w, h] [m], finite numbers"),
        bad(FLAT | {"box": [True, 0.1]}, "box is [True, 0.1]; give [w, h] [m], finite numbers"),
        bad(FLAT | {"up": [0, 1]}, "tube.cross_section[0].up is [0, 1]; give [x, y, z], finite"),
        bad(FLAT | {"up": [2, 0, 0]}, "up is [2.0, 0.0, 0.0], parallel to its segment; give"),
        bad([None, FLAT | {"up": [0, 1, 0]}], "cross_section[1].up is", CORNER, 1),
        bad(FLAT, "tube.radius is 0.03 m, but every segment has a box", LINE, 0.03),
        bad(
            [None, FLAT],
            "tube.radius[1] is 0.05 m, but segment 1 has a box of 0.2 by 0.04 m "
            "(tube.cross_section): its radius is half of its smaller side; leave the radius null",
            CORNER,
            [0.05, 0.05],
        ),
        bad(FLAT, "tube.radius[0] is nan m, but segment 0 has a box", LINE, [np.nan]),
        bad(
            [None, FLAT],
            "tube.radius[0] is missing: segment 0 has no box (tube.cross_section); give one",
            CORNER,
        ),
        bad([FLAT, None], "tube.radius[1] is missing", CORNER, [None, None]),
        bad([FLAT, None], "tube.radius has 3 values for 2", CORNER, [1.0, 1.0, 1.0]),
        bad(None, "tube.radius [0.03, None] is no number or list", CORNER, [0.03, None]),
        bad(FLAT, "must be >= 0 and below the smallest radius, 0.02 m", tool_radius=0.02),
    ],
)
def test_bad_boxes_are_refused_by_name(section, points, radius, others, message):
    with pytest.raises(ProblemError) as error:
        Tube(points, radius, cross_section=section, **others)
    assert message in str(error.value)


def test_another_radius_does_not_go_with_a_box():
    tube = Tube(CORNER, [0.03, None], cross_section=[None, FLAT])
    with pytest.raises(ProblemError) as error:
        tube.with_radius(0.05)
    assert str(error.value).startswith("tube.cross_section: segment 1 has a box, which does not go")
    assert "Tube.scaled" in str(error.value)


def test_repeated_points_are_left_out_with_their_boxes():
    points = [[0, 0, 0], [1, 0, 0], [1, 0, 1e-8], [1, 1, 0]]  # of no length, and upward
    tube = Tube(points, None, cross_section=FLAT)
    assert tube.segment_count == 2
    np.testing.assert_array_equal(
        tube.cross_section, Tube(CORNER, None, cross_section=FLAT).cross_section
    )
    others = [FLAT, FLAT | {"box": [0.3, 0.04]}, FLAT]
    with pytest.raises(ProblemError, match="segment 1 between them would be left out"):
        Tube(points, None, cross_section=others)
