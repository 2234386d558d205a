"""Values as a command takes them: read again they are the same."""

import shlex

import pytest
import yaml

from tubeplanner.explanation.setting_text import setting_text, tried_text

INFINITE = float("inf")


@pytest.mark.parametrize(
    "value", [0.05, [1.0, -0.5], {"a": [INFINITE, -INFINITE]}, "it's", True, None, 1e-7]
)
def test_a_value_is_read_again(value):
    option, pair = shlex.split(setting_text({"a.b": value}))
    path, text = pair.split("=", 1)
    assert (option, path) == ("--set", "a.b")
    read = yaml.safe_load(text)
    assert float(read) == value if isinstance(value, float) else read == value


def test_what_was_not_narrowed_says_so():
    assert tried_text("", True) == ""
    assert tried_text("3 mm", True) == "3 mm"
    assert tried_text("", False) == "(not narrowed)"
    assert tried_text("3 mm", False) == "3 mm (not narrowed)"
