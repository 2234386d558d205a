"""The public benchmark, on a made-up download of two problems of a small arm."""

import json
import shutil
import sys
import tarfile
from contextlib import ExitStack

import pytest

import motion_bench_maker as benchmark
from journals import recorded
from motion_bench_problems import Options, problem_of
from outside_judge import main as judge
from tubeplanner.resources import bundled_robots

SRDF = '<robot name="two_link"><group name="arm"><chain base_link="base" tip_link="hand"/></group>'
SRDF += "</robot>"
# The post of the second scene is where the goal is.
POSTS = {"0001": [-0.45, -0.2, 0.0], "0002": [-0.36, 0.27, 0.0]}


def state(*joints):
    return {"name": ["joint1", "joint2"], "position": list(joints)}


@pytest.fixture(scope="module")
def download(tmp_path_factory):
    """Return a folder like that of the public download, with problems in an archive."""
    folder = tmp_path_factory.mktemp("download")
    (folder / "panda").mkdir()
    shutil.copy(bundled_robots()["two_link"], folder / "panda" / "panda.urdf")
    (folder / "panda" / "panda.srdf").write_text(SRDF)
    problems = folder / "problems" / "box_panda"
    problems.mkdir(parents=True)
    for number, position in POSTS.items():
        goal = [{"joint_name": "joint1", "position": 2.5}, {"joint_name": "joint2", "position": 0}]
        request = {"group_name": "arm", "start_state": {"joint_state": state(-0.6, 0.3)}}
        request["goal_constraints"] = [{"joint_constraints": goal}]
        post = {"id": "post", "primitives": [{"type": "cylinder", "dimensions": [0.4, 0.03]}]}
        post["primitive_poses"] = [{"position": position}]
        scene = {"world": {"collision_objects": [post]}}
        (problems / f"request{number}.yaml").write_text(json.dumps(request))
        (problems / f"scene{number}.yaml").write_text(json.dumps(scene))
    with tarfile.open(folder / "panda" / "problems.tar.bz2", "w:bz2") as archive:
        archive.add(folder / "problems", "problems")
    shutil.rmtree(folder / "problems")
    return folder


@pytest.fixture
def run(download, monkeypatch, capsys):
    """Return a function from arguments to the exit status and what is printed."""

    def call(*arguments, folder=download):
        words = [folder, "--robot", "panda"] if folder else []
        monkeypatch.setattr(sys, "argv", ["it", *map(str, (*words, *arguments))])
        status = benchmark.main()
        return status, capsys.readouterr().out

    return call


@pytest.mark.dear("finds a motion, which the outside judge sees")
def test_a_problem_has_its_line_and_files_that_the_outside_judge_passes(run, tmp_path):
    journal, kept = tmp_path / "j.jsonl", tmp_path / "kept"
    status, said = run("--journal", journal, "--keep", kept, "--processes", 2)
    first, second = sorted(recorded(journal, "problem"), key=lambda line: line["number"])
    assert (first["status"], first["certified"]) == ("success", True)
    assert first["bound"] <= first["duration"] <= first["first_duration"]
    assert 0 < first["first"] <= first["total"]
    assert second["status"] == "tube_blocked"
    assert status == 1
    assert "| box | 2 | 1 | 1 |" in said
    assert "- 1: tube_blocked: " in said
    assert "(panda/box/0002)" in said
    again = run("--journal", journal)[1]
    assert again.startswith("### panda, goals as joints")  # nothing was planned again
    assert run("--report", journal, folder=None) == (1, again)
    files = [
        kept / "goals_as_joints/panda/box" / f"0001{end}" for end in (".json", ".trajectory.json")
    ]
    assert judge([*map(str, files)]) == 0


def test_options_change_the_problem_by_what_they_say(download):
    with ExitStack() as stack:
        source = download / "panda"
        folders = {"panda": (source, benchmark.unpacked(source, stack))}
        options = Options(folders, poses=True, carry=0.1, shrink=0.2)
        fields, problem = problem_of("panda/box/0001", options)
    assert problem.robot.payload.mass == 0.1
    assert fields["robot"]["limits"] == {"acceleration": 15, "jerk": 500, "position_margin": 0.2}
    q = problem.robot.limits.upper_position
    assert q[1] == pytest.approx(3.141592653589793 - 0.2)
    assert problem.endpoints[1].pose is not None
    assert "0.1 kg at the tool, position limits 0.2 rad narrower" in options.variant
