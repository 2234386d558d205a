"""`plot` and `sweep` as a user meets them."""

import csv
import json
import re

import pytest

from cases import simulated_sweep, slow_but
from tubeplanner.commands.cli import main
from tubeplanner.commands.report import field_sweep_text

PROBLEM = "example:two_link/paper_1_30mm"
PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def trajectory(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planned")
    files = ["-o", folder / "t.json", "--csv", folder / "t.csv", "--ros", folder / "r.yaml"]
    assert main(["plan", PROBLEM, *map(str, files)]) == 0
    return folder / "t.json"


@pytest.mark.parametrize("name", slow_but(["t.json", "t.csv"], ["t.json", "t.csv", "r.yaml"]))
def test_plot_draws_beside_the_trajectory_or_where_told(name, run, trajectory, tmp_path):
    source = trajectory.with_name(name)
    status, out, err = run("plot", PROBLEM, source)
    beside = source.with_suffix(".png")
    assert (status, err) == (0, "")
    assert f"plot: {beside} (" in out
    assert ("samples are joined by quintics" in out) == (name != "t.json")
    assert beside.read_bytes().startswith(PNG)
    other = tmp_path / "other.png"
    status, out, _ = run("plot", PROBLEM, source, "-o", other, "--json")
    fields = json.loads(out)
    assert status == 0
    assert fields["status"] == "success"
    assert fields["plot"] == str(other)
    assert fields["duration"] == pytest.approx(0.685, abs=0.01)
    assert other.stat().st_size > 20_000


def test_what_plan_writes_passes_check(run, trajectory):
    for name in ("t.json", "t.csv", "r.yaml"):
        status, out, _ = run("check", PROBLEM, trajectory.with_name(name))
        assert status == 0, out


def test_plan_says_what_became_of_the_samples(run, tmp_path):
    _, out, _ = run("plan", PROBLEM, "--csv", tmp_path / "t.csv")
    assert "note: CSV and ROS samples at 500 Hz are averaged over neighbouring periods" in out
    _, out, _ = run("plan", PROBLEM, "--csv", tmp_path / "t.csv", "--json")
    assert any("longer than the trajectory" in note for note in json.loads(out)["notes"])
    _, out, _ = run("plan", PROBLEM, "-o", tmp_path / "t.json", "--json")
    assert not any("samples" in note for note in json.loads(out)["notes"])


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
    assert [row["status"] for row in rows][1:] == ["success", "success"]
    assert rows[0]["status"] != "success"
    assert rows[0]["message"]
    assert figure.read_bytes().startswith(PNG)


def test_sweep_as_json(run, tmp_path):
    path = tmp_path / "s.json"
    arguments = ("sweep", PROBLEM, "--radius-scale", "1", "--quality", "fast", "-o", path)
    status, out, _ = run(*arguments, "--json")
    fields, written = json.loads(out), json.loads(path.read_text())
    assert status == 0
    assert fields["message"] == "1 of 1 planned"
    assert fields["quantity"] == "radius_scale"
    assert fields["rows"][0]["radii"] == [0.03]
    assert fields["rows"] == written["rows"]


def test_the_table_says_how_many_runs_failed():
    simulated = field_sweep_text(simulated_sweep([0, 3, None]))
    assert "runs failed" in simulated
    assert re.findall(r"\d+ of \d+", simulated) == ["0 of 200", "3 of 200"]
    assert "runs failed" not in field_sweep_text(simulated_sweep([None]))


def test_a_sweep_without_any_answer_fails(run):
    status, out, _ = run("sweep", PROBLEM, "--radius", "20000", "--json")
    fields = json.loads(out)
    assert status == 1
    assert fields["status"] == "no_trajectory"
    assert "tube.radius[0] is 20000 m" in fields["rows"][0]["message"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("sweep", PROBLEM), "either --radius or --radius-scale"),
        (("sweep", PROBLEM, "--radius", "1", "--radius-scale", "1"), "either --radius or"),
        (("sweep", PROBLEM, "--radius", "1;2"), "--radius '1;2' is no list of numbers"),
        (("sweep", PROBLEM, "--radius", "0"), "radius is 0; it must be > 0"),
        (("sweep", PROBLEM, "--radius", "1", "-o", "t.txt"), "ends in .csv or .json"),
        (("sweep", PROBLEM, "--radius", "1", "--plot", "t.jpg"), "ends in .png, .pdf or .svg"),
        (("sweep", PROBLEM, "--radius", "1", "--quality", "good"), "quality 'good'"),
        (("plot", PROBLEM, "nowhere.json"), "nowhere.json cannot be read"),
        (("plot", PROBLEM, "t.json", "-o", "t.jpg"), "-o t.jpg: name a file that ends in .png"),
    ],
)
def test_wrong_usage_is_refused_by_name(arguments, message, run):
    status, _, err = run(*arguments)
    assert status == 2
    assert message in err


def test_plot_of_another_robots_trajectory_is_refused(run, trajectory):
    status, _, err = run("plot", "example:ur5/over_the_wall", trajectory)
    assert status == 2
    assert "the trajectory moves the joints joint1, joint2" in err
