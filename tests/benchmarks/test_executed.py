"""The benchmark of executed plans: what is sought, and what counts as a goal missed."""

import json
from dataclasses import replace

import pytest
from stored_trajectories import REFINEMENT

import executed
from executed import MOST, Arms, least_factor
from tubeplanner import Robustness
from tubeplanner.execution.error_contributions import simulated_runs
from tubeplanner.execution.plants import Draw

ARMS = Arms(search=(4, 50), found=(200,))
KEPT = executed.Executed(1.0, True, 200, 0, {}, -0.001, None, None)
LOST = replace(KEPT, failed=200, broken={"tube": 200}, tube=0.5)
ROBUST = replace(KEPT, duration=1.02)
ROW = executed.Row("arm/problem", LOST, LOST, ROBUST, 9.0, 9.0, None, None, None)
SLOWED = replace(ROW, factor=1.1, slowed=replace(KEPT, duration=1.1))


@pytest.mark.parametrize(
    ("fails", "least"),
    [
        (lambda factor, count: factor < 1.0, 1.0),
        (lambda factor, count: factor < 1.013, 1.013),
        (lambda factor, count: factor < 2.9, 2.9),
        # Surviving may end as the motion gets slower, more arms ask for more.
        (lambda factor, count: not 1.15 < factor < 1.3, 1.15),
        (lambda factor, count: factor < (1.5 if count == 200 else 1.2), 1.5),
    ],
)
def test_the_least_factor_is_found_to_half_a_percent(fails, least):
    assert least <= least_factor(fails, ARMS) <= 1.005 * least


def test_slowing_may_not_help():
    assert least_factor(lambda factor, count: count == 200, ARMS) is None
    assert least_factor(lambda factor, count: factor <= MOST, ARMS) is None


@pytest.mark.parametrize(
    ("row", "said"),
    [
        (ROW, []),
        (SLOWED, []),
        (replace(ROW, robust=replace(ROW.robust, failed=1)), []),
        (replace(ROW, robust=replace(ROW.robust, failed=2)), ["2 of 200 runs"]),
        (replace(ROW, robust=replace(ROW.robust, certified=False)), ["is not certified"]),
        (replace(ROW, robust=replace(ROW.robust, duration=1.09)), ["surviving costs 9.00 %"]),
        (replace(ROW, default=KEPT), ["the default plan survives; the robust one is 2.00 %"]),
        (replace(SLOWED, slowed=replace(KEPT, duration=1.01)), ["run slower takes 0.98 % less"]),
    ],
)
def test_goals_that_are_missed_are_said(row, said):
    faults = executed._faults(row)
    assert len(faults) == len(said)
    assert all(words in fault for words, fault in zip(said, faults, strict=True))


@pytest.fixture(scope="module")
def tray(stored):
    """A motion of a levelled tray, and two runs that follow it."""
    problem, motion = stored("ur5/level_tray", REFINEMENT)
    return problem, motion, simulated_runs(problem.joined, motion, Robustness(), Draw(2))


@pytest.mark.dear("two runs of a UR5 are simulated")
@pytest.mark.parametrize(("factor", "certified"), [(1.0, True), (0.9, False)])
def test_a_motion_is_executed_and_certified(factor, certified, tray):
    problem, motion, runs = tray
    judged = executed.judged(problem, motion.scaled(factor), runs)
    assert judged.certified is certified
    assert ("!" in str(judged)) is not certified
    assert judged.failed == sum(not run.survives for run in runs)
    assert judged.tube == max(run.tube.value for run in runs)
    assert judged.rotation == max(run.rotation.value for run in runs)
    assert judged.obstacles == problem.clearance - min(run.obstacles.value for run in runs)


def test_what_is_not_asked_is_not_shown():
    assert str(KEPT).count(" -") == 3


def test_problems_with_a_tube_are_run_those_that_tell_most_first():
    names = executed._names("")
    assert names[: len(executed.FIRST)] == list(executed.FIRST)
    assert len(names) == len(set(names))
    assert "panda/between_shelves" in names
    assert "panda/shelf_to_shelf" not in names


# It plans one problem with both options and simulates: 15 s.
@pytest.mark.slow
def test_a_problem_is_planned_and_executed(tmp_path, monkeypatch, capsys):
    output = tmp_path / "lines.jsonl"
    asked = ["--only", "paper_1_50mm", "--runs", "4", "--output", str(output)]
    monkeypatch.setattr("sys.argv", ["executed.py", *asked])
    assert executed.main() == 0
    assert "1 of 1 robust plans have no failed run of 4" in capsys.readouterr().out
    (line,) = map(json.loads, output.read_text().splitlines())
    assert line["default"]["failed"] > 0 == line["robust"]["failed"]
    assert 0 < line["cost"] < executed.MAX_COST
