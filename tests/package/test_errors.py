"""Exceptions for bad input, one family; wrong values in messages; former names. No NumPy."""

import pickle
import tomllib
import warnings
from pathlib import Path

import pytest

import tubeplanner
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
    assert not_installed("simulate", "simulating", "MuJoCo 3") == (
        "simulating takes MuJoCo 3, which is not installed: "
        f"pip install -e '.[simulate]' in {CHECKOUT}"
    )


def test_elsewhere_the_library_itself_is_installed(monkeypatch, tmp_path):
    monkeypatch.setattr(extras, "__file__", str(tmp_path / "lib" / "tubeplanner" / "extras.py"))
    message = "executing takes MuJoCo 3, which is not installed: pip install 'mujoco>=3.2.7'"
    assert not_installed("simulate", "executing", "MuJoCo 3") == message


@pytest.mark.parametrize("former", tubeplanner._FORMER_NAMES)
def test_a_former_public_name_warns_once(former):
    present = tubeplanner._FORMER_NAMES[former]
    extras._warned.discard(f"tubeplanner.{former}")
    with pytest.warns(DeprecationWarning, match=f"tubeplanner.{former} is called {present} now"):
        assert getattr(tubeplanner, former) is getattr(tubeplanner, present)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert getattr(tubeplanner, former) is getattr(tubeplanner, present)


def former_attributes():
    """The classes with former names of attributes, each with its former and its present name."""
    classes = [getattr(tubeplanner, name) for name in tubeplanner.__all__]
    for owner in {base for each in classes if isinstance(each, type) for base in each.__mro__}:
        for former, value in vars(owner).items():
            if isinstance(value, extras.FormerName):
                yield owner, former, value._name


def test_former_names_of_attributes_have_the_values_of_the_present_ones():
    table = list(former_attributes())
    assert len(table) > 10
    for owner, former, name in table:
        extras._warned.discard(f"{owner.__name__}.{former}")
        fields = getattr(owner, "__dataclass_fields__", {})
        assert name in fields or hasattr(owner, name), (owner, name)
        instance = owner.__new__(owner)
        if name in fields:
            object.__setattr__(instance, name, 5)
            with pytest.warns(DeprecationWarning, match=f"{former} is called {name} now"):
                assert getattr(instance, former) == 5
