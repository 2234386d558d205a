"""Tables as wide as the terminal."""

from dataclasses import replace

import pytest
from rich.console import Console

from tubeplanner import compare, load_problem
from tubeplanner.commands import comparison_report, report

METHODS = ("stop-at-corners", "conventional", "smoothed-arc-corners")


@pytest.fixture(scope="module")
def compared():
    return compare(load_problem("example:two_link/paper_1_30mm"), METHODS)


MEASURES = ["planned in", "smooth", "peak jerk", "at a limit", "tube used"]


@pytest.fixture
def text_at(monkeypatch):
    def of(width, result):
        for module in (report, comparison_report):
            monkeypatch.setattr(module, "terminal", lambda: Console(width=width))
        return comparison_report.comparison_text(result)

    return of


@pytest.mark.parametrize(
    ("width", "shown"), [(160, 5), (110, 4), (98, 3), (85, 2), (72, 1), (60, 0)]
)
def test_a_narrow_terminal_has_whole_names_and_fewer_measures(width, shown, compared, text_at):
    text = text_at(width, compared)
    table = text.split("└")[0]
    assert all((f" {heading} " in table) == (k < shown) for k, heading in enumerate(MEASURES))
    note = f"left out, the terminal being narrow: {', '.join(MEASURES[shown:])}; -o TABLE.csv"
    assert (note in " ".join(text.split())) == (shown < 5)
    assert all(f" {method} " in table for method in METHODS)
    assert "…" not in table
    assert max(map(len, text.splitlines())) <= width


def test_eighty_columns_hold_long_names_and_break_no_number(compared, text_at):
    long = "bounded-deviation-with-arcs-at-corners"
    failing = next(row for row in compared.rows if row.failures)
    rows = (replace(failing, method=long, message=f"{'slowed by 12.5 %, ' * 9}end"), *compared.rows)
    text = text_at(80, replace(compared, rows=rows))
    assert f" {long} " in text.split("└")[0]
    assert max(map(len, text.splitlines())) <= 80
    cells = [line.split("│")[3].strip() for line in text.splitlines() if line.startswith("│")]
    for name in failing.failures:
        (line, *_) = [cell for cell in cells if f"{name} " in cell]
        assert line.rstrip(",").endswith(" %")
    assert "e+0" not in text.split("└")[0]


def test_a_refusal_points_to_explain(run):
    far = ("--set", "tube.points.2=[2.45,0.3,0.5]")
    status, out, _ = run("plan", "example:ur5/over_the_wall", *far)
    assert status == 1
    assert "`tubeplanner explain` looks for the smallest changes" in out
    assert "explain" not in run("plan", "example:two_link/around_a_post", "--quality", "fast")[1]
