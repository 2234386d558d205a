"""Common to commands: options, exit status, progress, output, written answers, workers."""

import json
import signal
from contextlib import suppress

import click
import numpy as np
import pytest
from stored_trajectories import REFINEMENT, stored_path

import tubeplanner
from tubeplanner import PlanOptions, load_problem, plan
from tubeplanner.cli import sweep as study_commands
from tubeplanner.cli.console import AnswerFiles, Output, printable, workers_of, write_answer
from tubeplanner.cli.interrupts import interrupts_remembered
from tubeplanner.cli.main import cli
from tubeplanner.documents import parse_yaml
from tubeplanner.errors import OptionError
from tubeplanner.native import library
from tubeplanner.native.library import LIBRARY, NativeLibrary
from tubeplanner.resources import bundled_problems
from tubeplanner.studies.worker_processes import WorkerProcesses

LINE, POST = "example:two_link/paper_1_30mm", "example:two_link/around_a_post"
STOPS = ("--method", "stop-at-corners")
EVIL = "a\x1b[31mred\n\x9b31m FAKE: passes\u202e"
TAKES_NO_PROBLEM = {"study", "robots", "schema", "reproduce", "init"}
MOTION = stored_path("two_link/around_a_post", REFINEMENT)


def test_a_message_is_one_printable_line():
    assert printable("a 'b' \u00e4\u95a2") == "a 'b' \u00e4\u95a2"
    assert printable(EVIL) == "a\\x1b[31mred\\n\\x9b31m FAKE: passes\\u202e"
    assert len(printable("x" * 10**6)) < 6000


def test_names_of_a_trajectory_cannot_speak_for_the_program(run, run_json, tmp_path):
    path = tmp_path / "t.json"
    fields = {"format": "tubeplanner/trajectory", "version": 1, "joint_names": [EVIL, "b"]}
    fields |= {"breakpoints": [0, 1.0], "coefficients": [[[0.1, 0.2]]]}
    path.write_text(json.dumps(fields))
    for text in (
        run("check", POST, path)[2].rstrip("\n"),
        run_json("check", POST, path)[1]["message"],
    ):
        assert text.isprintable()
        assert "rename it" in text


@pytest.fixture(scope="module")
def narrow_motion(tmp_path_factory):
    """The motion of a hand in a tube of half the width, from another command's answer."""
    path = tmp_path_factory.mktemp("planned") / "t.json"
    arguments = ["plan", LINE, *STOPS, "--set", "tube.radius=x0.5", "-o", str(path)]
    assert cli.main(arguments, "tubeplanner", standalone_mode=False) == 0
    return path


def test_every_command_that_takes_a_problem_takes_changes():
    taking = {
        name
        for name, command in cli.commands.items()
        if any("--set" in parameter.opts for parameter in command.params)
    }
    assert taking == cli.commands.keys() - TAKES_NO_PROBLEM


@pytest.mark.parametrize("name", ["plan", "check", "plot", "view", "sweep", "compare", "measure"])
def test_a_typo_is_bad_input_everywhere(name, run, narrow_motion, tmp_path):
    more = {
        "check": (narrow_motion,),
        "plot": (narrow_motion, "-o", tmp_path / "t.png"),
        "view": (narrow_motion, "--html", tmp_path / "t.html"),
        "sweep": ("--radius", "0.01"),
    }
    status, _, err = run(name, LINE, *more.get(name, ()), "--set", "tube.raduis=0.01")
    assert status == 2
    assert "tube.raduis: unknown key 'raduis' (did you mean 'radius'?); there is:" in err
    assert list(tmp_path.iterdir()) == []


def test_links_and_route_are_of_the_changed_problem(run):
    left_out = []
    for words in ((), ("--set", "collision.ignore=[[link1, post]]")):
        status, out, _ = run("links", POST, *words, "--json")
        assert status == 0
        left_out.append({tuple(sorted(pair["links"])) for pair in json.loads(out)["left_out"]})
    assert left_out[1] - left_out[0] == {("link1", "post")}
    ends = ("--set", "start={joints: [0, 0, 0]}", "--set", "goal={joints: [0, 0]}")
    status, _, err = run("route", POST, *ends)
    assert status == 2 and "start has 3" in err
    status, _, err = run("route", POST, "--set", "tube.radius=1")
    assert status == 2 and "--set tube.radius: route gives tube; leave it out" in err


