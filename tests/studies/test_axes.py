"""Values between two others: evenly spaced by difference or ratio, as short as can be."""

import pytest

from tubeplanner.errors import ProblemError
from tubeplanner.studies.axes import Levels, interval


@pytest.mark.parametrize(
    ("ends", "log", "values"),
    [
        ((0, 5), False, (0, 1, 2, 3, 4, 5)),
        ((0.01, 0.02), False, (0.01, 0.012, 0.014, 0.016, 0.018, 0.02)),
        ((5, 0), False, (5, 4, 3, 2, 1, 0)),
        ((1, 32), True, (1, 2, 4, 8, 16, 32)),
        (("x0.5", "x1"), False, ("x0.5", "x0.6", "x0.7", "x0.8", "x0.9", "x1")),
        (("x1", "x32"), True, ("x1", "x2", "x4", "x8", "x16", "x32")),
    ],
)
def test_values_between_two_include_both(ends, log, values):
    axis = interval("tube.radius", *ends, is_logarithmic=log)
    levels = axis.levels(6)
    assert (levels.path, tuple(levels.values)) == ("tube.radius", values)
    assert levels.values[1:3] == list(values[1:3])
    assert tuple(axis.ends) == tuple(levels.ends) == (values[0], values[-1])
    assert list(map(type, axis.levels(6).values)) == list(map(type, values))


def test_any_value_between_two_goes_by_its_share_of_the_way():
    assert interval("a", 2, 4, is_logarithmic=False).at(0.25) == 2.5
    assert interval("a", 1, 10_000, is_logarithmic=True).at(0.25) == 10
    assert interval("a", "x1", "x2", is_logarithmic=False).at(0.123456789) == "x1.123456789"


def test_a_share_of_given_values_is_one_of_them():
    levels = Levels("a", ("p", "q", "r"))
    assert [levels.at(share) for share in (0, 0.33, 0.34, 0.99)] == ["p", "p", "q", "r"]


def test_millions_of_values_are_made_one_by_one():
    levels = interval("a", 0, 1, is_logarithmic=False).levels(10**7 + 1)
    assert len(levels.values) == 10**7 + 1
    assert (levels.values[10**6], levels.at(0.9999999)) == (0.1, 0.9999999)
    with pytest.raises(IndexError):
        levels.values[10**7 + 1]


def test_one_value_without_parts_shows_whether_others_can_be_set():
    given = (1, 2, "x0.5", "p", "x2", [1], None, [1], {"a": 1})
    assert Levels("a", given).ends == (1, "x0.5", [1], [1], {"a": 1})


@pytest.mark.parametrize(
    ("ends", "log", "message"),
    [
        ((0, "x2"), False, "from is 0 and to is 'x2'; give two numbers or two factors"),
        ((0, 2), True, "from is 0 and to is 2; with spacing log both must be > 0"),
        ((2, -1), True, "from is 2 and to is -1; with spacing log both must be > 0"),
        (("x2", "x2.0"), False, "from and to are both 'x2'; give a list of one value"),
    ],
)
def test_what_has_nothing_between_is_refused(ends, log, message):
    with pytest.raises(ProblemError) as caught:
        interval("a", *ends, is_logarithmic=log)
    assert str(caught.value) == message
