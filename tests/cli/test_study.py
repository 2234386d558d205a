"""`tubeplanner study` as a user meets it: tables, journals, and what is left after its end."""

import csv
import json
import signal
import subprocess
import sys
import time

import pytest
from studied import Here

from tubeplanner import load_problem, plan
from tubeplanner.planning.options import PlanOptions

PROBLEM = "example:two_link/paper_1_30mm"
STUDY = """format: tubeplanner/study
study:
  problem: {problem}
  vary: {{tube.radius: {radii}}}
  options: {{method: stop-at-corners}}
"""
PROGRAM = "import sys; from tubeplanner.cli.main import main; sys.exit(main(sys.argv[1:]))"


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


def keys(table):
    """Return the keys of the journal beside a table."""
    lines = table.with_suffix(".jsonl").read_text().splitlines()
    return [json.loads(line)["key"] for line in lines]


@pytest.mark.dear("plans twice and makes a figure")
def test_a_study_becomes_a_table_a_journal_and_a_figure(run, here, study, tmp_path):
    table, figure = tmp_path / "t.csv", tmp_path / "t.png"
    path = study([0.03, -1, -2, "x0.5"])
    words = ("-o", table, "--plot", figure, "--processes", "3")
    status, out, err = run("study", path, *words)
    assert (status, err, here) == (0, "", [(3, None)])
    written = rows(table)
    assert [row["tube.radius"] for row in written] == ["0.03", "-1", "-2", "x0.5"]
    assert [row["status"] for row in written] == ["success", "bad_input", "bad_input", "success"]
    expected = plan(load_problem(PROBLEM), PlanOptions("stop-at-corners")).duration
    assert float(written[0]["duration"]) == pytest.approx(expected, rel=1e-12)
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert f"shortest: {expected:.4f} s at tube.radius = 0.03" in out
    assert "2 of 4 points have a certified motion" in out
    assert "tube.radius = -1: tube.radius[0] is -1 m" in out
    assert "-2 m" not in out
    for path in (table, tmp_path / "t.jsonl", figure):
        assert str(path) in out


def test_as_json_and_without_files(run, run_json, here, study, tmp_path):
    status, fields = run_json("study", study([0.03, -1]))
    assert (status, fields["status"]) == (0, "success")
    assert fields["message"] == "1 of 2 points have a certified motion"
    assert fields["counts"] == {"success": 1, "bad_input": 1}
    assert [row["point"] for row in fields["rows"]] == [0, 1]
    assert [path.name for path in tmp_path.iterdir()] == ["s.yaml"]
    table = tmp_path / "t.json"
    run("study", study([-1]), "-o", table)
    assert json.loads(table.read_text())["rows"][0]["status"] == "bad_input"


def test_a_study_without_any_answer_fails(run, run_json, here, study):
    status, fields = run_json("study", study([-1]))
    assert (status, fields["status"]) == (1, "no_trajectory")
    status, out, _ = run("study", study([-1]))
    assert "shortest" not in out
    assert "nothing written; to keep the answer, give -o TABLE.csv or --plot" in out


def test_neither_problems_nor_what_is_no_journal_are_overwritten(run, study, tmp_path):
    problem, journal, path = tmp_path / "p.json", tmp_path / "t.jsonl", study([0.03])
    problem.write_text(json.dumps({"include": PROBLEM}))
    path.write_text(path.read_text().replace(PROBLEM, "p.json"))
    assert "is the same file as" in run("study", path, "-o", problem)[2]
    assert json.loads(problem.read_text()) == {"include": PROBLEM}
    journal.write_text("mine\n")
    status, _, err = run("study", path, "-o", tmp_path / "t.csv")
    assert status == 2
    assert "t.jsonl: line 1 is none of a study's journal" in err
    assert journal.read_text() == "mine\n"


def test_a_killed_study_goes_on_nothing_lost_and_nothing_twice(run, here, study, tmp_path):
    """What a kill leaves is a journal with a torn line."""
    table, journal = tmp_path / "t.csv", tmp_path / "t.jsonl"
    path = study([0.02, 0.03, 0.04, 0.05])
    assert run("study", path, "-o", table)[0] == 0
    whole = journal.read_bytes().splitlines(keepends=True)
    assert len(whole) == 4
    table.unlink()
    journal.write_bytes(b"".join(whole[:2]) + b'{"key": "torn')
    assert run("study", path, "-o", table)[0] == 0
    assert journal.read_bytes().startswith(b"".join(whole[:2]))
    assert len(set(keys(table))) == 4
    assert sorted(keys(table)) == sorted(row["key"] for row in rows(table))


def test_ctrl_c_writes_the_table_of_what_is_done(run, here, study, tmp_path, monkeypatch):
    table, path = tmp_path / "t.csv", study([0.02, 0.03, 0.04, 0.05])
    submit = Here.submit

    def pressed(executor, *arguments, **named):
        if executor.calls == 2:
            signal.raise_signal(signal.SIGINT)
        return submit(executor, *arguments, **named)

    with monkeypatch.context() as patch:
        patch.setattr(Here, "submit", pressed)
        status, out, _ = run("study", path, "-o", table)
    assert (status, len(keys(table))) == (0, len(rows(table)))
    done = len(rows(table))
    assert 1 <= done <= 2
    assert f"interrupted, {4 - done} of 4 are left: run the same command again to go on" in out
    assert run("study", path, "-o", table)[0] == 0
    assert len(rows(table)) == len(keys(table)) == 4


@pytest.mark.slow  # a process starts others, which load the libraries
def test_ctrl_c_ends_a_study_in_many_processes(study, tmp_path):
    table, count = tmp_path / "t.csv", 200
    path = study([round(0.01 + 0.0002 * k, 4) for k in range(count)])
    command = [sys.executable, "-c", PROGRAM, "study", str(path), "-o", str(table)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    journal = table.with_suffix(".jsonl")
    while not journal.exists() or journal.read_bytes().count(b"\n") < 3:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    done = len(rows(table))
    assert 2 <= done < count  # Ctrl-C may come when a line is written and not yet taken for done
    assert f"interrupted, {count - done} of {count} are left: " in out
