"""Messages of errors: on one line, whatever they name."""

import pickle

import pytest

from tubeplanner.errors import ProblemError, TubePlannerError, on_one_line, shown


@pytest.mark.parametrize("kind", [TubePlannerError, *TubePlannerError.__subclasses__()])
def test_a_message_is_on_one_line_and_printable_whatever_path_it_names(kind):
    error = kind("file a\nb\x1b[31m\u202e.yaml does not exist: ü")
    assert str(error) == r"file a\nb\x1b[31m\u202e.yaml does not exist: ü"
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (kind, str(error))


def test_what_is_printable_stays_as_it_is():
    text = "a 'b' \\ \u00e4\u95a2"
    assert on_one_line(text) is text
    assert shown("\n" + "x" * 100) == "'\\n" + "x" * 57 + "..."


def test_an_error_within_another_is_escaped_once():
    assert str(ProblemError(f"problem.yaml: {ProblemError(chr(27))}")) == r"problem.yaml: \x1b"
