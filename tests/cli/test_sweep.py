"""`plot` and `sweep` as a user meets them."""

import csv
import json
import re
import shutil
from dataclasses import replace

import pytest
from cases import simulated_sweep
from stored_trajectories import REFINEMENT, stored_path

from tubeplanner.cli.sweep import field_sweep_text

NAME = "two_link/paper_1_30mm"
PROBLEM = f"example:{NAME}"
PNG = b"\x89PNG"
FAST = ("--quality", "fast")


@pytest.fixture
def trajectory(tmp_path):
    return shutil.copy(stored_path(NAME, REFINEMENT), tmp_path / "t.json")


@pytest.mark.slow  # draws two figures
def test_plot_draws_beside_the_trajectory_or_where_told(run, run_json, drawn, trajectory, tmp_path):
    status, out, err = run("plot", PROBLEM, trajectory)
    beside = trajectory.with_suffix(".png")
    assert (status, err) == (0, "")
    assert f"plot: {beside} (" in out
    assert "samples are joined by quintics" not in out
    assert beside.read_bytes().startswith(PNG)
    other = tmp_path / "other.png"
    status, _ = run_json("plot", PROBLEM, trajectory, "-o", other)
    assert status == 0
    assert other.stat().st_size > 10_000


@pytest.mark.dear("makes a figure")
def test_the_figure_of_samples_says_how_they_are_joined(run_json, stored, tmp_path):
    problem, motion = stored(NAME, REFINEMENT)
    samples, figure = tmp_path / "t.csv", tmp_path / "other.png"
    motion.save(samples, problem)
    status, answer = run_json("plot", PROBLEM, samples, "-o", figure)
    assert (status, answer["status"], answer["plot"]) == (0, "success", str(figure))
    assert answer["duration"] == pytest.approx(0.685, abs=0.01)
    assert any("samples are joined by quintics" in note for note in answer["notes"])
    assert figure.read_bytes().startswith(PNG)


def test_plot_of_another_robots_trajectory_is_refused(run, drawn, trajectory):
    status, _, err = run("plot", "example:ur5/over_the_wall", trajectory)
    assert status == 2
    assert "the trajectory moves the joints joint1, joint2" in err


@pytest.mark.dear("plans twice")
def test_sweep_prints_a_table_and_writes_what_was_asked(run, tmp_path):
    table, figure = tmp_path / "s.csv", tmp_path / "s.png"
    radii = "0.01, 0.03,0.00000000000000001"
    status, out, err = run("sweep", PROBLEM, "--radius", radii, "-o", table, "--plot", figure)
    assert (status, err) == (0, "")
    rows = list(csv.DictReader(table.read_text().splitlines()))
    durations = [float(row["duration"]) for row in rows[1:]]
    assert durations == pytest.approx([0.6988, 0.6812], rel=1e-3)
    printed = [f"{duration:.4f} s" for duration in durations]
    for words in ("10 mm", "30 mm", *printed, str(table), str(figure)):
        assert words in out
    assert [row["status"] == "success" for row in rows] == [False, True, True]
    assert rows[0]["message"]
    assert figure.read_bytes().startswith(PNG)


def test_the_table_says_how_many_runs_failed():
    swept = simulated_sweep([0, 3, None])
    simulated = field_sweep_text(swept)
    assert "runs failed" in simulated
    assert re.findall(r"\d+ of \d+", simulated) == ["0 of 200", "3 of 200"]
    assert "runs failed" not in field_sweep_text(replace(swept, rows=swept.rows[2:]))


def test_a_sweep_without_any_answer_fails(run, run_json):
    words = ("--radius", "20000")
    status, fields = run_json("sweep", PROBLEM, *words)
    assert (status, fields["status"]) == (1, "no_trajectory")
    assert "tube.radius[0] is 20000 m" in fields["rows"][0]["message"]
    assert run("sweep", PROBLEM, *words)[1].endswith("give -o TABLE.csv or --plot\n")


@pytest.mark.dear("plans once and makes a figure")
def test_vary_prints_a_table_and_writes_what_was_asked(run, tmp_path):
    table, figure = tmp_path / "s.csv", tmp_path / "s.png"
    words = ("--vary", "tube.radius=x0.5,wide", *FAST, "-o", table)
    status, out, err = run("sweep", PROBLEM, *words, "--plot", figure)
    assert (status, err) == (0, "")
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [row["tube.radius"] for row in rows] == ["x0.5", "wide"]
    printed = f"{float(rows[0]['duration']):.4f} s"
    for words in ("duration against tube.radius", printed, "1 of 2 planned", str(figure)):
        assert words in out
    assert "bad_input: tube.radius is 'wide'; it must be a number" in out
    assert figure.read_bytes().startswith(PNG)


@pytest.mark.dear("plans and smooths")
def test_a_varied_slack_shows_the_shortest_beside(run):
    status, out, _ = run("sweep", PROBLEM, "--vary", "objective.slack=0.02", *FAST)
    assert status == 0
    assert "shortest" in out.splitlines()[2]
    line = next(line for line in out.splitlines() if "0.02 " in line and "certified" in line)
    durations = [float(word) for word in line.split() if word.startswith("0.") and len(word) == 6]
    assert len(durations) == 2
    assert durations[0] > 1.01 * durations[1]
    assert "\nnote (0.02): smoothed: " in out


@pytest.mark.dear("plans twice")
def test_vary_as_json(run_json, tmp_path):
    path = tmp_path / "s.json"
    words = ("--vary", "robot.payload.mass=0, 5, -1", *FAST, "-o", path)
    status, fields = run_json("sweep", PROBLEM, *words)
    assert (status, fields["message"]) == (0, "2 of 3 planned")
    assert fields["quantity"] == "robot.payload.mass"
    assert [row["value"] for row in fields["rows"]] == [0, 5, -1]
    assert [row["status"] for row in fields["rows"]] == ["success", "success", "bad_input"]
    assert fields["rows"][0]["duration"] < fields["rows"][1]["duration"]
    assert fields["rows"] == json.loads(path.read_text())["rows"]
    assert fields["loading_time"] == sum(row["loading_time"] for row in fields["rows"])
