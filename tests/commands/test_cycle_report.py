"""Plans of cycles as text."""

from dataclasses import replace

import pytest

from small_cycle import planned_cycle, small_cycle
from tubeplanner.commands.cycle_report import cycle_plan_text
from tubeplanner.cycle_planning.cycle_result import CycleSensitivity


@pytest.fixture(scope="module")
def result():
    return planned_cycle()


def text_of(result):
    return cycle_plan_text(small_cycle(), result, 0.5)


def test_moves_and_rests_follow_each_other_without_a_gap(result):
    lines = (line.split("│") for line in text_of(result).splitlines())
    rows = [cells[1:5] for cells in lines if len(cells) == 6]
    begins = [float(cells[0].split()[0]) for cells in rows]
    takes = [float(cells[1].split()[0]) for cells in rows]
    assert len(rows) == 7
    assert [b + t for b, t in zip(begins, takes, strict=True)] == pytest.approx(
        [*begins[1:], result.duration], abs=2e-4
    )


def test_what_configurations_in_common_save_is_told_where_it_is_something(result):
    shortest = result.shortest_duration
    gained = replace(result, greedy_duration=shortest + 0.05)
    assert "configurations between moves chosen together save 0.0500 s: " in text_of(gained)
    assert "chosen together" not in text_of(replace(result, greedy_duration=shortest))


def test_the_dearest_limits_of_the_whole_are_told_without_those_that_cost_nothing(result):
    prices = (
        CycleSensitivity("velocity", "joint1", None, None, 0.031),
        CycleSensitivity("radius", None, "beside", 0, 0.0),
    )
    text = text_of(replace(result, sensitivities=prices))
    assert "10 % more would save, over the cycle: velocity of joint1: 31 ms\n" in text


def test_an_early_stop_is_told(result):
    assert "stopped by time limit" in text_of(replace(result, stopped_by="time_limit"))
    assert "stopped by" not in text_of(result)


def test_conditions_are_told_where_they_are_tightest(result):
    margins = {
        name: each.conditions["tube"].margin for name, each in result.certificate.moves.items()
    }
    row = next(line for line in text_of(result).splitlines() if line.startswith("│ tube"))
    assert f"{min(margins.values()):.3g} m" in row


def test_a_move_is_told_the_limit_that_it_pays_most_for(result):
    row = next(line for line in text_of(result).splitlines() if " over " in line)
    dearest = max(result.legs[0].result.sensitivities, key=lambda each: each.saved)
    assert str(dearest) in row
