"""Corner zones as tubes and back, beside blends sampled densely and formulas derived by hand."""

import numpy as np
import pytest

from tubeplanner import ProblemError, Tube, tube_from_zones, zones_of_tube
from tubeplanner.studies.tubes.zones import CONTROLLERS

ANGLES = (5, 60, 90, 120, 175)  # by which the path turns [degrees]
ABB = CONTROLLERS["abb"].named
U = np.linspace(0, 1, 2001)[:, None]


def corner(angle, length=1.0):
    """Return three points that turn by an angle [degrees], out of the axes' planes."""
    turn = np.radians(angle)
    flat = np.array([[-1, 0, 0], [0, 0, 0], [np.cos(turn), np.sin(turn), 0]])
    rotation = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    return length * flat @ rotation.T + [0.3, -0.2, 0.5]


def blends(points, zone):
    """Return sampled blends between both lines: the chord, a parabola, an arc and Pilz's mean."""
    here = points[1]
    a, b = (zone * line / np.linalg.norm(line) for line in (points[0] - here, points[2] - here))
    weight = U**3 * (10 - 15 * U + 6 * U**2)
    ramp = np.clip(2 * U, 0, 1)
    mean = (1 - weight) * (1 - ramp) * a + weight * np.clip(2 * U - 1, 0, 1) * b
    return [here + path for path in ((1 - U) * a + U * b, parabola(a, b), arc(a, b), mean)]


def parabola(a, b):
    return (1 - U) ** 2 * a + U**2 * b


