"""Values of fields as tables have them."""

import pytest

from tubeplanner.studies.json_values import value_text


@pytest.mark.parametrize(
    ("value", "text"),
    [(2, "2"), ("x2", "x2"), (None, "null"), ([1, "a"], '[1, "a"]'), (float("-inf"), "-.inf")],
)
def test_values_are_written_as_a_table_has_them(value, text):
    assert value_text(value) == text
