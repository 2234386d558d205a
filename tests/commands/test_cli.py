"""The command line as a user meets it: text, one JSON object, files, exit status."""

import contextlib
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tubeplanner import Place, load_robot
from tubeplanner.resources import bundled_presets

PROBLEM = "example:two_link/around_a_post"
FIELDS = {
    "status",
    "message",
    "where",
    "duration",
    "phase1_duration",
    "planning_time",
    "loading_time",
    "certificate_time",
    "stopped_by",
    "certificate",
}


@pytest.fixture
def run_json(run):
    def call(*arguments):
        status, out, _ = run(*arguments, "--json")
        return status, json.loads(out)

    return call


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
    files["--plot"] = tmp_path / "figure.png"
    arguments = [word for pair in files.items() for word in pair]
    status, out, err = run("plan", PROBLEM, *arguments)
    assert status == 0
    assert err == ""
    for path in files.values():
        assert path.stat().st_size > 1000
        assert str(path) in out
    assert "success: certified trajectory of" in out


def test_plan_without_an_output_option_writes_nothing(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("plan", PROBLEM)[0] == 0
    assert list(tmp_path.iterdir()) == []


def test_json_is_one_object_with_every_field(run_json):
    status, fields = run_json("plan", PROBLEM)
    assert status == 0
    assert set(fields) >= FIELDS
    assert fields["status"] == "success"
    assert fields["phase1_duration"] is None
    assert fields["search"] is None
    _, fields = run_json("plan", PROBLEM, "--method", "branch-and-bound")
    assert fields["phase1_duration"] == fields["duration"]
    assert fields["search"]["nodes"] > 0
    assert set(fields["where"]) == set(Place().as_dict())
    assert fields["certificate"]["passed"] is True


def test_the_answer_is_smooth_unless_the_shortest_is_asked_for(run_json):
    _, smooth = run_json("plan", PROBLEM)
    _, shortest = run_json("plan", PROBLEM, "--slack", 0)
    least = shortest["duration"]
    assert smooth["shortest_duration"] == shortest["shortest_duration"] == least
    assert least < smooth["duration"] <= 1.005 * least * (1 + 1e-9)
    smoothed = [
        any(note.startswith("smoothed: the shortest motion takes") for note in fields["notes"])
        for fields in (smooth, shortest)
    ]
    assert smoothed == [True, False]


def test_the_first_lines_are_the_peaks_and_what_nothing_limits(run, run_json, tmp_path):
    lines = run("plan", PROBLEM)[1].splitlines()
    assert lines[1].startswith("peaks: joint acceleration ")
    assert "tool speed" in lines[1]
    assert lines[2].startswith("nothing limits acceleration or jerk; ")
    assert "robot.limits.acceleration and robot.limits.jerk" in lines[2]
    _, fields = run_json("plan", PROBLEM)
    assert fields["peak_acceleration"]["joint"] in {"joint1", "joint2"}
    for name, unit in (("tool_speed", "m/s"), ("tool_acceleration", "m/s^2")):
        assert fields[name]["unit"] == unit
        assert fields[name]["value"] > 0
        assert 0 <= fields[name]["time"] <= fields["duration"]


@pytest.mark.parametrize(
    ("quantities", "line"),
    [
        ({"acceleration": {"joint1": 90.0, "joint2": 90.0}}, "nothing limits jerk; "),
        (
            {"acceleration": {"joint1": 90.0, "joint2": 90.0}, "jerk": {"joint1": 9000.0}},
            "nothing limits jerk of joint2; ",
        ),
        (
            {
                "acceleration": {"joint1": 90.0, "joint2": 90.0},
                "jerk": {"joint1": 9000.0, "joint2": 9000.0},
            },
            "loaded in ",
        ),
    ],
)
def test_limits_that_are_given_are_not_asked_for(run, tmp_path, quantities, line):
    robot = {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]}
    limits = {"velocity": {"joint1": 50.0, "joint2": 50.0}, **quantities}
    path = problem_file(tmp_path, robot={**robot, "limits": limits})
    status, text, _ = run("plan", path, "--method", "stop-at-corners")
    assert status == 0
    assert text.splitlines()[2].startswith(line)


def test_a_refusal_has_no_peaks(run_json, tmp_path):
    path = problem_file(tmp_path, tube={"points": [[0.3, -0.3, 0], [9.0, 0, 0]], "radius": 0.03})
    status, fields = run_json("plan", path)
    assert status == 1
    assert (
        fields["peak_acceleration"] is fields["tool_speed"] is fields["tool_acceleration"] is None
    )


