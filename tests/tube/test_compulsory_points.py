import numpy as np
import pytest

from tubeplanner import Tube
from tubeplanner.errors import ProblemError
from tubeplanner.tube.compulsory_points import compulsory_points, passing_radius, turn_at

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
