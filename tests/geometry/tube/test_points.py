"""Reference points: polylines, corner reduction, checks, repetitions, compulsory points."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tubeplanner import Tube
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube.points import (
    angle_at,
    arc_lengths,
    compulsory_points,
    densified,
    farthest_from_line,
    passing_radius,
    simplified,
)

LINE = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
TWICE = [[0, 0, 0], [1, 0, 0], [1, 5e-7, 0], [1, 1, 0]]
OUT_AND_BACK = [[0, 0, 0], [1, 0, 0], [0, 0, 0], [0, 1, 0]]
UP = [0, 0, 0, 1]


def test_arc_lengths_and_points_between_are_those_of_a_drawing():
    corners = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 4.0], [3.0, 5.0]])
    assert arc_lengths(corners) == pytest.approx([0, 5, 5, 6])
    on_lines = [[0, 0], [1, 4 / 3], [2, 8 / 3], [3, 4], [3, 4], [3, 5]]
    np.testing.assert_allclose(densified(corners, 1.5), on_lines)


def test_no_coordinate_steps_farther_and_corners_stay():
    corners = np.random.default_rng(0).normal(size=(6, 7))
    dense = densified(corners, 0.1)
    assert abs(np.diff(dense, axis=0)).max() <= 0.1 + 1e-12
    assert all((dense == corner).all(axis=1).any() for corner in corners)


@pytest.mark.parametrize("deviation", [0.003, 0.05])
def test_every_point_is_within_the_deviation_of_the_kept_lines(deviation):
    """And points on a line are left out, its corner is kept."""
    corner = np.array([[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, 1, 0.0]])
    assert simplified(corner, 0.01) == [0, 2, 4]
    points = np.cumsum(np.random.default_rng(3).normal(0, 0.01, (300, 3)), axis=0)
    corners = simplified(points, deviation)
    assert corners[0] == 0 and corners[-1] == 299
    for i, j in pairwise(corners):
        ahead, between = points[j] - points[i], points[i : j + 1] - points[i]
        fraction = np.clip(between @ ahead / (ahead @ ahead), 0, 1)[:, None]
        assert np.linalg.norm(between - fraction * ahead, axis=1).max() <= deviation + 1e-12


def test_distances_are_measured_from_the_segment_not_from_its_line():
    there_and_back = np.array([[0, 0, 0], [2.0, 0, 0], [1.0, 0, 0]])
    assert farthest_from_line(there_and_back, 0, 2) == (1, 1.0)
    still = np.zeros((3, 3))
    assert farthest_from_line(still, 0, 2) == (1, 0.0)
    assert farthest_from_line(still, 0, 1) == (0, 0.0)


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


@pytest.mark.parametrize("at", [0, 1, 2])
def test_orientations_go_with_their_points(at):
    points, quaternions = [*LINE[: at + 1], *LINE[at:]], [UP, UP, [0, 0, np.sin(0.3), np.cos(0.3)]]
    orientations = [*quaternions[: at + 1], *quaternions[at:]]
    tube = Tube(points, 0.1, orientations=orientations, rotation_tolerance=0.2)
    np.testing.assert_allclose(tube.orientations, quaternions)
    np.testing.assert_allclose(tube.rotation.angles, [0, 0.6])
    assert tube.rotation_tolerance == (0.2, 0.2)


@pytest.mark.parametrize("change", ["radius", "signs", "tolerance", "speed"])
def test_demands_of_the_segment_left_out_alone_are_not_lost(change):
    signs = [{}, {"elbow": "+"} if change == "signs" else {}, {}]
    tolerance = [0.2, 0.1 if change == "tolerance" else 0.2, 0.2]
    radius = [0.1, 0.05 if change == "radius" else 0.1, 0.1]
    speed = [0.5, 0.4 if change == "speed" else 0.5, 0.5]
    rotation = {"orientations": [UP] * 4, "rotation_tolerance": tolerance}
    with pytest.raises(ProblemError, match=r"points 1 and 2 .* segment 1 .* \(0 and 2\)"):
        Tube(TWICE, radius, joint_signs=signs, tool_speed=speed, **rotation)


def test_a_turn_on_the_spot_is_refused_and_so_is_a_single_point():
    orientations = [UP, UP, [0, 0, np.sin(0.1), np.cos(0.1)], UP]
    with pytest.raises(ProblemError, match=r"turn by 0.2 rad between them"):
        Tube(TWICE, 0.1, orientations=orientations, rotation_tolerance=1.0)
    with pytest.raises(ProblemError, match="points 0 and 2 are the same within 1e-06 m"):
        Tube([[0, 0, 0]] * 3, 0.1)


def corners_of(points, radius):
    """Return the compulsory points where every segment has the same radius [m]."""
    points = np.array(points, dtype=float)
    return compulsory_points(points, np.full(len(points) - 1, radius), "corners").tolist()


@pytest.mark.parametrize(("degrees", "expected"), [(0, []), (90, []), (149, []), (151, [1])])
def test_a_corner_is_where_the_tube_turns_by_more_than_150_degrees(degrees, expected):
    angle = np.radians(degrees)
    bent = np.array([[-1, 0, 0], [0, 0, 0], [np.cos(angle), np.sin(angle), 0.0]])
    assert angle_at(bent, 1, 0.0) == pytest.approx(angle, abs=1e-12)
    assert corners_of(bent, 0.1) == expected


@pytest.mark.parametrize(("rule", "expected"), [("all", [1, 2]), ("corners", [1]), ("none", [])])
def test_the_rule_says_which_points_are_passed(rule, expected):
    tube = Tube(OUT_AND_BACK, 0.1, pass_through_points=rule)
    assert tube.compulsory_points.tolist() == expected
    assert tube.with_radius(0.2).compulsory_points.tolist() == expected
    with pytest.raises(ProblemError, match=r"tube.pass_through_points: .*some.*corners"):
        replace(tube, pass_through_points="some")


def test_a_corner_of_close_points_is_one():
    divided = [[0, 0, 0], [1, 0, 0], [1, 0.004, 0], [0, 0.004, 0]]
    assert corners_of(divided, 0.05) == [1]
    assert corners_of(divided, 0.03) == []
    there = np.linspace(0, 1, 1001)[:, None] * [1.0, 0, 0]
    assert corners_of(np.vstack([there, there[-2::-1]]), 0.05) == [1000]
    all_close = [[0, 0, 0], [0.001, 0, 0], [0, 0, 0]]
    assert corners_of(all_close, 1.0) == [1]


def test_a_point_is_passed_within_the_smaller_radius():
    assert passing_radius(np.array([0.1, 0.2, 0.05])).tolist() == [0.1, 0.05]
