"""Which values go together: all of a grid, or as many as asked of a Latin hypercube."""

from itertools import product

import numpy as np
import pytest

from studied import between
from tubeplanner.errors import ProblemError
from tubeplanner.studies.axes import Levels
from tubeplanner.studies.study_points import MOST_POINTS, Latin, StudyPoints


def test_a_grid_has_all_pairs_the_last_field_first():
    first, second, third = (1, 2), ("a", "b", "c"), (None,)
    points = StudyPoints([Levels("p", first), Levels("q", second), Levels("r", third)], None)
    assert len(points) == 6
    expected = [dict(zip("pqr", each, strict=True)) for each in product(first, second, third)]
    assert [point.values for point in points] == expected
    assert [point.index for point in points] == list(range(6))
    assert points[4].values == {"p": 2, "q": "b", "r": None}
    with pytest.raises(IndexError):
        points[6]


def test_a_latin_hypercube_has_one_point_in_every_part_of_every_field():
    axes = [between("p", 0, 10), between("q", 1, 1024, log=True), Levels("r", ("a", "b"))]
    points = StudyPoints(axes, Latin(10, seed=3))
    values = [point.values for point in points]
    assert len(values) == len(points) == 10
    assert sorted(int(each["p"]) for each in values) == list(range(10))
    assert sorted(int(np.log2(each["q"])) for each in values) == list(range(10))
    assert [each["r"] for each in values].count("a") == 5
    again, other = StudyPoints(axes, Latin(10, seed=3)), StudyPoints(axes, Latin(10, seed=4))
    assert [point.values for point in again] == values
    assert [point.values for point in other] != values


def test_points_are_made_one_by_one():
    many = StudyPoints([Levels("p", range(3000)), Levels("q", range(3000))], None)
    assert len(many) == 9_000_000
    assert many[8_999_999].values == {"p": 2999, "q": 2999}


def test_what_cannot_be_counted_is_refused():
    with pytest.raises(ProblemError, match="p: count is required in a grid"):
        StudyPoints([between("p", 0, 1)], None)
    with pytest.raises(ProblemError, match=f"{10**8} points; at most {MOST_POINTS}"):
        StudyPoints([Levels("p", range(10**4)), Levels("q", range(10**4))], None)
    for count in (0, MOST_POINTS + 1):
        with pytest.raises(ProblemError, match=f"latin is {count}; it must be >= 1"):
            Latin(count)
    with pytest.raises(ProblemError, match="seed is -1; it must be >= 0"):
        Latin(1, -1)
