"""Numbers as texts show them."""

import pytest

from asked_problems import simple_change
from tubeplanner.explanation.change import exact, figures, from_to, rounded


@pytest.mark.parametrize(
    ("value", "three"),
    [(0.123456, 0.123), (12.3456, 12.3), (0.00099951, 0.001), (1e-9, 1e-9), (0.0, 0.0)],
)
def test_sizes_have_three_figures(value, three):
    assert rounded(value) == three


def test_what_adding_leaves_behind_is_dropped():
    assert 0.1 + 0.2 != 0.3
    assert exact(0.1 + 0.2) == 0.3
    assert exact(-1.294184) == -1.294184


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.148, "m", "148 mm"),
        (-0.0305, "m", "-30.5 mm"),
        (1.0, "m", "1 m"),
        (0.1, "s", "100 ms"),
        (0.0305, "rad", "0.0305 rad"),
        (25.533, "N m", "25.533 N m"),
        (1.5, "", "1.5"),
    ],
)
def test_a_number_has_its_unit(value, unit, text):
    assert figures(value, unit) == text


@pytest.mark.parametrize(
    ("before", "after", "unit", "text"),
    [
        (0.03, 0.042, "m", "30 -> 42 mm"),
        (0.95, 1.05, "m", "0.95 -> 1.05 m"),
        (1.05, -0.95, "m", "1.05 -> -0.95 m"),
        (-1.05, 0.95, "m", "-1.05 -> 0.95 m"),
        (0.1, 0.683, "s", "100 -> 683 ms"),
        (25.0, 25.533, "N m", "25 -> 25.533 N m"),
    ],
)
def test_both_numbers_have_one_unit_and_all_their_figures(before, after, unit, text):
    assert from_to(before, after, unit) == text


def test_a_change_prints_short():
    assert repr(simple_change(most=0.3)) == "<Change of tube.radius, up to 0.3 m>"
