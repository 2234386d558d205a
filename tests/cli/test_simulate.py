"""`simulate`: runs by plants, report."""

import json
import shutil

import pytest
from simulated_cycle import DURATION, DWELL, SEAMS, motion_of, slide
from stored_trajectories import REFINEMENT, stored_path

from tubeplanner import OutputError
from tubeplanner.output.files.trajectory_writer import write_cycle_motion
from tubeplanner.task.cycle_file import load_cycle

NAME = "two_link/around_a_post"
EXACT = ("mass", "com", "payload", "unmodelled-friction", "lag", "delay", "noise", "tool")
CASE = (f"example:{NAME}", str(stored_path(NAME, REFINEMENT)))
CYCLE = """
format: tubeplanner/cycle
robot: {urdf: slide.urdf, tool_frame: tip}
start: {joints: [0, 0, 0]}
closed: true
moves:
  - {name: reach, tube: {points: [FIRST, SECOND], radius: 0.2}, goal: {joints: [0.4, 0.1, 0.0]}}
  - {event: close, dwell: 0.1}
  - {attach: part, payload: {mass: 2.0, com: [0.3, 0, 0]}}
  - {event: settle, dwell: 0.1}
  - {name: carry, tube: {points: [SECOND, THIRD], radius: 0.2}, goal: {joints: [-0.3, 0.2, 0.1]}}
  - {event: open, dwell: 0.1}
  - {detach: part}
  - {name: back, tube: {points: [THIRD, FIRST], radius: 0.2}, goal: {joints: [0.0, 0.0, 0.0]}}
"""


