"""Reference points: polylines, corner reduction, checks, repetitions, compulsory points."""

from itertools import pairwise

import numpy as np
import pytest

from tubeplanner import Tube
from tubeplanner.errors import ProblemError
from tubeplanner.polyline import arc_lengths, densified
from tubeplanner.tube.compulsory_points import compulsory_points, passing_radius, turn_at
from tubeplanner.tube_sources.simplification import farthest_from_line, simplified

# Arc lengths and points between, against what a drawing says.


CORNERS = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0], [3.0, 5.0]])


def test_arc_lengths_are_those_of_a_drawing():
    assert arc_lengths(CORNERS) == pytest.approx([0, 5, 5, 6])


def test_arc_lengths_of_a_circle_come_near_its_circumference():
    angle = np.linspace(0, 2 * np.pi, 2001)
    points = np.column_stack([np.cos(angle), np.sin(angle)])
    assert arc_lengths(points)[-1] == pytest.approx(2 * np.pi, rel=1e-5)


def test_points_between_are_evenly_on_the_lines():
    found = densified(CORNERS, 1.5)
    lines = [[0, 0], [1, 4 / 3], [2, 8 / 3], [3, 4], [3, 4], [3, 5]]
    np.testing.assert_allclose(found, lines)


def test_no_coordinate_steps_farther_and_corners_stay():
    corners = np.random.default_rng(0).normal(size=(6, 7))
    found = densified(corners, 0.1)
    assert abs(np.diff(found, axis=0)).max() <= 0.1 + 1e-12
    assert all((found == corner).all(axis=1).any() for corner in corners)


# Few corners of a path.


CORNER = np.array([[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, 1, 0.0]])


def test_corners_are_kept_and_points_on_lines_are_not():
    assert simplified(CORNER, 0.01) == [0, 2, 4]


@pytest.mark.parametrize("deviation", [0.003, 0.01, 0.05])
def test_every_point_is_within_the_deviation_of_the_kept_lines(deviation):
    rng = np.random.default_rng(3)
    points = np.cumsum(rng.normal(0, 0.01, (300, 3)), axis=0)
    kept = simplified(points, deviation)
    assert kept[0] == 0 and kept[-1] == 299
    for i, j in pairwise(kept):
        ahead = points[j] - points[i]
        for point in points[i : j + 1]:
            share = np.clip((point - points[i]) @ ahead / (ahead @ ahead), 0, 1)
            assert np.linalg.norm(point - points[i] - share * ahead) <= deviation + 1e-12


def test_a_way_back_is_measured_from_the_segment_not_from_its_line():
    there_and_back = np.array([[0, 0, 0], [2.0, 0, 0], [1.0, 0, 0]])
    assert farthest_from_line(there_and_back, 0, 2) == (1, 1.0)


def test_equal_ends_and_neighbours_have_no_corner():
    still = np.zeros((3, 3))
    assert farthest_from_line(still, 0, 2) == (1, 0.0)
    assert farthest_from_line(still, 0, 1) == (0, 0.0)


LINE = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
TWICE = [[0, 0, 0], [1, 0, 0], [1, 5e-7, 0], [1, 1, 0]]
UP = [0, 0, 0, 1]


def test_a_point_like_the_one_before_is_left_out_with_its_segment_and_a_note():
    signs = [{"elbow": "+"}, {"elbow": "+"}, {"elbow": "0"}]
    tube = Tube(TWICE, [0.1, 0.1, 0.2], joint_signs=signs, tool_speed=[0.3, 0.3, 0.4])
    np.testing.assert_array_equal(tube.points, LINE)
    assert tube.radius.tolist() == [0.1, 0.2]
    assert tube.tool_speed.tolist() == [0.3, 0.4]
    assert tube.joint_signs == (signs[0], signs[2])
    assert tube.numbers.tolist() == [0, 1, 3]
    assert [tube.segment_number(k) for k in (0, 1)] == [0, 2]
    assert [tube.segment_index(number) for number in (0, 2)] == [0, 1]
    (note,) = tube.notes
    assert "point 2 is the same as the one before within 1e-06 m" in note
    assert "with segment 1" in note


def test_nothing_is_said_where_all_points_are_apart():
    tube = Tube(LINE, 0.1)
    assert tube.notes == ()
    assert tube.numbers.tolist() == [0, 1, 2]


