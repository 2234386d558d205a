"""Where values stand on an axis."""

import numpy as np
import pytest

from tubeplanner.views.figure_files import new_figure
from tubeplanner.views.value_scale import ValueScale, value_label


@pytest.mark.parametrize(
    ("values", "places", "is_scaled", "label"),
    [
        ([0.2, 0, 3], [0.2, 0, 3], True, "a.b"),
        (["x0.5", "x2"], [0.5, 2], True, "factor on a.b [-]"),
        ([1, "x2"], [0, 1], False, "a.b"),
        ([[1], [2], [1]], [0, 1, 0], False, "a.b"),
        ([True, False], [0, 1], False, "a.b"),
        ([1.0, float("inf")], [0, 1], False, "a.b"),
        ([], [], False, "a.b"),
    ],
)
def test_numbers_and_factors_are_to_scale_others_in_a_row(values, places, is_scaled, label):
    scale = ValueScale.of("a.b", values)
    np.testing.assert_array_equal(scale.places, places)
    assert (scale.is_scaled, scale.label) == (is_scaled, label)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1, 10, 100], True),
        ([0.01, 0.02, 0.05, 0.1, 0.2], True),
        (["x0.1", "x1", "x10"], True),
        ([0.1, 1, 2], False),
        ([1, 2, 4], False),
        ([0, 10, 100], False),
        ([1, 100], False),
        (["a", "b", "c"], False),
    ],
)
def test_values_that_are_even_by_ratio_are_on_a_logarithmic_axis(values, expected):
    scale = ValueScale.of("a.b", values)
    assert scale.is_logarithmic is expected
    axis = new_figure(4, 3).add_subplot()
    scale.draw(axis, "y")
    assert axis.get_yscale() == ("log" if expected else "linear")
    assert axis.get_ylabel() == scale.label


def test_values_in_a_row_have_labels():
    axis = new_figure(4, 3).add_subplot()
    ValueScale.of("problem", ["example:ur5/a", "example:ur5/b", "example:ur5/a"]).draw(axis)
    assert [label.get_text() for label in axis.get_xticklabels()] == ["ur5/a", "ur5/b"]
    assert axis.get_xlim() == (-0.5, 1.5)


def test_long_labels_keep_their_end():
    assert (
        value_label("folder/of/folders/problem.yaml")
        == "..." + "folder/of/folders/problem.yaml"[-21:]
    )
    assert value_label([0.6, 0]) == "[0.6, 0]"
