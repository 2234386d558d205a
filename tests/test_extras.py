"""What is said where a library is missing: the command fits the installation."""

import tomllib
from pathlib import Path

import pytest

from tubeplanner import extras
from tubeplanner.extras import REQUIREMENTS, not_installed

CHECKOUT = Path(__file__).resolve().parents[1]


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