@pytest.mark.parametrize("at", [0, 1, 2])
def test_orientations_go_with_their_points(at):
    points, quaternions = [*LINE[: at + 1], *LINE[at:]], [UP, UP, [0, 0, np.sin(0.3), np.cos(0.3)]]
    turned = [*quaternions[: at + 1], *quaternions[at:]]
    tube = Tube(points, 0.1, orientations=turned, rotation_tolerance=0.2)
    np.testing.assert_allclose(tube.orientations, quaternions)
    np.testing.assert_allclose(tube.rotation.angles, [0, 0.6])
    assert tube.rotation_tolerance == (0.2, 0.2)


@pytest.mark.parametrize("change", ["radius", "signs", "tolerance", "speed"])
def test_what_only_the_segment_left_out_asks_is_not_lost(change):
    signs = [{}, {"elbow": "+"} if change == "signs" else {}, {}]
    tolerance = [0.2, 0.1 if change == "tolerance" else 0.2, 0.2]
    radius = [0.1, 0.05 if change == "radius" else 0.1, 0.1]
    speed = [0.5, 0.4 if change == "speed" else 0.5, 0.5]
    turned = {"orientations": [UP] * 4, "rotation_tolerance": tolerance}
    with pytest.raises(ProblemError, match=r"points 1 and 2 .* segment 1 .* \(0 and 2\)"):
        Tube(TWICE, radius, joint_signs=signs, tool_speed=speed, **turned)


def test_a_turn_on_the_spot_is_refused():
    turned = [UP, UP, [0, 0, np.sin(0.1), np.cos(0.1)], UP]
    with pytest.raises(ProblemError, match=r"turn by 0.2 rad between them"):
        Tube(TWICE, 0.1, orientations=turned, rotation_tolerance=1.0)


def test_at_least_two_points_are_apart():
    with pytest.raises(ProblemError, match="points 0 and 2 are the same within 1e-06 m"):
        Tube([[0, 0, 0]] * 3, 0.1)


OUT_AND_BACK = [[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0]]


def bent(degrees):
    """Return three points that turn by an angle at the middle one."""
    angle = np.radians(degrees)
    return np.array([[-1, 0, 0], [0, 0, 0], [np.cos(angle), np.sin(angle), 0.0]])


@pytest.mark.parametrize(("degrees", "expected"), [(0, []), (90, []), (149, []), (151, [1])])
def test_a_corner_is_where_the_tube_turns_by_more_than_150_degrees(degrees, expected):
    assert turn_at(bent(degrees), 1, 0.0) == pytest.approx(np.radians(degrees), abs=1e-12)
    assert compulsory_points(bent(degrees), np.full(2, 0.1), "corners").tolist() == expected


@pytest.mark.parametrize(("rule", "expected"), [("all", [1, 2]), ("corners", [1]), ("none", [])])
def test_the_rule_says_which_points_are_passed(rule, expected):
    tube = Tube(OUT_AND_BACK, 0.1, pass_through_points=rule)
    assert tube.compulsory_points.tolist() == expected
    assert tube.with_radius(0.2).compulsory_points.tolist() == expected


def test_a_corner_that_is_divided_closely_is_one():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 0.004, 0], [0, 0.004, 0.0]])
    assert compulsory_points(points, np.full(3, 0.05), "corners").tolist() == [1]
    assert compulsory_points(points, np.full(3, 0.03), "corners").tolist() == []


def test_dense_points_turn_back_where_their_path_does():
    there = np.linspace(0, 1, 1001)[:, None] * [1.0, 0, 0]
    points = np.vstack([there, there[-2::-1]])
    found = compulsory_points(points, np.full(2000, 0.05), "corners")
    assert found.tolist() == [1000]


def test_all_points_close_are_no_reason_to_skip_all():
    points = np.array([[0, 0, 0], [0.001, 0, 0], [0, 0, 0]])
    assert compulsory_points(points, np.full(2, 1.0), "corners").tolist() == [1]


def test_a_point_is_passed_within_the_smaller_radius():
    assert passing_radius(np.array([0.1, 0.2, 0.05])).tolist() == [0.1, 0.05]


def test_an_unknown_rule_is_refused_by_name():
    with pytest.raises(ProblemError, match=r"tube.pass_through_points: .*some.*corners"):
        Tube(OUT_AND_BACK, 0.1, pass_through_points="some")