def arc(a, b):
    """Return the arc that touches two lines through the origin at a and b."""
    size = np.linalg.norm(a)
    half = np.arccos(np.clip(a @ b / size**2, -1, 1)) / 2
    bisector = (a + b) / np.linalg.norm(a + b)
    across = (b - a) / np.linalg.norm(b - a)
    angle = (np.pi / 2 - half) * (2 * U - 1)
    radius = size * np.tan(half)
    height = size / np.cos(half) - radius * np.cos(angle)
    return bisector * height + across * radius * np.sin(angle)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_tube_holds_every_blend_of_a_zone_and_fills_it(angle):
    points, zone = corner(angle), 0.08
    tube = tube_from_zones(points, [zone], "ur", accuracy=1e-4)
    for path in blends(points, zone):
        assert np.linalg.norm(path - points[1], axis=1).max() <= zone + 1e-12
        assert tube.margin(path).max(axis=1).min() >= -1e-12
    directions = np.random.default_rng(0).standard_normal((20000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    for k in (1, 3):  # the ends of the pieces beside the corner
        wall = tube.points[k] + tube.radius[1] * directions
        assert 0.999 * zone < np.linalg.norm(wall - points[1], axis=1).max() <= zone + 1e-12
    wider = tube.with_radius([1e-4, 1.01 * 0.75 * zone, 1.01 * 0.75 * zone, 1e-4])
    outside = (points[1] + 1.001 * zone * (points[0] - points[1]))[None]
    pieces = slice(1, 3)
    assert tube.margin(outside, pieces).max() < 0 < wider.margin(outside, pieces).max()


@pytest.mark.parametrize("angle", ANGLES)
def test_the_largest_zone_of_an_even_tube_is_as_derived(angle):
    radius = 0.01
    tube = Tube(corner(angle, 4.0), radius, pass_through_points="none")
    for controller in ("kuka", "abb"):
        factor = 4 if CONTROLLERS[controller].blend == "parabola" else 2
        expected = min(2.0, factor * radius / np.sin(np.radians(angle)))
        (zone,) = zones_of_tube(tube, controller).zones
        if controller == "kuka":
            assert zone == pytest.approx(1e3 * expected, rel=1e-6, abs=2e-3)
        else:
            assert ABB[zone] <= expected + 1e-9
            assert all(size <= ABB[zone] or size > expected for size in ABB.values())


@pytest.mark.parametrize("angle", ANGLES)
def test_the_largest_zone_between_two_radii_is_as_derived(angle):
    wide, narrow, turn = 0.03, 0.01, np.radians(angle)
    if narrow >= wide * np.cos(turn):
        expected = (wide + narrow) / np.sin(turn)
    else:  # nearest of the wide line is the corner
        expected = np.sqrt(wide**2 - narrow**2) + narrow / np.tan(turn / 2)
    for radii in ([wide, narrow], [narrow, wide]):
        tube = Tube(corner(angle, 4.0), radii, pass_through_points="none")
        assert zones_of_tube(tube, "pilz").zones[0] == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize("controller", ["ur", "abb"])
@pytest.mark.parametrize(("angle", "rule"), [(90, "all"), (155, "corners"), (179, "corners")])
def test_blends_pass_a_compulsory_corner_and_wider_ones_do_not(angle, rule, controller):
    points, radius = corner(angle), 0.02
    tube = Tube(points, radius, pass_through_points=rule)
    (zone,) = zones_of_tube(tube, controller).zones
    if controller == "abb":
        blend, size = 1, ABB[zone]
        larger = min(other for other in ABB.values() if other > size)
    else:
        blend, size, larger = 0, zone, 1.01 * zone

    def missed(zone):
        """Return by how much the chord, or the parabola, passes beside the corner [m]."""
        return np.linalg.norm(blends(points, zone)[blend] - points[1], axis=1).min() - radius

    assert missed(size) <= 1e-9
    if angle > 150:  # at a right angle the walls are nearer
        assert missed(larger) > 0


def test_a_zone_ends_a_radius_beyond_a_compulsory_point_on_its_line():
    points = [[0, 0, 0], [0.97, 0, 0], [1, 0, 0], [1, 1, 0]]
    assert zones_of_tube(Tube(points, 0.02), "ur").zones == (0.04,)
    tube = Tube(points, 0.02, pass_through_points="all")
    assert zones_of_tube(tube, "ur").zones == (0.028284,)  # of the corner itself, by the chord
    wider = Tube(points, [0.005, 0.04, 0.04], pass_through_points="all")
    assert zones_of_tube(wider, "ur").zones == (0.035,)


@pytest.mark.parametrize(
    ("controller", "zones"),
    [
        ("abb", ("z50", "fine", "z100")),
        ("kuka", (40.0, 0.0, 65.5)),
        ("fanuc", ("CR30", "CR5", "CR120")),
        ("ur", (0.04, 0.0, 0.1)),
        ("pilz", (0.04, 0.001, 0.1)),
    ],
)
def test_zones_of_the_tube_from_zones_are_those(controller, zones):
    points = [[0, 0, 0], [0.5, 0, 0], [0.5, 0.5, 0], [0.5, 0.5, 0.5], [0, 0.5, 0.5]]
    tube = tube_from_zones(points, zones, controller, accuracy=1e-5)
    back = zones_of_tube(tube, controller)
    np.testing.assert_allclose(back.points, points, atol=1e-15)
    if isinstance(zones[0], str):
        assert back.zones == zones
    else:
        unit = CONTROLLERS[controller].unit
        np.testing.assert_allclose(np.array(back.zones) * unit, np.array(zones) * unit, atol=5e-5)


def test_joint_signs_and_tool_radius_are_kept():
    tube = tube_from_zones(corner(90), [0.1], "ur", accuracy=0.01, joint_signs={"elbow": "+"})
    assert [dict(ranges) for ranges in tube.joint_ranges] == [{"elbow": (0, np.inf)}] * 4
    thick = Tube(corner(90), 0.03, tool_radius=0.01)
    assert zones_of_tube(thick, "ur").zones == zones_of_tube(Tube(corner(90), 0.02), "ur").zones


ZIGZAG = [[0, 0, 0], [0.5, 0, 0], [0.5, 0.1, 0], [1, 0.1, 0]]
REFUSALS = [
    ("kuka", corner(90, 0.1), [60], "KUKA $APO.CDIS at point 1 reaches 0.06 m, beyond the middle"),
    ("abb", corner(90), ["z35"], "did you mean 'z5'.*there is: fine, z0, z1, z5, z10.*z150, z200"),
    ("abb", corner(90), [50], "50 is no name; there is: fine, z0, z1"),
    (
        "fanuc",
        corner(90),
        ["CNT50"],
        "CNT50 is a share of the speed and says nothing of the path",
    ),
    ("fanuc", corner(90), ["CRx"], "unknown zone 'CRx'.*there is: FINE, CR50"),
    ("ur", corner(90), ["z50"], "unknown zone 'z50'; there is: none"),
    ("pilz", corner(90), [-0.1], "Pilz blend_radius at point 1: -0.1 must be a finite number >= 0"),
    ("pilz", ZIGZAG, [0.06, 0.05], "points 1 and 2 reach 0.06 and 0.05 m and overlap"),
    ("staubli", corner(90), [0.1], "unknown controller 'staubli'; there is: abb, kuka, fanuc, ur"),
    ("ur", corner(90), [0.1, 0.1], "2 zones for 1 inner points; give one for each"),
    ("ur", corner(90), [0.01], "accuracy 0.01 m is coarser than the corner at point 1, 0.0075 m"),
]


@pytest.mark.parametrize(("controller", "points", "zones", "message"), REFUSALS)
def test_refusals_say_why(controller, points, zones, message):
    with pytest.raises(ProblemError, match=message.replace("$", r"\$")):
        tube_from_zones(points, zones, controller, accuracy=0.01)


def test_an_accuracy_that_is_none_is_refused():
    with pytest.raises(ProblemError, match=r"accuracy is 0 m; it must be > 0"):
        tube_from_zones(corner(90), [0.1], "ur", accuracy=0)
