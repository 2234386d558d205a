"""`tubeplanner check` of the motions of whole cycles."""

import json

import pytest

from small_cycle import SMALL, planned_cycle
from tubeplanner.files.cycle_writer import cycle_contents
from tubeplanner.files.trajectory_writer import TrajectoryFiles

NARROW = ("--set", "moves.beside.tube.radius=0.01")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a cycle and the files of its motion."""
    folder = tmp_path_factory.mktemp("cycle")
    (folder / "small.yaml").write_text(SMALL)
    files = TrajectoryFiles(folder / "t.json", folder / "t.csv", folder / "t.yaml", rate=200)
    contents, _ = cycle_contents(files, planned_cycle().motion, "refinement")
    for path, data in contents.items():
        path.write_bytes(data)
    return folder


def test_every_move_has_its_verdict_and_what_fails_its_rows(run, folder):
    status, text, _ = run("check", folder / "small.yaml", folder / "t.json", *NARROW)
    assert status == 1
    verdicts = {
        cells[3].strip(): cells[4].strip()
        for cells in (line.split("│") for line in text.splitlines())
        if len(cells) == 6
    }
    assert (verdicts["over"], verdicts["back"]) == ("passes", "passes")
    assert verdicts["down"].startswith("FAILS: tube")
    assert verdicts["beside"] == "with down"
    assert "what differs: tube of move 'down, beside'" in text
    last = text.splitlines()[-1]
    assert "fails: down: tube: margin -0.0" in last
    assert last.count("tube: margin") == 1
    assert "move 'beside', segment 0" in last


def test_the_object_has_the_first_failure_and_the_whole_certificate(run, folder):
    status, text, _ = run("check", folder / "small.yaml", folder / "t.json", *NARROW, "--json")
    answer = json.loads(text)
    assert (status, answer["status"]) == (1, "certificate_failed")
    assert (answer["where"]["move"], answer["where"]["segment"]) == ("beside", 0)
    assert list(answer["certificate"]["moves"]) == ["over", "down", "beside", "back"]
    assert not answer["certificate"]["moves"]["beside"]["passed"]
    assert answer["certificate"]["seams"]["closed"]["continuity"]["satisfied"]
    assert [move["name"] for move in answer["moves"]] == ["over", "down", "beside", "back"]
    assert answer["duration"] == planned_cycle().duration
    assert answer["certificate_time"] > 0


@pytest.mark.parametrize("name", ["t.csv", "t.yaml"])
def test_a_file_without_marks_cannot_be_judged_and_the_remedy_is_named(run, folder, name):
    status, _, said = run("check", folder / "small.yaml", folder / name)
    assert status == 2
    assert f"{name} has no marks, which say when the moves of a cycle begin" in said
    assert "give the JSON that plan -o writes" in said


def test_marks_of_other_steps_are_refused_with_the_file(run, folder):
    other = ("--set", "moves.back.name=home")
    status, _, said = run("check", folder / "small.yaml", folder / "t.json", *other)
    assert status == 2
    assert "t.json: marks are move over, " in said
    assert "move home" in said


def test_a_tolerance_is_taken(run, folder):
    words = ("check", folder / "small.yaml", folder / "t.json", *NARROW)
    assert run(*words, "--tolerance", "0.5")[0] == 0


def test_what_a_controller_makes_of_a_cycle_is_not_asked(run, folder):
    words = ("check", folder / "small.yaml", folder / "t.json", "--for", "jtc")
    status, _, said = run(*words)
    assert status == 2
    assert "--for jtc judges the motion of a problem" in said
