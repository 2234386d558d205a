"""Names that messages, files and figures can hold, and how values are shown in messages."""

import pytest

from tubeplanner import ProblemError
from tubeplanner.errors import MAX_SHOWN, shown, unknown_name
from tubeplanner.names import MAX_NAME_LENGTH, require_name

HIDDEN = [
    "a\nFAKE: passes",
    "a\x1b[31m",
    "a\x9b31m",
    "a\u202eb",
    "a\u2066b",
    "a\tb",
    "\x7f",
    "a\x00",
]


@pytest.mark.parametrize(
    "name", ["joint1", "Gelenk 1", "関節", "a,b", 'a"b', "x" * MAX_NAME_LENGTH]
)
def test_printable_names_are_taken(name):
    assert require_name("a joint", name, ProblemError) == name


@pytest.mark.parametrize("name", HIDDEN)
def test_a_name_with_a_hidden_character_is_refused_and_shown_harmless(name):
    with pytest.raises(ProblemError, match="which cannot be shown; rename it") as caught:
        require_name("a joint", name, ProblemError)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("name", [5, None, "", b"a", ["a"]])
def test_a_name_is_text(name):
    with pytest.raises(ProblemError, match=r"a joint is .*; a name must be text that is not empty"):
        require_name("a joint", name, ProblemError)


def test_a_long_name_is_refused_in_a_short_message():
    with pytest.raises(ProblemError, match="1000000 characters long; shorten it") as caught:
        require_name("a joint", "x" * 10**6, ProblemError)
    assert len(str(caught.value)) < 200


LONG = {
    "text": "x" * 10**6,
    "digits that Python does not write": 10**5000,
    "digits": 10**300,
    "a list": [1.0] * 10**6,
    "a map": {1: "y" * 999},
}


@pytest.mark.parametrize("value", LONG.values(), ids=LONG)
def test_long_values_are_shown_short(value):
    assert len(shown(value)) <= MAX_SHOWN + 3
    assert len(unknown_name("key", value, ["a", "b"])) < 150


def test_short_values_are_shown_as_they_are():
    assert shown("a") == "'a'"
    assert shown([1, 2]) == "[1, 2]"
    assert shown("a\u202e") == "'a\\u202e'"
