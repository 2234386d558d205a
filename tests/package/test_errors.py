"""Exceptions for bad input, one family; wrong values in messages; missing libraries. No NumPy."""

import pickle
import tomllib
from pathlib import Path

import pytest

from tubeplanner import errors as extras
from tubeplanner.errors import (
    REQUIREMENTS,
    ProblemError,
    TubePlannerError,
    not_installed,
    on_one_line,
    shown,
)

# Messages of errors: on one line, whatever they name.


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


# What is said where a library is missing: the command fits the installation.


CHECKOUT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("extra", REQUIREMENTS)
def test_requirements_are_those_of_the_extras(extra):
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    assert project["optional-dependencies"][extra] == [REQUIREMENTS[extra]]


def test_a_checkout_stays_one():
    assert not_installed("route", "finding a route", "OMPL 2") == (
        "finding a route takes OMPL 2, which is not installed: "
        f"pip install -e '.[route]' in {CHECKOUT}"
    )


def test_elsewhere_the_library_itself_is_installed(monkeypatch, tmp_path):
    monkeypatch.setattr(extras, "__file__", str(tmp_path / "lib" / "tubeplanner" / "extras.py"))
    message = "executing takes MuJoCo 3, which is not installed: pip install 'mujoco>=3.2.7'"
    assert not_installed("simulate", "executing", "MuJoCo 3") == message