def test_plan_and_check_agree_on_the_changed_problem(run, narrow_motion):
    change = ("--set", "tube.radius=x0.5")
    status, out, _ = run("check", LINE, narrow_motion, *change)
    assert status == 0 and "another problem" not in out
    status, out, _ = run("check", LINE, narrow_motion, "--set", "robot.payload.mass=50")
    assert status == 1 and "effort" in out


def test_changes_add_up_and_each_is_given_once(run):
    words = ("--set", "robot.payload.mass=2", "--set", "tube.radius=0.02", *STOPS)
    status, out, _ = run("plan", LINE, *words, "--json")
    both = {"robot.payload.mass": 2, "tube.radius": 0.02}
    assert status == 0
    expected = plan(load_problem(LINE, changes=both), PlanOptions("stop-at-corners"))
    assert json.loads(out)["duration"] == expected.duration
    status, _, err = run("plan", LINE, "--set", "tube.radius=1", "--set", "tube.radius=2")
    assert status == 2 and "--set tube.radius is given twice; give it once" in err


@pytest.mark.dear("plans and smooths")
def test_an_objective_that_would_count_for_nothing_is_refused(run):
    change = ("--set", "objective.slack=0.1")
    for words in (
        ("sweep", LINE, "--radius", "0.01"),
        ("sweep", LINE, "--vary", "tube.radius=0.01"),
        ("compare", LINE),
    ):
        status, _, err = run(*words, *change)
        assert status == 2
        assert "--set objective.slack: without --slack the shortest motions are planned" in err
    smooth = ("--set", "objective.minimise=smoothness", "--quality", "fast")
    assert run("sweep", LINE, "--radius", "0.03", "--slack", "0.02", *smooth)[0] == 0


def test_measure_writes_the_changed_file(run, tmp_path):
    source, target = bundled_problems()["two_link/around_a_post"], tmp_path / "m.yaml"
    words = ["obstacles.post.position=[0.4, 0.25, 0]", "robot.payload.mass=2", "clearance=0.01"]
    changes = [word for text in words for word in ("--set", text)]
    status, _, err = run("measure", POST, "-o", target, "--max-radius", "0.01", *changes)
    assert (status, err) == (0, "")
    text = target.read_text()
    assert source.read_text().splitlines()[0] in text
    assert "{name: post, cylinder: [0.03, 0.3], position: [0.4, 0.25, 0]}" in text
    assert parse_yaml(text)["robot"]["payload"] == {"mass": 2}
    assert load_problem(target).clearance == 0.01


@pytest.mark.dear("looks for a route and measures it")
def test_route_writes_the_changed_file(run, tmp_path):
    fields = {
        "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
        "start": {"joints": [0.3, 0.5]},
        "goal": {"joints": [0.6, 0.8]},
    }
    source, target = tmp_path / "cell.json", tmp_path / "tube.json"
    source.write_text(json.dumps(fields))
    words = ("--edges", "400", "--samples", "200", "--max-radius", "0.05")
    changes = ("--set", "robot.payload.mass=2", "--set", "goal.joints.0=0.7")
    status, _, err = run("route", source, "-o", target, *words, *changes)
    assert (status, err) == (0, "")
    written = json.loads(target.read_text())
    assert written["robot"]["payload"] == {"mass": 2}
    assert written["goal"]["joints"] == [0.7, 0.8]
    np.testing.assert_allclose(load_problem(target).goal, [0.7, 0.8])


def test_teach_changes_the_cell_alone(run, tmp_path):
    trail = tmp_path / "trail.csv"
    rows = ["time,joint1.position,joint2.position"]
    rows += [f"{0.1 * k},{-0.1 - 0.01 * k},{-1 - 0.02 * k}" for k in range(20)]
    trail.write_text("\n".join(rows) + "\n")
    words = ("teach", trail, "--problem", POST)
    status, _, err = run(*words, "--set", "tube.radius=1")
    assert status == 2
    assert "--set tube.radius: TRAIL gives tube, start, goal; leave it out" in err
    given = ("--urdf", "example:two_link", "--tool-frame", "hand")
    status, _, err = run("teach", trail, *given, "--set", "clearance=1")
    assert status == 2 and "--set changes the file of --problem; give one" in err
    status, out, _ = run(*words, "--set", "clearance=5", "--json")
    assert status == 1
    assert json.loads(out)["where"]["obstacle"] == "post"


