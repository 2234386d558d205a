"""The paper's tables beside ours: what is planned, what the page says, what the command writes."""

import json
from functools import cache

import numpy as np
import pytest
from stored_trajectories import STOP

from tubeplanner import PlanOptions, plan
from tubeplanner.first_guess.baselines import BASELINES, judged_baseline
from tubeplanner.planning.options import SUH_BISHOP
from tubeplanner.studies import reproduction as module
from tubeplanner.studies.reproduction import (
    NO_TUBE,
    TABLE_FOUR,
    TABLE_THREE,
    TABLE_TWO,
    paper_problem,
    reproduce,
    reproduction_page,
)


def reproduced_with(**replaced):
    """Return all cells and what was told of them, functions of the module replaced by others."""
    told = []
    with pytest.MonkeyPatch.context() as patch:
        for name, function in replaced.items():
            patch.setattr(module, name, function)
        result = reproduce(told.append)
    return result, told


@pytest.fixture(scope="module")
def reproduced():
    """All cells, of trajectories that stop at the ends; all paths, switched by bang-bang.

    Each planned once, whatever the method, and however the corners are to be smoothed.
    """

    @cache
    def stopping(problem):
        return plan(problem, PlanOptions(STOP, "fast"), lambda stage: None)

    @cache
    def switched(problem):
        return judged_baseline(problem, "bang-bang")

    def quick(problem, options, progress):
        progress("stands still at the corners")
        return stopping(problem)

    return reproduced_with(
        finished_plan=quick, judged_baseline=lambda problem, name: switched(problem)
    )


@pytest.mark.slow  # plans all paths of the paper
def test_every_printed_cell_is_planned_and_times_of_paths_are_those_of_the_paper(reproduced):
    result, texts = reproduced
    for example, row in TABLE_TWO.items():
        assert all((example, radius) in result.cells for radius in row.phases)
    for table in (TABLE_THREE, TABLE_FOUR):
        assert all((table.example, radius) in result.cells for radius in table.durations)
    assert any(str(what).startswith("example 3, no tube (") for what in texts)
    durations = {k: result.durations(k) for k in result.paths}
    conventional = [durations[k][module.CONVENTIONAL] for k in (1, 2, 5)]
    assert np.round(conventional, 2).tolist() == [1.96, 1.00, 3.74]
    assert durations[1]["bang-bang"] == pytest.approx(TABLE_THREE.bang_bang, abs=0.005)
    assert durations[3]["bang-bang"] == pytest.approx(TABLE_FOUR.bang_bang, abs=0.005)


@pytest.mark.slow  # plans all cells of the paper
def test_the_default_method_beats_the_printed_second_phase_everywhere():
    def quick(problem, options, progress):
        method = STOP if options.method == SUH_BISHOP else options.method
        return plan(problem, PlanOptions(method, "fast"), progress)

    result, _ = reproduced_with(finished_plan=quick)
    for path in result.paths.values():
        assert {*path} == {module.CONVENTIONAL, *BASELINES}
        assert all(not isinstance(one, str) for one in path.values())
    for example, row in TABLE_TWO.items():
        for radius, (_, printed) in row.phases.items():
            assert result.cells[example, radius].default.duration < printed


def test_without_a_tube_the_elbow_is_free():
    problem = paper_problem(3, NO_TUBE)
    assert problem.joint_lower[0, 1] < 0 < problem.joint_upper[0, 1]
    assert paper_problem(3, 0.01).joint_upper[0, 1] == 0
    assert problem.tube.points.tolist() == paper_problem(3, 0.01).tube.points.tolist()


@pytest.mark.slow  # draws the figures of all paths
def test_the_command_writes_the_page_and_its_figures(reproduced, tmp_path, run, monkeypatch):
    result, _ = reproduced
    page = reproduction_page(result, {"Figure 3": "figure_3.png"})
    cell = result.cells[5, 0.01]
    line = next(line for line in page.splitlines() if line.startswith("| 5 | 10 |"))
    ours, ratio = cell.default.duration, cell.default.duration / 1.52
    phases = f"| 1.52 | {cell.published.duration / 1.52:.2f} | {ours:.3f} | {ratio:.2f} |"
    assert line.endswith(phases)
    assert "| - | 1.91 | - |" in line  # what stops at corners has no phase 1
    assert "1.93 s is printed where the formula gives 1.82 s" in page
    assert "![Figure 3](figure_3.png)" in page
    monkeypatch.setattr("tubeplanner.cli.reproduce.reproduce_tables", lambda progress: result)
    code, out, _ = run("reproduce", "-o", tmp_path / "paper", "--json")
    assert code == 0
    written = sorted(path.name for path in (tmp_path / "paper").iterdir())
    assert written == [*(f"figure_{k}.png" for k in (3, 7, 8, 9)), "the_paper.md"]
    assert {cell["radius"] for cell in json.loads(out)["cells"]} >= {None, 0.005, 0.07}


def test_an_interrupted_run_leaves_no_folder(tmp_path, run, monkeypatch):
    def interrupt(progress):
        raise KeyboardInterrupt

    monkeypatch.setattr("tubeplanner.cli.reproduce.reproduce_tables", interrupt)
    code, _, err = run("reproduce", "-o", str(tmp_path / "paper"))
    assert code == 130 and "interrupted before there was an answer" in err
    assert not (tmp_path / "paper").exists()