def test_a_planned_file_passes_check_and_a_faster_one_fails(run, run_json, tmp_path):
    good, fast = tmp_path / "good.json", tmp_path / "fast.json"
    run("plan", PROBLEM, "-o", good, "--slack", 0)
    status, out, _ = run("check", PROBLEM, good)
    assert status == 0
    assert "passes every condition" in out
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
    assert status == 1
    assert answer["status"] == "certificate_failed"
    assert answer["message"].startswith("the trajectory fails: effort: margin -0.004")
    assert set(answer) >= FIELDS
    assert answer["where"]["joint"] == "joint2"
    assert run("check", PROBLEM, fast, "--tolerance", "1e-6,0.01")[0] == 0


def test_an_infeasible_problem_is_an_answer(run, run_json, tmp_path):
    path = problem_file(tmp_path, tube={"points": [[0.3, -0.3, 0], [0.9, 0, 0]], "radius": 0.03})
    output = tmp_path / "t.json"
    output.write_text("precious")
    status, out, _ = run("plan", path, "-o", output)
    assert status == 1
    assert "unreachable: " in out
    assert output.read_text() == "precious"
    status, fields = run_json("plan", path)
    assert status == 1
    assert fields["status"] == "unreachable"
    assert fields["where"]["segment"] == 0
    assert fields["duration"] is None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plan", "example:ur5/over"], "unknown bundled problem 'ur5/over'"),
        (["plan", "nowhere.yaml"], "problem file nowhere.yaml does not exist"),
        (["plan", PROBLEM, "--method", "magic"], "unknown method 'magic'"),
        (["plan", PROBLEM, "--rate", "0"], "rate is 0 Hz; it must be > 0 and finite"),
        (["plan", PROBLEM, "--time-limit", "-1"], "time_limit is -1 s"),
        (["plan", PROBLEM, "-o", "/nowhere/t.json"], "the folder /nowhere does not exist"),
        (["plan", PROBLEM, "--plot", "x.jpg"], "name a file that ends in .png, .pdf or .svg"),
        (["plan", PROBLEM, "-o", "a", "--csv", "a"], "is the same file as a; choose another"),
        (["plan", PROBLEM, "--spped", "1"], "No such option"),
        (["plan"], "Missing argument 'PROBLEM'"),
        (["paln", PROBLEM], "No such command 'paln'"),
        (["check", PROBLEM, "nowhere.json"], "nowhere.json cannot be read: No such file"),
        (["check", PROBLEM, "x.json", "--tolerance", "small"], "'small' is not ABS or ABS,REL"),
    ],
)
def test_bad_input_is_named_and_exits_with_2(arguments, message, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*arguments)
    assert status == 2
    assert out == ""
    assert message in err
    status, out, _ = run(*arguments, "--json")
    assert status == 2
    fields = json.loads(out)
    assert fields["status"] == "bad_input"
    assert message in fields["message"]
    assert set(fields) >= FIELDS


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

    monkeypatch.setattr("tubeplanner.planning.plan_result.verify", interrupt)
    assert run("plan", PROBLEM)[0] == 130
    status, fields = run_json("plan", PROBLEM)
    assert status == 130
    assert fields["status"] == "interrupted"


def test_an_interrupt_while_a_certified_answer_is_written_loses_nothing(
    run_json, monkeypatch, tmp_path
):
    from tubeplanner.files import output_files

    write = output_files.write_files

    def interrupted_write(*contents):
        signal.raise_signal(signal.SIGINT)
        write(*contents)

    monkeypatch.setattr(output_files, "write_files", interrupted_write)
    path = tmp_path / "t.json"
    status, fields = run_json("plan", PROBLEM, "-o", path)
    assert status == 0
    assert fields["status"] == "success"
    assert fields["stopped_by"] == "interrupt"
    assert path.exists()


def test_an_interrupt_that_a_library_swallows_still_counts(run_json, monkeypatch):
    """trimesh catches everything while it imports; here, loading does."""
    from tubeplanner.cycle import problem_or_cycle

    load = problem_or_cycle.load_problem

    def swallowing_load(*names, **options):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return load(*names, **options)

    monkeypatch.setattr(problem_or_cycle, "load_problem", swallowing_load)
    status, fields = run_json("plan", PROBLEM)
    assert status == 130
    assert fields["status"] == "interrupted"