@pytest.mark.dear("simulates, and makes a figure and a page")
def test_what_was_seen_is_printed_and_files_are_written_and_named(run, tmp_path):
    figure, page = tmp_path / "runs.png", tmp_path / "runs.html"
    status, text, _ = run("simulate", *CASE, "--runs", "2", "--plot", figure, "--html", page)
    assert status == 0
    assert "seen in 2 runs" in text
    assert "beyond the tube [m]" in text and "left the tube" in text
    assert text.endswith(f"plot: {figure}\nview: {page}\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "Executed paths of the tool: 2 runs" in page.read_text()


@pytest.mark.dear("simulates twice")
def test_the_same_as_json_and_of_other_runs_by_another_seed(run_json):
    words = ("simulate", *CASE, "--runs", "2", "--seed")
    _, report = run_json(*words, "4")
    assert report["seen"] != run_json(*words, "5")[1]["seen"]
    assert (report["status"], report["verdict"]["runs"]) == ("success", 2)
    assert report["seen"]["tube"]["worst"]["value"] == max(report["excursions"])
    assert report["seen"]["rotation"] is None
    assert report["verdict"]["broken"]["tube"] == sum(value > 0 for value in report["excursions"])
    assert (report["plot"], report["html"]) == (None, None)


@pytest.mark.dear("simulates twice")
def test_errors_are_those_that_are_given(run, run_json):
    words = [word for name in EXACT for word in (f"--{name}", "0")]
    _, text, _ = run("simulate", *CASE, "--runs", "1", *words, "--base", "0")
    assert "survived 1 of 1 simulated arms" in text
    assert text.endswith("nothing written; to keep the answer, give --plot or --html\n")
    _, report = run_json("simulate", *CASE, "--runs", "2", "--base", "0.02", *words)
    assert report["seen"]["tracking"]["worst"]["value"] < 1e-3
    assert 0.005 < report["seen"]["tool_tracking"]["worst"]["value"] < 0.021


def test_inputs_are_not_overwritten(run, tmp_path):
    trajectory = shutil.copy(CASE[1], tmp_path / "motion.png")
    status, _, error = run("simulate", CASE[0], trajectory, "--plot", trajectory)
    assert (status, "is the same file as" in error) == (2, True)


def test_a_page_that_fails_costs_neither_the_figure_nor_the_answer(run, tmp_path, monkeypatch):
    def failing(*_, **__):
        raise OutputError("no page today")

    monkeypatch.setattr("tubeplanner.cli.simulate.view_motions", failing)
    plot = tmp_path / "runs.png"
    files = ("--plot", plot, "--html", tmp_path / "runs.html")
    status, text, error = run("simulate", *CASE, "--runs", "1", *files)
    assert (status, "seen in 1 runs" in text, text.endswith(f"plot: {plot}\n")) == (2, True, True)
    assert error == f"tubeplanner: no page today; saved: plot {plot}\n"
    assert list(tmp_path.iterdir()) == [plot]


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A cycle file and a file of its motion."""
    folder = tmp_path_factory.mktemp("picking")
    tools = slide(folder).tool_position(SEAMS[:3]).tolist()
    text = CYCLE
    for name, tool in zip(("FIRST", "SECOND", "THIRD"), tools, strict=True):
        text = text.replace(name, str(tool))
    cycle, trajectory = folder / "cycle.yaml", folder / "motion.json"
    cycle.write_text(text)
    motion = motion_of(load_cycle(cycle))
    write_cycle_motion(trajectory, motion)
    return cycle, trajectory


@pytest.mark.dear("simulates a cycle and makes a page")
def test_the_whole_the_moves_and_what_changes_hands_are_told(run, case, tmp_path):
    """Of a cycle that is changed, so that it fails."""
    figure, page = tmp_path / "runs.png", tmp_path / "runs.html"
    change, files = ("--set", "moves.carry.tube.radius=0.01"), ("--plot", figure, "--html", page)
    status, text, _ = run("simulate", *case, "--runs", "1", *change, *files)
    assert status == 0
    lines = text.splitlines()
    assert any(line.startswith("beyond the tube [m]") and "move '" in line for line in lines)
    for move in ("reach", "carry", "back"):
        assert any(line.startswith(f"{move} ") and "of 1" in line for line in lines)
    assert f"\n{DURATION + DWELL:.4f} s: attach part " in text
    assert any(": detach part " in line for line in lines)
    assert "note: parts rest, and lie in the hand, where the planned motion has them" in text
    assert "survived 0 of 1 simulated arms" in text
    assert "from the plan: 1 left the tube" in text
    assert "the trajectory was made for another cycle" in text
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "Executed paths of the tool: 1 run" in page.read_text()


@pytest.mark.slow  # simulates a cycle
def test_a_cycle_as_json(run_json, case):
    _, report = run_json("simulate", *case, "--runs", "2", "--seed", "4")
    assert (report["status"], report["verdict"]["runs"]) == ("success", 2)
    assert list(report["moves"]) == ["reach", "carry", "back"]
    whole, moves = report["seen"], [each["seen"] for each in report["moves"].values()]
    tubes = [seen["tube"]["worst"]["value"] for seen in moves]
    assert whole["tube"]["worst"]["value"] == max(tubes) == max(report["excursions"])
    assert whole["obstacles"] is None
    attach, detach = report["handovers"]
    assert (attach["attach"], detach["detach"]) == ("part", "part")
    assert 0 < attach["distance"]["median"] <= attach["distance"]["worst"] < 0.05
    assert report["duration"] == pytest.approx(3 * DURATION + 3 * DWELL)


@pytest.mark.dear("simulates a cycle")
def test_errors_are_those_that_are_given_in_a_cycle(run_json, case):
    words = [word for name in (*EXACT, "base") for word in (f"--{name}", "0")]
    words += ["--payload", "0.5", "--controller", "feedforward-pd"]
    _, report = run_json("simulate", *case, "--runs", "1", *words)
    assert report["moves"]["reach"]["seen"]["tracking"]["worst"]["value"] < 1e-5
    assert report["moves"]["carry"]["seen"]["tracking"]["worst"]["value"] > 1e-4


def test_a_trajectory_without_marks_is_none_of_a_cycle(run, case, tmp_path):
    fields = json.loads(case[1].read_text())
    del fields["marks"]
    path = tmp_path / "unmarked.json"
    path.write_text(json.dumps(fields))
    status, _, error = run("simulate", case[0], path)
    assert status == 2
    assert f"{path} has no marks" in error
