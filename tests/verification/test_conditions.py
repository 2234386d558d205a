"""The table of conditions: complete, and the one that the pages show."""

from importlib import import_module
from inspect import getmembers, isfunction
from pathlib import Path
from pkgutil import iter_modules

import pytest

from tubeplanner import Certificate, JudgedCondition, Place, Tolerance
from tubeplanner.verification import judged
from tubeplanner.verification.conditions import CONDITION_NAMES, JUDGED
from tubeplanner.verification.judged_condition import FOR_ALL_TIMES

DOCS = Path(__file__).parents[2] / "docs"


def documented(page):
    """Return the conditions that the table of a page lists."""
    table = (DOCS / page).read_text().split("| condition |")[1].split("\n\n")[0]
    cells = [row.split("|")[1] for row in table.splitlines()[2:]]
    return [name.strip(" `") for cell in cells for name in cell.split(",")]


def test_the_reference_lists_the_conditions_in_order():
    assert tuple(documented("reference/certificate.md")) == CONDITION_NAMES


def test_the_method_of_every_condition_is_explained():
    assert sorted(documented("concepts/certificate.md")) == sorted(CONDITION_NAMES)


def test_every_condition_that_can_be_judged_is():
    found = {
        function
        for module in iter_modules(judged.__path__, f"{judged.__name__}.")
        for name, function in getmembers(import_module(module.name), isfunction)
        if name.startswith("judge_")
    }
    assert found == set(JUDGED.values())
    assert len(found) == len(JUDGED)
    assert all(function.__name__ == f"judge_{name}" for name, function in JUDGED.items())


@pytest.mark.parametrize("name", CONDITION_NAMES)
def test_no_certificate_leaves_a_condition_out(name):
    met = JudgedCondition(0.0, "m", Place(), FOR_ALL_TIMES)
    conditions = {other: met for other in CONDITION_NAMES if other != name}
    with pytest.raises(KeyError, match=name):
        Certificate(conditions, Tolerance())