def test_what_an_interrupt_breaks_in_a_library_is_no_error(run_json, monkeypatch):
    def breaking_load(*names, **options):
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise TypeError("a half imported library")

    monkeypatch.setattr("tubeplanner.cycle.problem_or_cycle.load_problem", breaking_load)
    status, fields = run_json("plan", PROBLEM)
    assert status == 130
    assert fields["status"] == "interrupted"


def test_an_error_of_our_own_is_one_line_and_not_a_verdict(run_json, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("tubeplanner.planning.plan_result.verify", broken)
    status, fields = run_json("plan", PROBLEM)
    assert status == 2
    assert "internal error, please report it" in fields["message"]
    assert "ZeroDivisionError: oops" in fields["message"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("words", [("robots",), ("info", PROBLEM), ("info", PROBLEM, "--json")])
def test_a_full_disk_under_standard_output_is_no_error_of_ours(words):
    code = "import sys; from tubeplanner.commands.cli import main; sys.exit(main(sys.argv[1:]))"
    with Path("/dev/full").open("w") as full:
        ended = subprocess.run(
            [sys.executable, "-c", code, *words],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert ended.returncode != 0
    assert "standard output cannot be written: No space left on device" in ended.stderr
    assert "internal error" not in ended.stderr


def test_obstacles_that_nothing_can_meet_are_pointed_out(run, tmp_path):
    """asr_twodof has no collision geometry at all."""
    path = tmp_path / "problem.json"
    ball = {"name": "ball", "sphere": 0.1, "position": [0.5, 0.5, 0.5]}
    q = [0.3, 0.4]
    robot = load_robot("example:asr_twodof", "Tip")
    tool = robot.tool_position(np.array([q, [0.4, 0.4]]))
    fields = {
        "robot": {"urdf": "example:asr_twodof", "tool_frame": "Tip"},
        "tube": {"points": tool.tolist(), "radius": 0.2},
        "start": {"joints": q},
        "goal": {"joints": [0.4, 0.4]},
        "obstacles": [ball],
    }
    path.write_text(json.dumps(fields))
    status, out, _ = run("plan", path)
    assert status == 0
    assert "no collision geometry; the obstacles were NOT checked" in out


def test_a_name_is_printed_as_it_is(run, tmp_path):
    """Square brackets are markup to the library that draws the table."""
    ball = {"name": "b [red]x[/red]", "sphere": 0.01, "position": [0.3, 0, 0]}
    path = problem_file(tmp_path, obstacles=[ball])
    assert "b [red]x[/red]" in run("plan", path)[1]


def test_robots_and_schema_are_listed(run, run_json):
    status, out, _ = run("robots")
    assert status == 0
    assert "example:ur5/over_the_wall" in out
    assert "example:two_link  (bundled)" in out
    assert "  fr3  " in out
    assert str(bundled_presets()["fr3"]) in out
    listed = run_json("robots")[1]
    assert "example:ur5/through_the_door" in out
    assert "panda/between_shelves" in listed["problems"]
    assert "ur5/through_the_door" not in listed["problems"]
    assert "ur5/through_the_door" in listed["cycles"]
    assert "example:ur5/tolerance_and_payload" in out
    assert "ur5/tolerance_and_payload" not in listed["problems"]
    assert listed["studies"] == ["ur5/tolerance_and_payload"]
    assert "presets/fr3" not in listed["problems"]
    assert listed["presets"] == ["fer", "fr3", "fr3_friction", "ur10_friction"]
    schema = json.loads(run("schema")[1])
    assert set(schema["required"]) == {"robot", "start"}
    assert json.loads(run("schema", "--study")[1])["title"] == "tubeplanner study"
    assert json.loads(run("schema", "--cycle")[1])["title"] == "tubeplanner cycle"
    assert "either --cycle or --study" in run("schema", "--cycle", "--study")[2]


def test_help_names_every_command(run):
    status, out, _ = run("--help")
    assert status == 0
    for command in ("plan", "check", "robots", "schema"):
        assert command in out


def test_the_installed_command_runs():
    command = Path(sys.executable).parent / "tubeplanner"
    output = subprocess.run([command, "--version"], capture_output=True, text=True)
    assert output.returncode == 0
    assert output.stdout.startswith("tubeplanner ")
