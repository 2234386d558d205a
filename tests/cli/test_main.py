"""The lazy group of commands; one line for any error; robots, schema."""

import contextlib
import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from stored_trajectories import REFINEMENT, stored_path

from tubeplanner import LimitOverrides, Location, PlanOptions, load_problem, load_robot, plan
from tubeplanner.cli import console as answer_files
from tubeplanner.cli import plan as planned
from tubeplanner.cli.main import main
from tubeplanner.cli.report import peaks_lines
from tubeplanner.resources import bundled_presets

NAME, NARROW = "two_link/around_a_post", "two_link/paper_1_30mm"
PROBLEM, LINE = f"example:{NAME}", f"example:{NARROW}"
STOPS = ("--method", "stop-at-corners")
FIELDS = {
    *("status", "message", "where", "duration", "phase1_duration", "planning_time"),
    *("loading_time", "certificate_time", "stopped_by", "certificate"),
}
TIGHT = ("--tolerance", "1e-6")  # as of our own trajectories, not of foreign files


def problem_file(folder: Path, **sections):
    fields = {
        "robot": {
            "urdf": "example:two_link",
            "tool_frame": "hand",
            "gravity": [0, 0, 0],
            "limits": {"velocity": {"joint1": 50.0, "joint2": 50.0}},
        },
        "tube": {"points": [[0.3, -0.3, 0], [0.3, 0.3, 0]], "radius": 0.03},
        "start": {"seed": [0.0, -1.0]},
        **sections,
    }
    path = folder / "problem.json"
    path.write_text(json.dumps(fields))
    return path


def test_plan_writes_what_was_asked_and_says_where(run, tmp_path):
    files = {option: tmp_path / option.strip("-") for option in ("-o", "--csv", "--ros")}
    files |= {"--plot": tmp_path / "figure.png", "--html": tmp_path / "page.html"}
    arguments = [word for pair in files.items() for word in pair]
    status, out, err = run("plan", PROBLEM, *STOPS, "--time-left", *arguments)
    assert (status, err) == (0, "")
    for path in files.values():
        assert path.stat().st_size > 1000
        assert str(path) in out
    assert "planned motion" in files["--html"].read_text()
    assert "success: certified trajectory of" in out
    assert "time left on this path: motors that switch instantly would take" in out
    _, peaks, missing, *_ = out.splitlines()
    assert peaks.startswith("peaks: joint acceleration ") and "tool speed" in peaks
    assert missing.startswith("nothing limits acceleration or jerk; ")
    assert "robot.limits.acceleration and robot.limits.jerk" in missing