def test_a_file_that_cannot_be_written_costs_no_other(tmp_path):
    paths = {name: tmp_path / name for name in ("first", "second", "third")}
    paths["second"] = tmp_path / "missing" / "second"
    files, order = AnswerFiles(), []

    def content(path):
        order.append(path.name)
        return b"new"

    with click.Context(cli, obj=files):
        write_answer(*(Output("table", path, content) for path in paths.values()))
    assert order == list(paths)
    assert list(files.written) == [paths["first"], paths["third"]]
    assert [path.read_bytes() for path in files.written] == [b"new", b"new"]
    assert "the folder" in files.failures[paths["second"]]
    assert files.message.endswith(f"; saved: table {paths['first']}, table {paths['third']}")


def test_from_the_writing_on_an_interrupt_ends_nothing(tmp_path):
    with interrupts_remembered():
        write_answer(Output("table", tmp_path / "a", lambda _: b"new"))
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
    assert (tmp_path / "a").read_bytes() == b"new"


@pytest.mark.parametrize(
    ("words", "spoiled"),
    [
        ("view {motion} --html", "tubeplanner.output.page.viewer.page_html"),
        ("info --plot", "tubeplanner.cli.contents.figure_file"),
    ],
)
def test_what_a_library_drew_that_swallowed_an_interrupt_is_not_written(
    run, tmp_path, monkeypatch, words, spoiled
):
    def draw(*_):
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return "half a page" if "page" in spoiled else b"half a figure"

    monkeypatch.setattr(spoiled, draw)
    command, *more = words.format(motion=MOTION).split()
    path = tmp_path / ("a.html" if "page" in spoiled else "a.png")
    path.write_text("precious")
    assert run(command, POST, *more, path)[0] == 130
    assert path.read_text() == "precious"


def test_an_answer_is_drawn_and_written_whole(run, tmp_path, monkeypatch):
    real = study_commands.plot_sweep

    def draw(result):
        signal.raise_signal(signal.SIGTERM)
        return real(result)

    monkeypatch.setattr(study_commands, "plot_sweep", draw)
    table, figure = tmp_path / "a.csv", tmp_path / "a.png"
    options = ("--radius-scale", "1", "--quality", "fast", "-o", table, "--plot", figure)
    assert run("sweep", LINE, *options)[0] == 0
    assert table.exists()
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_this_machine_plans_in_as_many_processes_as_asked_or_a_cluster_in_its_own():
    with workers_of(3) as workers:
        assert isinstance(workers, WorkerProcesses) and workers.count == 3
    both = workers_of(2, "tcp://127.0.0.1:1")
    with pytest.raises(OptionError, match="--processes is for this machine, --scheduler for a"):
        both.__enter__()


def test_a_study_may_be_planned_by_a_cluster(run, here, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    study, address = "example:ur5/tolerance_and_payload", "tcp://127.0.0.1:1"
    monkeypatch.setattr("tubeplanner.cli.study.run_study", interrupted)
    assert run("study", study, "--scheduler", address)[0] == 130
    assert here == [(None, address)]


def test_the_version_names_the_build(run, monkeypatch):
    for build in ("native (c++, baseline)", "pure Python (for a test)"):
        monkeypatch.setattr(library, "LIBRARY", NativeLibrary(None, build))
        assert run("--version") == (0, f"tubeplanner {tubeplanner.__version__}, {build}\n", "")


def test_plan_and_check_name_the_build_and_files_do_not(run_json, tmp_path):
    path = tmp_path / "t.json"
    assert run_json("plan", POST, *STOPS, "-o", path)[1]["build"] == LIBRARY.build
    assert run_json("check", POST, path)[1]["build"] == LIBRARY.build
    assert "build" not in json.loads(path.read_text())
