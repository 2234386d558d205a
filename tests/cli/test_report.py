"""Plans and certificates of problems and cycles as terminal text."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from rich.console import Console
from small_cycle import small_cycle

from tubeplanner import compare
from tubeplanner.cli import compare as comparison_report
from tubeplanner.cli import report
from tubeplanner.cli.report import plan_text
from tubeplanner.geometry.collision_checker import LeftOutPair
from tubeplanner.planning.result import CycleSensitivity

METHODS = ("stop-at-corners", "conventional", "smoothed-arc-corners")
MEASURES = ["planned in", "smooth", "peak jerk", "at a limit", "tube used"]


@pytest.fixture(scope="module")
def compared(bundled, shared):
    problem = bundled("two_link/paper_1_30mm")
    return shared("comparison.of_corners", lambda: compare(problem, METHODS))


@pytest.fixture
def text_at(monkeypatch):
    def of(width, result):
        for module in (report, comparison_report):
            monkeypatch.setattr(module, "terminal", lambda: Console(width=width))
        return comparison_report.comparison_text(result)

    return of


@pytest.mark.parametrize(("width", "shown"), [(160, 5), (98, 3), (60, 0)])
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
    words = ("plan", "example:two_link/around_a_post", "--method", "stop-at-corners")
    status, out, _ = run(*words, "--set", "tube.points.1=[2.45, 0.3, 0]")
    assert status == 1
    assert "`tubeplanner explain` looks for the smallest changes" in out
    assert "explain" not in run(*words)[1]


def test_the_note_on_pairs_says_in_how_many_configurations_they_touch():
    pairs = LeftOutPair(("a", "b"), "always touching"), LeftOutPair(("b", "c"), "neighbours")
    (note,) = report.left_out_lines(SimpleNamespace(left_out=pairs))
    assert note == (
        "note: not checked, because they touch in all of 400 sampled configurations: a and b"
    )


def text_of(result):
    return plan_text(small_cycle(), result, 0.5)


def test_moves_and_rests_follow_each_other_without_a_gap(small_plan):
    lines = (line.split("│") for line in text_of(small_plan).splitlines())
    rows = [cells[1:5] for cells in lines if len(cells) == 6]
    begins = [float(cells[0].split()[0]) for cells in rows]
    takes = [float(cells[1].split()[0]) for cells in rows]
    assert len(rows) == 7
    assert [b + t for b, t in zip(begins, takes, strict=True)] == pytest.approx(
        [*begins[1:], small_plan.duration], abs=2e-4
    )


def test_what_configurations_in_common_save_is_told_where_it_is_something(small_plan):
    shortest = small_plan.shortest_duration
    gained = replace(small_plan, greedy_duration=shortest + 0.05)
    assert "configurations chosen over the whole cycle save 0.0500 s: " in text_of(gained)
    assert "over the whole cycle" not in text_of(replace(small_plan, greedy_duration=shortest))


def test_the_dearest_limits_of_the_whole_and_an_early_stop_are_told(small_plan):
    """Limits that cost nothing are not."""
    assert "stopped by" not in text_of(small_plan)
    assert "\nnothing is faster than 0.2100 s: its moves and rests, one" in text_of(small_plan)
    dear = CycleSensitivity("velocity", "joint1", None, None, 0.031)
    free = CycleSensitivity("radius", None, "beside", 0, 0.0)
    text = text_of(replace(small_plan, sensitivities=(dear, free), stopped_by="time_limit"))
    assert "raising a limit by 10 % would save, over the cycle: velocity of joint1: 31 ms\n" in text
    assert "stopped by time limit" in text


def test_a_cost_of_joined_segments_names_all_of_them():
    joined = CycleSensitivity("radius", None, "bead", 131, 0.21, 151)
    assert str(joined) == "radius of segments 131 to 151 of move 'bead': 210 ms"
    assert str(replace(joined, saved=0.0037, last_segment=131)).endswith("'bead': 3.7 ms")


def test_conditions_and_prices_are_told_where_they_are_tightest(small_plan):
    lines = text_of(small_plan).splitlines()
    moves = small_plan.certificate.moves.values()
    margin = min(each.conditions["tube"].margin for each in moves)
    assert f"{margin:.3g} m" in next(line for line in lines if line.startswith("│ tube"))
    largest_saving = max(small_plan.legs[0].result.sensitivities, key=lambda each: each.saved)
    assert str(largest_saving) in next(line for line in lines if " over " in line)
