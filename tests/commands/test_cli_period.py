"""Files in a controller's periods: what was planned, sample by sample, judged as our own."""

import csv
import json

import numpy as np
import pytest
from ruamel.yaml import YAML

from cases import slow_but
from tubeplanner.resources import bundled_problems

LINE, WALL = "two_link/paper_1_30mm", "ur5/over_the_wall"
CASES = [(name, period) for name in (LINE, WALL) for period in (0.001, 0.004, 0.008)]
TIGHT = ("--tolerance", "1e-6")


def in_periods(folder, name, period):
    data = YAML(typ="safe").load(bundled_problems()[name].read_text())
    path = folder / "problem.yaml"
    with path.open("w") as file:
        YAML(typ="safe").dump({**data, "period": period}, file)
    return path


def last_times(sampled, ros):
    """Return the last times of a CSV and of a ROS file."""
    with sampled.open() as file:
        rows = list(csv.DictReader(file))
    last = YAML(typ="safe").load(ros.read_text())["points"][-1]["time_from_start"]
    return float(rows[-1]["time"]), last["sec"] + 1e-9 * last["nanosec"]


@pytest.mark.parametrize(("name", "period"), slow_but(CASES[1:3], CASES))
def test_files_without_a_rate_are_the_motion_itself(name, period, run, tmp_path):
    problem = in_periods(tmp_path, name, period)
    own, sampled, ros = (tmp_path / f"t.{kind}" for kind in ("json", "csv", "yaml"))
    status, out, _ = run("plan", problem, "-o", own, "--csv", sampled, "--ros", ros, "--json")
    answer = json.loads(out)
    assert status == 0
    assert not any("CSV" in note for note in answer["notes"])
    duration = json.loads(own.read_text())["duration"]
    assert duration == answer["duration"] > 0
    times = last_times(sampled, ros)
    assert times[0] == pytest.approx(duration, abs=1e-12)
    assert times[1] == pytest.approx(duration, abs=1e-9)
    for path in (own, sampled, ros):
        status, out, _ = run("check", problem, path, *TIGHT)
        assert (status, "passes every condition" in out) == (0, True)


@pytest.mark.parametrize("rate", [250, 500])
def test_rates_that_hit_every_breakpoint_are_the_motion_too(rate, run, tmp_path):
    problem, sampled = in_periods(tmp_path, LINE, 0.004), tmp_path / "t.csv"
    _, out, _ = run("plan", problem, "--csv", sampled, "--rate", rate, "--json")
    answer = json.loads(out)
    assert not any("CSV" in note for note in answer["notes"])
    rows = sampled.read_text().splitlines()
    assert len(rows) == 2 + round(answer["duration"] * rate)
    assert run("check", problem, sampled, *TIGHT)[0] == 0


@pytest.mark.parametrize("rate", [100, 240])
def test_other_rates_are_averaged_with_a_note(rate, run, tmp_path):
    """As they are without a period: they pass as foreign files do."""
    problem, sampled = in_periods(tmp_path, LINE, 0.004), tmp_path / "t.csv"
    _, out, _ = run("plan", problem, "--csv", sampled, "--rate", rate, "--slack", 0, "--json")
    answer = json.loads(out)
    assert f"CSV and ROS samples at {rate} Hz are averaged" in answer["notes"][-1]
    assert np.genfromtxt(sampled, delimiter=",", names=True)["time"][-1] > answer["duration"]
    assert run("check", problem, sampled)[0] == 0


def test_slack_of_the_command_line_holds_before_the_files(run, tmp_path):
    problem = in_periods(tmp_path, LINE, 0.008)
    durations = {}
    for slack in ("0", "0.05"):
        _, out, _ = run("plan", problem, "--slack", slack, "--json")
        answer = json.loads(out)
        durations[slack] = round(answer["duration"] / 0.008)
        shortest = round(answer["shortest_duration"] / 0.008)
    assert durations == {"0": shortest, "0.05": int(1.05 * shortest)}
