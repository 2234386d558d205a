"""`tubeplanner simulate` of whole cycles."""

import json

import pytest

from simulated_cycle import DURATION, DWELL, SEAMS, motion_of, slide
from tubeplanner.cycle.cycle_reader import load_cycle
from tubeplanner.files.cycle_writer import cycle_contents
from tubeplanner.files.trajectory_writer import TrajectoryFiles

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
    contents, _ = cycle_contents(TrajectoryFiles(trajectory), motion, "by hand")
    trajectory.write_bytes(contents[trajectory])
    return cycle, trajectory


def test_the_whole_the_moves_and_what_changes_hands_are_told(run, case):
    status, text, _ = run("simulate", *case, "--runs", "2")
    assert status == 0
    lines = text.splitlines()
    assert "seen in 2 runs" in lines[0]
    assert any(line.startswith("beyond the tube [m]") and "move '" in line for line in lines)
    for move in ("reach", "carry", "back"):
        assert any(line.startswith(f"{move} ") and "of 2" in line for line in lines)
    assert any(line.startswith(f"{DURATION + DWELL:.4f} s: attach part ") for line in lines)
    assert any(": detach part " in line for line in lines)
    assert any(line.startswith("0 of 2 runs failed") for line in lines)
    assert "note: what is taken or let go stands where the planned motion has it" in text
    assert "made for another" not in text


def test_the_same_as_json(run, case):
    report = json.loads(run("simulate", *case, "--runs", "3", "--seed", "4", "--json")[1])
    assert (report["status"], report["verdict"]["runs"]) == ("success", 3)
    assert list(report["moves"]) == ["reach", "carry", "back"]
    whole, moves = report["seen"], [each["seen"] for each in report["moves"].values()]
    tubes = [seen["tube"]["worst"]["value"] for seen in moves]
    assert whole["tube"]["worst"]["value"] == max(tubes) == max(report["excursions"])
    assert whole["obstacles"] is None
    attach, detach = report["handovers"]
    assert (attach["attach"], detach["detach"]) == ("part", "part")
    assert 0 < attach["distance"]["median"] <= attach["distance"]["worst"] < 0.05
    assert report["duration"] == pytest.approx(3 * DURATION + 3 * DWELL)
    again = json.loads(run("simulate", *case, "--runs", "3", "--seed", "5", "--json")[1])
    assert again["seen"] != whole


def test_errors_are_those_that_are_given(run, case):
    names = ["mass", "com", "payload", "unmodelled-friction", "lag", "delay", "noise", "tool"]
    exact = [word for name in [*names, "base"] for word in (f"--{name}", "0")]
    report = json.loads(run("simulate", *case, "--runs", "2", *exact, "--json")[1])
    assert report["seen"]["tracking"]["worst"]["value"] < 1e-4
    heavier = [*exact, "--payload", "0.5", "--controller", "feedforward-pd"]
    report = json.loads(run("simulate", *case, "--runs", "2", *heavier, "--json")[1])
    assert report["moves"]["reach"]["seen"]["tracking"]["worst"]["value"] < 1e-3
    assert report["moves"]["carry"]["seen"]["tracking"]["worst"]["value"] > 1e-3


def test_the_cycle_may_be_changed_and_the_note_says_so(run, case):
    status, text, _ = run("simulate", *case, "--runs", "1", "--set", "moves.carry.tube.radius=0.01")
    assert status == 0
    assert "1 of 1 runs failed: 1 left the tube" in text
    assert "the trajectory was made for another cycle" in text


def test_a_trajectory_without_marks_is_none_of_a_cycle(run, case, tmp_path):
    fields = json.loads(case[1].read_text())
    del fields["marks"]
    path = tmp_path / "unmarked.json"
    path.write_text(json.dumps(fields))
    status, _, error = run("simulate", case[0], path)
    assert status == 2
    assert f"{path} has no marks" in error


def test_figure_and_page_are_written(run, case, tmp_path):
    figure, page = tmp_path / "runs.png", tmp_path / "runs.html"
    status, text, _ = run("simulate", *case, "--runs", "2", "--plot", figure, "--html", page)
    assert status == 0
    assert text.endswith(f"plot: {figure}\nview: {page}\n")
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert "Executed paths of the tool: 2 runs" in page.read_text()
