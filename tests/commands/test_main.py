"""The lazy group of commands; one line for any error; robots, schema."""

import contextlib
import csv
import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from cases import slow_but
from tubeplanner import Place, PlanOptions, compare, load_problem, load_robot
from tubeplanner.baselines.baselines import BASELINES
from tubeplanner.planning.plan_options import METHODS
from tubeplanner.resources import bundled_presets, bundled_problems
from tubeplanner.suh_bishop.suh_bishop import SuhBishopOptions

# The command line as a user meets it: text, one JSON object, files, exit status.


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


# Robots out of the ordinary: every method, baseline and command has an answer or a reason.


POST = {"name": "post", "cylinder": [0.03, 0.5], "position": [-0.7, -0.7, 0]}


def link(name, size, at=0.15):
    """Return a link of 2 kg; without a size [m] it has no collision geometry."""
    inertia = '<inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>'
    origin, shape = f'<origin xyz="{at} 0 0"/>', ""
    if size is not None:
        shape = f'<collision>{origin}<geometry><box size="{size}"/></geometry></collision>'
    inertial = f'<inertial>{origin}<mass value="2"/>{inertia}</inertial>'
    return f'<link name="{name}">{inertial}{shape}</link>'


def joint(name, kind, parent, child, x, axis):
    limit = '<limit lower="-3" upper="3" effort="60" velocity="3"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="{axis}"/>{limit}</joint>'
    )


def turning(size, count):
    names = ["base", *(f"l{k}" for k in range(count))]
    joints = [
        joint(f"j{k}", "revolute", names[k], names[k + 1], 0.3 * (k > 0), "0 0 1")
        for k in range(count)
    ]
    hand = joint("fix", "fixed", names[-1], "hand", 0.3, "1 0 0")
    links = [link(name, size) for name in names[1:]]
    return "".join(['<link name="base"/>', *links, *joints, '<link name="hand"/>', hand])


def sliding(size):
    rails = joint("x", "prismatic", "base", "a", 0, "1 0 0")
    rails += joint("y", "prismatic", "a", "hand", 0, "0 1 0")
    return f'<link name="base"/>{link("a", size, 0)}{link("hand", size, 0)}{rails}'


ELBOW = [[0.2, 0.9], [0.6, 0.9], [1.0, 0.7]]
ROBOTS = {
    "no collision geometry": (turning(None, 2), ELBOW, [], True),
    "no collision geometry, an obstacle": (turning(None, 2), ELBOW, [POST], True),
    "a single joint": (turning("0.2 0.04 0.04", 1), [[0.0], [0.2], [0.4]], [POST], True),
    "sliding joints": (sliding("0.1 0.1 0.05"), [[0, 0], [0.4, 0], [0.4, 0.4]], [POST], True),
    "no self-collision": (turning("0.2 0.04 0.04", 2), ELBOW, [POST], False),
}


# Each robot meets the methods or the commands quickly; the other half is slow.
WITH_COMMANDS = ("no self-collision",)
WITH_METHODS = [name for name in ROBOTS if name not in WITH_COMMANDS]


@pytest.fixture
def path(request, tmp_path):
    """Return the file of a problem along the tool's way through three configurations."""
    parts, q, obstacles, self_collision = ROBOTS[request.param]
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{parts}</robot>')
    robot = load_robot("arm.urdf", "hand", directory=tmp_path)
    points = robot.tool_position(np.array(q, dtype=float)).round(6)
    fields = {
        "robot": {"urdf": "arm.urdf", "tool_frame": "hand"},
        "tube": {"points": points.tolist(), "radius": 0.05},
        "start": {"joints": q[0]},
        "goal": {"joints": q[-1]},
        "obstacles": obstacles,
        "collision": {"self": self_collision},
    }
    path = tmp_path / "p.json"
    path.write_text(json.dumps(fields))
    return path


@pytest.mark.parametrize("path", slow_but(WITH_METHODS, ROBOTS), indirect=True)
def test_every_method_and_baseline_has_an_answer(path):
    brief = SuhBishopOptions(node_budget=50)
    options = PlanOptions(quality="fast", node_budget=100, suh_bishop=brief, time_limit=20)
    compared = compare(load_problem(path), options=options)
    assert [row.method for row in compared.rows] == [*METHODS, *BASELINES]
    assert [row.message for row in compared.rows if "internal error" in row.message] == []
    assert all(row.trajectory is not None or row.message for row in compared.rows)
    assert compared.rows[0].certified


@pytest.mark.parametrize("path", slow_but(WITH_COMMANDS, ROBOTS), indirect=True)
def test_every_command_has_an_answer(path, run):
    folder = path.parent
    files = {f"--{name}": folder / f"t.{name}" for name in ("csv", "html")}
    files |= {"-o": folder / "t.json", "--ros": folder / "t.yaml", "--plot": folder / "t.png"}
    outputs = [word for pair in files.items() for word in pair]
    for arguments in (
        ("plan", path, "--quality", "fast", "--time-left", *outputs),
        ("check", path, folder / "t.csv"),
        ("check", path, folder / "t.yaml"),
        ("plot", path, folder / "t.json", "-o", folder / "p.png"),
        ("view", path, folder / "t.json", "--html", folder / "v.html"),
        ("sweep", path, "--radius", "0.04", "--quality", "fast"),
        ("measure", path, "--configurations"),
    ):
        status, out, err = run(*arguments)
        assert status == 0, err
        assert "internal error" not in out + err


# Files in a controller's periods: what was planned, sample by sample, judged as our own.


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