def test_an_answer_that_is_not_kept_says_what_keeps_it(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, _ = run("plan", PROBLEM, *STOPS)
    assert status == 0
    assert out.splitlines()[-1] == (
        "nothing written; to keep the answer, give -o T.json or --csv or --ros or --plot or --html"
    )
    assert list(tmp_path.iterdir()) == []
    _, out, _ = run("plan", PROBLEM, *STOPS, "-o", "t.json")
    assert out.splitlines()[-1] == "trajectory: t.json"
    assert "nothing written" not in out


@pytest.mark.dear("plans twice, smoothed and not")
def test_json_is_one_object_and_the_answer_smooth_unless_the_shortest_is_asked_for(run_json):
    status, smooth = run_json("plan", LINE)
    assert (status, smooth["status"]) == (0, "success")
    assert set(smooth) >= FIELDS
    assert smooth["phase1_duration"] is smooth["search"] is None
    assert set(smooth["where"]) == set(Location().as_dict())
    assert smooth["certificate"]["passed"] is True
    assert smooth["peak_acceleration"]["joint"] in {"joint1", "joint2"}
    for name, unit in (("tool_speed", "m/s"), ("tool_acceleration", "m/s^2")):
        assert (smooth[name]["unit"], smooth[name]["value"] > 0) == (unit, True)
    _, shortest = run_json("plan", LINE, "--slack", 0)
    least = shortest["duration"]
    assert smooth["shortest_duration"] == shortest["shortest_duration"] == least
    assert least < smooth["duration"] <= 1.005 * least * (1 + 1e-9)
    smoothed = [
        any(note.startswith("smoothed: ") for note in fields["notes"])
        for fields in (smooth, shortest)
    ]
    assert smoothed == [True, False]


@pytest.mark.slow  # searches
def test_a_search_says_what_it_did(run_json, tmp_path):
    words = ("--method", "branch-and-bound", "--slack", "0")
    _, fields = run_json("plan", problem_file(tmp_path), *words)
    assert fields["phase1_duration"] == fields["duration"]
    assert fields["search"]["nodes"] > 0


@pytest.mark.parametrize(
    ("with_jerk", "missing"),
    [
        ((), ["nothing limits jerk; "]),
        (("joint1",), ["nothing limits jerk of joint2; "]),
        (("joint1", "joint2"), []),
    ],
)
def test_limits_that_are_given_are_not_asked_for(with_jerk, missing):
    limits = LimitOverrides(
        acceleration={"joint1": 90.0, "joint2": 90.0}, jerk=dict.fromkeys(with_jerk, 90.0)
    )
    robot = load_robot("example:two_link", "hand", limits=limits)
    first, *others = peaks_lines(robot, "the peaks")
    assert first == "peaks: the peaks"
    assert [line.partition("; ")[0] + "; " for line in others] == missing


def test_quantities_that_differ_in_their_joints_are_named_with_them():
    limits = LimitOverrides(acceleration={"joint1": 90.0})
    robot = load_robot("example:two_link", "hand", limits=limits)
    missing = "nothing limits acceleration of joint2, or jerk of every joint; "
    assert peaks_lines(robot, "the peaks")[1].startswith(missing)


@pytest.mark.dear("plans a problem")
def test_doubts_are_told_before_the_answer_and_joints_that_nothing_holds_back_beside_it(run):
    limits = ("--set", "robot.limits={effort: .inf, velocity: 100}")
    lines = run("plan", PROBLEM, *STOPS, *limits)[1].splitlines()
    answer = next(k for k, line in enumerate(lines) if line.startswith("success: "))
    assert lines[answer - 1].startswith("note: velocity limit 100 rad/s (joint1, joint2), more ")
    beside = "note: NEITHER an effort NOR an acceleration limit: joint1, joint2; "
    assert lines[answer + 1].startswith(beside)
    assert lines[answer + 2].startswith("nothing is faster than 0.0")
    assert sum(line.startswith("note: velocity limit") for line in lines) == 1


def test_a_file_that_plan_writes_passes_check_and_a_faster_one_fails(run, run_json, tmp_path):
    good, fast = stored_path(NAME, REFINEMENT), tmp_path / "fast.json"
    assert "passes every condition" in run("check", PROBLEM, good)[1]
    fields = json.loads(good.read_text())
    factor, degree = 1 / 1.002, len(fields["coefficients"]) - 1
    fields["breakpoints"] = [t * factor for t in fields["breakpoints"]]
    fields["duration"] = fields["breakpoints"][-1]
    fields["coefficients"] = [
        [[value / factor ** (degree - row) for value in joint] for joint in rows]
        for row, rows in enumerate(fields["coefficients"])
    ]
    fast.write_text(json.dumps(fields))
    status, answer = run_json("check", PROBLEM, fast)
    assert (status, answer["status"]) == (1, "certificate_failed")
    assert answer["message"].startswith("the trajectory fails: effort: margin -0.004")
    assert answer["where"]["joint"] == "joint2"
    assert run("check", PROBLEM, fast, "--tolerance", "1e-6,0.01")[0] == 0


def test_an_infeasible_problem_is_an_answer(run, run_json, tmp_path):
    path = problem_file(tmp_path, tube={"points": [[0.3, -0.3, 0], [0.9, 0, 0]], "radius": 0.03})
    output = tmp_path / "t.json"
    output.write_text("precious")
    status, out, _ = run("plan", path, "-o", output)
    assert (status, output.read_text()) == (1, "precious")
    assert "unreachable: " in out
    status, fields = run_json("plan", path)
    assert (status, fields["status"]) == (1, "unreachable")
    assert fields["where"]["segment"] == 0
    absent = ("duration", "peak_acceleration", "tool_speed", "tool_acceleration")
    assert {fields[name] for name in absent} == {None}


def test_where_a_problem_contradicts_itself_is_known(run_json, tmp_path):
    points, apart = [[0.3, y, 0] for y in (-0.3, 0, 0.3)], [{"joint2": [-2, -1]}, {"joint2": "+"}]
    path = problem_file(tmp_path, tube={"points": points, "radius": 0.03, "joint_signs": apart})
    status, fields = run_json("plan", path)
    assert (status, fields["status"], fields["proved"]) == (2, "bad_input", True)
    assert (fields["where"]["joint"], fields["where"]["segment"]) == ("joint2", 0)
    assert fields["message"].endswith("; proved: there is no motion")


def test_an_interrupt_before_anything_is_certified_exits_with_130(run, run_json, monkeypatch):
    def interrupt(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("tubeplanner.planning.result.verify", interrupt)
    assert "interrupted before there was an answer" in run("plan", PROBLEM, *STOPS)[2]
    status, fields = run_json("plan", PROBLEM, *STOPS)
    assert (status, fields["status"]) == (130, "interrupted")


def test_an_interrupt_while_a_certified_answer_is_written_loses_nothing(
    run_json, monkeypatch, tmp_path
):
    write = answer_files.write_files

    def interrupted_write(*contents):
        signal.raise_signal(signal.SIGINT)
        write(*contents)

    monkeypatch.setattr(answer_files, "write_files", interrupted_write)
    path = tmp_path / "t.json"
    status, fields = run_json("plan", PROBLEM, *STOPS, "-o", path)
    assert (status, fields["status"]) == (0, "success")
    assert fields["stopped_by"] == "interrupt"
    assert path.exists()


@pytest.mark.parametrize("breaks", [False, True])
def test_an_interrupt_that_a_library_swallows_still_counts(run_json, monkeypatch, breaks):
    """trimesh catches everything while it imports, and may be left half imported."""
    from tubeplanner.task import cycle_file as problem_or_cycle

    load = problem_or_cycle.load_problem

    def swallowing_load(*names, **options):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        if breaks:
            raise TypeError("a half imported library")
        return load(*names, **options)

    monkeypatch.setattr(problem_or_cycle, "load_problem", swallowing_load)
    status, fields = run_json("plan", PROBLEM)
    assert (status, fields["status"]) == (130, "interrupted")


def test_an_error_of_our_own_is_one_line_and_not_a_verdict(run_json, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("tubeplanner.planning.result.verify", broken)
    status, fields = run_json("plan", PROBLEM, *STOPS)
    assert status == 2
    assert "internal error, please report it" in fields["message"]
    assert "ZeroDivisionError: oops" in fields["message"]


def test_a_picture_costs_no_trajectory(run, run_json, tmp_path, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(planned, "figure_file", broken)
    json_path, csv_path, plot = (tmp_path / f"t.{end}" for end in ("json", "csv", "png"))
    words = ("plan", PROBLEM, *STOPS, "--plot", plot, "--csv", csv_path, "-o", json_path)
    status, out, err = run(*words)
    assert status == 2 and json_path.exists() and csv_path.exists() and not plot.exists()
    assert out.endswith(f"trajectory: {json_path}\nCSV: {csv_path}\n")
    reason = f"output {plot} could not be made: internal error, please report it with the problem "
    reason += "file and what `tubeplanner info` prints: ZeroDivisionError: oops"
    assert err == f"tubeplanner: {reason}; saved: trajectory {json_path}, CSV {csv_path}\n"
    status, fields = run_json(*words)
    assert (status, fields["status"], fields["certificate"]["passed"]) == (2, "bad_input", True)
    assert fields["message"].startswith("certified trajectory of ")
    assert f"{reason}; saved: trajectory {json_path}" in fields["message"]
    assert fields["written"] == [str(json_path), str(csv_path)]
    assert fields["not_written"] == {str(plot): reason}


def test_an_error_after_the_writing_says_what_was_saved(run, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("oops")

    monkeypatch.setattr(planned, "plan_text", broken)
    path = tmp_path / "t.json"
    status, _, err = run("plan", PROBLEM, *STOPS, "-o", path)
    assert status == 2 and path.exists()
    assert err.endswith(f"ZeroDivisionError: oops; saved: trajectory {path}\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_under_standard_output_is_no_error_of_ours(monkeypatch, capsys):
    full = os.open("/dev/full", os.O_WRONLY)
    with monkeypatch.context() as patch:
        stream = os.fdopen(full, "w", closefd=False)
        patch.setattr(sys, "stdout", stream)
        assert main(["info", PROBLEM, "--json"]) == 2
        with contextlib.suppress(OSError):
            stream.close()
    os.close(full)
    assert "standard output cannot be written: No space left" in capsys.readouterr().err


def test_obstacles_that_nothing_can_meet_are_pointed_out(run, tmp_path):
    """asr_twodof has no collision geometry at all."""
    ends = [[0.3, 0.4], [0.4, 0.4]]
    tool = load_robot("example:asr_twodof", "Tip").tool_position(np.array(ends))
    path = problem_file(
        tmp_path,
        robot={"urdf": "example:asr_twodof", "tool_frame": "Tip"},
        tube={"points": tool.tolist(), "radius": 0.2},
        start={"joints": ends[0]},
        goal={"joints": ends[1]},
        obstacles=[{"name": "ball", "sphere": 0.1, "position": [0.5, 0.5, 0.5]}],
    )
    status, out, _ = run("plan", path, *STOPS)
    assert status == 0
    assert "no collision geometry; the obstacles were NOT checked" in out


def test_a_name_is_printed_as_it_is(run, tmp_path):
    """Square brackets are markup to the library that draws the table."""
    ball = {"name": "b [red]x[/red]", "sphere": 0.01, "position": [0.3, 0, 0]}
    path = problem_file(tmp_path, obstacles=[ball])
    assert "b [red]x[/red]" in run("plan", path, *STOPS)[1]


def test_robots_and_schema_are_listed(run, run_json):
    status, out, _ = run("robots")
    assert status == 0
    for name in ("ur5/over_the_wall", "ur5/through_the_door", "ur5/tolerance_and_payload"):
        assert f"example:{name}" in out
    assert str(bundled_presets()["fr3"]) in out
    listed = run_json("robots")[1]
    others = {"ur5/through_the_door", "ur5/tolerance_and_payload", "presets/fr3"}
    assert not others & set(listed["problems"])
    assert "ur5/through_the_door" in listed["cycles"]
    assert listed["studies"] == ["ur5/tolerance_and_payload"]
    assert listed["presets"] == list(bundled_presets())
    schema = json.loads(run("schema")[1])
    assert set(schema["required"]) == {"robot", "start"}
    for kind in ("study", "cycle"):
        assert json.loads(run("schema", f"--{kind}")[1])["title"] == f"tubeplanner {kind}"
    assert "either --cycle or --study" in run("schema", "--cycle", "--study")[2]


def test_the_installed_command_runs():
    command = Path(sys.executable).parent / "tubeplanner"
    output = subprocess.run([command, "--version"], capture_output=True, text=True)
    assert output.returncode == 0
    assert output.stdout.startswith("tubeplanner ")


def in_periods(folder, period):
    path = folder / "problem.yaml"
    path.write_text(f"include: {LINE}\nperiod: {period}\n")
    return path


def last_times(sampled, ros):
    """Return the last times of a CSV and of a ROS file."""
    with sampled.open() as file:
        rows = list(csv.DictReader(file))
    last = YAML(typ="safe").load(ros.read_text())["points"][-1]["time_from_start"]
    return float(rows[-1]["time"]), last["sec"] + 1e-9 * last["nanosec"]


@pytest.fixture
def in_steps(tmp_path, shared, monkeypatch):
    """A problem with a period, which is planned already."""
    path = in_periods(tmp_path, 0.004)
    quick = PlanOptions(quality="fast", slack=0.0)
    result = shared("narrow.in_periods", lambda: plan(load_problem(path), quick))
    monkeypatch.setattr(planned, "plan_problem", lambda *_: result)
    return path


@pytest.mark.dear("plans once and judges two files")
def test_files_without_a_rate_are_the_motion_itself(in_steps, run, run_json, tmp_path):
    own, sampled, ros = (tmp_path / f"t.{kind}" for kind in ("json", "csv", "yaml"))
    files = ("-o", own, "--csv", sampled, "--ros", ros)
    status, answer = run_json("plan", in_steps, *files)
    assert status == 0
    assert not any("CSV" in note for note in answer["notes"])
    duration = json.loads(own.read_text())["duration"]
    assert duration == answer["duration"] > 0
    times = last_times(sampled, ros)
    assert times[0] == pytest.approx(duration, abs=1e-12)
    assert times[1] == pytest.approx(duration, abs=1e-9)
    for path in (own, sampled):
        status, out, _ = run("check", in_steps, path, *TIGHT)
        assert (status, "passes every condition" in out) == (0, True)


@pytest.mark.dear("judges two files")
def test_rates_that_hit_every_breakpoint_are_the_motion_and_others_averaged(
    in_steps, run, run_json, tmp_path
):
    """Averaged as they are without a period: they pass as foreign files do."""
    sampled = tmp_path / "t.csv"
    words = ("plan", in_steps, "--csv", sampled, "--rate")
    _, answer = run_json(*words, 500)
    assert not any("CSV" in note for note in answer["notes"])
    rows = sampled.read_text().splitlines()
    assert len(rows) == 2 + round(answer["duration"] * 500)
    assert run("check", in_steps, sampled, *TIGHT)[0] == 0
    _, answer = run_json(*words, 240)
    assert "CSV and ROS samples at 240 Hz are averaged" in answer["notes"][-1]
    assert np.genfromtxt(sampled, delimiter=",", names=True)["time"][-1] > answer["duration"]
    assert run("check", in_steps, sampled)[0] == 0


@pytest.mark.slow  # plans twice
def test_slack_of_the_command_line_holds_before_the_files(run_json, tmp_path):
    problem = in_periods(tmp_path, 0.008)
    durations = {}
    for slack in ("0", "0.05"):
        _, answer = run_json("plan", problem, "--quality", "fast", "--slack", slack)
        durations[slack] = round(answer["duration"] / 0.008)
        shortest = round(answer["shortest_duration"] / 0.008)
    assert durations == {"0": shortest, "0.05": int(1.05 * shortest)}
