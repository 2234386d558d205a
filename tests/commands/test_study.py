"""`tubeplanner study` as a user meets it: tables, journals, and what is left after its end."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from tubeplanner import load_problem, plan
from tubeplanner.planning.plan_options import PlanOptions

PROBLEM = "example:two_link/paper_1_30mm"
STUDY = """format: tubeplanner/study
study:
  problem: {problem}
  vary: {{tube.radius: {radii}}}
  options: {{method: stop-at-corners}}
"""
PROGRAM = "import sys; from tubeplanner.commands.cli import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture
def study(tmp_path):
    """Return a function that writes a study of some radii."""

    def write(radii, name="s.yaml"):
        path = tmp_path / name
        path.write_text(STUDY.format(problem=PROBLEM, radii=json.dumps(radii)))
        return path

    return write


def rows(table):
    return list(csv.DictReader(table.read_text().splitlines()))


def test_a_study_becomes_a_table_a_journal_and_a_figure(run, study, tmp_path):
    table, figure = tmp_path / "t.csv", tmp_path / "t.png"
    path = study([0.03, -1, -2, "x0.5"])
    status, out, err = run("study", path, "-o", table, "--plot", figure)
    assert (status, err) == (0, "")
    found = rows(table)
    assert [row["tube.radius"] for row in found] == ["0.03", "-1", "-2", "x0.5"]
    assert [row["status"] for row in found] == ["success", "bad_input", "bad_input", "success"]
    expected = plan(load_problem(PROBLEM), PlanOptions("stop-at-corners")).duration
    assert float(found[0]["duration"]) == pytest.approx(expected, rel=1e-12)
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert len((tmp_path / "t.jsonl").read_text().splitlines()) == 4
    assert f"shortest: {expected:.4f} s at tube.radius = 0.03" in out
    assert "2 of 4 points have a certified motion" in out
    assert "tube.radius = -1: tube.radius[0] is -1 m" in out
    assert "-2 m" not in out
    for written in (table, tmp_path / "t.jsonl", figure):
        assert str(written) in out


def test_as_json_and_without_files(run, study, tmp_path):
    status, out, _ = run("study", study([0.03, -1]), "--json", "--processes", "1")
    fields = json.loads(out)
    assert (status, fields["status"]) == (0, "success")
    assert fields["message"] == "1 of 2 points have a certified motion"
    assert fields["counts"] == {"success": 1, "bad_input": 1}
    assert [row["point"] for row in fields["rows"]] == [0, 1]
    assert [path.name for path in tmp_path.iterdir()] == ["s.yaml"]
    table = tmp_path / "t.json"
    _, out, _ = run("study", study([-1]), "-o", table)
    assert json.loads(table.read_text())["rows"][0]["status"] == "bad_input"


def test_a_study_without_any_answer_fails(run, study):
    status, out, _ = run("study", study([-1]), "--json")
    assert (status, json.loads(out)["status"]) == (1, "no_trajectory")
    status, out, _ = run("study", study([-1]))
    assert "shortest" not in out
    assert "nothing written; to keep the answer, give -o TABLE.csv or --plot" in out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "t.txt"), "ends in .csv or .json"),
        (("--plot", "t.jpg"), "ends in .png"),
        (("-o", "no/t.csv"), "the folder"),
        (("--processes", "0"), "'--processes': 0 is not in the range x>=1"),
    ],
)
def test_wrong_usage_is_refused_by_name(arguments, message, run, study):
    status, _, err = run("study", study([0.03]), *arguments)
    assert status == 2
    assert message in err


def test_neither_the_study_nor_its_problems_are_overwritten(run, study, tmp_path):
    problem = tmp_path / "p.json"
    problem.write_text(json.dumps({"include": PROBLEM}))
    path = study([0.03])
    path.write_text(path.read_text().replace(PROBLEM, "p.json"))
    status, _, err = run("study", path, "-o", problem)
    assert status == 2
    assert "is the same file as" in err
    assert json.loads(problem.read_text()) == {"include": PROBLEM}


def test_a_file_that_is_no_journal_stays(run, study, tmp_path):
    journal = tmp_path / "t.jsonl"
    journal.write_text("mine\n")
    status, _, err = run("study", study([0.03]), "-o", tmp_path / "t.csv")
    assert status == 2
    assert "t.jsonl: line 1 is none of a study's journal" in err
    assert journal.read_text() == "mine\n"


def begun(path, table):
    """Begin a study in a process of its own; return it when some points are done."""
    command = [sys.executable, "-c", PROGRAM, "study", str(path), "-o", str(table)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    journal = table.with_suffix(".jsonl")
    while not journal.exists() or journal.read_bytes().count(b"\n") < 3:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    return process


def keys(table):
    lines = table.with_suffix(".jsonl").read_text().splitlines()
    return [json.loads(line)["key"] for line in lines]


def test_a_killed_study_goes_on_nothing_lost_and_nothing_twice(run, study, tmp_path):
    table = tmp_path / "t.csv"
    path = study([round(0.01 + 0.0002 * k, 4) for k in range(80)])
    process = begun(path, table)
    os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    assert not table.exists()
    kept = (tmp_path / "t.jsonl").read_bytes()
    before = kept.splitlines(keepends=True)
    whole = [line for line in before if line.endswith(b"\n")]
    assert 3 <= len(whole) < 80
    (tmp_path / "t.jsonl").write_bytes(b"".join(whole) + b'{"key": "torn')
    status, _, _ = run("study", path, "-o", table)
    assert status == 0
    assert (tmp_path / "t.jsonl").read_bytes().startswith(b"".join(whole))
    assert len(keys(table)) == len(set(keys(table))) == 80
    assert sorted(keys(table)) == sorted(row["key"] for row in rows(table))
    assert [int(row["point"]) for row in rows(table)] == list(range(80))


def test_ctrl_c_writes_the_table_of_what_is_done(run, study, tmp_path):
    table = tmp_path / "t.csv"
    path = study([round(0.01 + 0.0002 * k, 4) for k in range(80)])
    process = begun(path, table)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    done = len(rows(table))
    assert 2 <= done < 80  # Ctrl-C may come when a line is written and not yet taken for done
    assert f"interrupted, {80 - done} of 80 are left: run the same command again to go on" in out
    status, _, _ = run("study", path, "-o", table)
    assert (status, len(rows(table)), len(keys(table))) == (0, 80, 80)
