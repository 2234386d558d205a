"""Checks of user input: numbers within bounds, options, rows, paths, executors."""

import numpy as np
import pytest

from tubeplanner import (
    MeasureOptions,
    OptionError,
    PlanOptions,
    RouteOptions,
    TeachOptions,
    Tolerance,
)
from tubeplanner.checks import are_numbers, checked_options, checked_row, in_figures
from tubeplanner.first_guess.knot_modification import ModificationOptions
from tubeplanner.first_guess.suh_bishop import SuhBishopOptions


# Options of a wrong kind are named like those out of range.
@pytest.mark.parametrize(
    ("options", "wrong", "message"),
    [
        (PlanOptions, {"method": 3}, "unknown method 3; there is: refinement"),
        (PlanOptions, {"quality": ["fast"]}, r"unknown quality \['fast'\] .*; there is: fast"),
        (PlanOptions, {"time_limit": "a"}, "time_limit is 'a'; it must be a number > 0"),
        (PlanOptions, {"time_limit": np.nan}, "time_limit is nan s; it must be > 0"),
        (PlanOptions, {"node_budget": 10.5}, "node_budget is 10.5; it must be a whole number >= 1"),
        (PlanOptions, {"candidate_points": None}, "candidate_points is None; .* >= 2 and <= 1000"),
        (PlanOptions, {"suh_bishop": 3}, "suh_bishop is 3; it must be SuhBishopOptions"),
        (MeasureOptions, {"max_radius": "wide"}, "max_radius is 'wide'; it must be a number > 0"),
        (RouteOptions, {"edges": "3"}, "edges is '3'; it must be a whole number >= 1"),
        (RouteOptions, {"band": 1j}, "band is 1j; it must be a number > 0 and finite"),
        (TeachOptions, {"deviation": None}, "deviation is None; it must be a number > 0"),
        (TeachOptions, {"samples": 0}, "samples is 0; it must be >= 1"),
        (TeachOptions, {"seed": -1}, "seed is -1; it must be >= 0"),
        (SuhBishopOptions, {"doubled": "all"}, "doubled is 'all'; it must be a whole number >= 1"),
        (SuhBishopOptions, {"modification": {}}, "modification is {}; it must be ModificationOpt"),
        (ModificationOptions, {"growth": "2"}, "growth is '2'; it must be a number > 1 and finite"),
        (Tolerance, {"absolute": "1 mm"}, r"tolerance: absolute is '1 mm', not in \[0, 1\)"),
    ],
)
def test_an_option_of_the_wrong_kind_is_named(options, wrong, message):
    with pytest.raises(OptionError, match=message):
        options(**wrong)


def test_numbers_of_numpy_are_numbers_finite_or_not_without_a_warning():
    options = PlanOptions(node_budget=np.int64(5), time_limit=np.float32(2.0))
    assert (options.node_budget, options.time_limit) == (5, 2.0)
    assert PlanOptions(time_limit=np.inf).time_limit == np.inf
    assert are_numbers([np.float32(0.5), 1, 2.0], 3)
    for value in (np.float32("inf"), np.float32("nan"), np.inf, 10**400):
        assert not are_numbers([value], 1)
    assert in_figures(np.float32(0.25)) == "0.25"
    assert in_figures(10**400).startswith("1000")


# Arguments of public functions: what they may be, and what is said of others.
def test_options_are_those_of_the_class_unless_others_are_given():
    options = PlanOptions("suh-bishop")
    assert checked_options(options, PlanOptions) is options
    assert checked_options(None, PlanOptions) == PlanOptions()
    with pytest.raises(OptionError, match=r"^options are {}; give PlanOptions$"):
        checked_options({}, PlanOptions)


@pytest.mark.parametrize("row", [[1, 2], (1, 2), range(1, 3), np.array([1, 2])])
def test_a_row_is_a_list_a_tuple_or_an_array(row):
    assert checked_row("radii", row, "numbers") == [1, 2]


@pytest.mark.parametrize("other", ["12", {1: 2}, {1, 2}, 1.0, None, np.array(1.0), iter([1])])
def test_anything_else_is_no_row(other):
    with pytest.raises(OptionError, match=r"^radii is .*; give a list of numbers$"):
        checked_row("radii", other, "numbers")
