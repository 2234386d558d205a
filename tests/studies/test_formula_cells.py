"""No cell of a table is run by a spreadsheet, and none that is a number or text is changed."""

import pytest

from tubeplanner.studies.formula_cells import without_formulas


@pytest.mark.parametrize("cell", ["=1+1", "+1+1", "-1+1", "@SUM(A1)", " =1", "-", "-x"])
def test_a_formula_becomes_text(cell):
    assert without_formulas(f"a,{cell},1\n") == f"a,'{cell},1\n"


@pytest.mark.parametrize(
    "line", ["-1,+2.5,-1e-3,-inf", "a=b,[-1],x-1,", '"a, b","c ""d""",,', '"two\nlines",1', ""]
)
def test_all_else_stays(line):
    assert without_formulas(line + "\n") == line + "\n"
