"""Tables as wide as the terminal."""

import pytest
from rich.console import Console

from tubeplanner import compare, load_problem
from tubeplanner.commands import report

METHODS = ("stop-at-corners", "conventional", "smoothed-arc-corners")


@pytest.fixture(scope="module")
def compared():
    return compare(load_problem("example:two_link/paper_1_30mm"), METHODS)


@pytest.mark.parametrize(
    ("width", "shown"), [(160, 4), (110, 3), (100, 2), (86, 1), (72, 0), (40, 0)]
)
def test_a_narrow_terminal_has_whole_names_and_fewer_measures(width, shown, compared, monkeypatch):
    monkeypatch.setattr(report, "_console", lambda: Console(width=width))
    text = report.comparison_text(compared)
    table = text.split("└")[0]
    measures = ["smooth", "peak jerk", "at a limit", "tube used"]
    assert all((f" {heading} " in table) == (k < shown) for k, heading in enumerate(measures))
    note = f"left out, the terminal being narrow: {', '.join(measures[shown:])}; -o TABLE.csv"
    assert (note in text) == (shown < 4)
    if width >= 72:
        assert all(f" {method} " in table for method in METHODS)
        assert "…" not in table
