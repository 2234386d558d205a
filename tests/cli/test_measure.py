"""`measure` as a user meets it, and the problem file that it writes."""

import json
import shutil
from pathlib import Path

import pytest

from tubeplanner import Tube, load_problem
from tubeplanner.output.files.problem_file import with_other_tube
from tubeplanner.resources import bundled_robots

PROBLEM = """\
# Past a post, by a robot that lies beside this folder.
robot:
  urdf: ../arm/two_link.urdf   # ours
  tool_frame: hand
  gravity: [0, 0, 0]
  limits: {velocity: {joint1: .inf, joint2: .inf}}
tube:
  points: [[0.45, -0.3, 0], [0.45, 0.1, 0]]  # straight
  radius: 0.01  # by guess
start: {seed: [0.0, -1.0]}
obstacles:
  - {name: post, cylinder: [0.03, 0.3], position: [0.4, 0.22, 0]}
"""


@pytest.fixture
def problem(tmp_path):
    for folder in ("arm", "cell", "elsewhere"):
        (tmp_path / folder).mkdir()
    shutil.copy(bundled_robots()["two_link"], tmp_path / "arm" / "two_link.urdf")
    path = tmp_path / "cell" / "problem.yaml"
    path.write_text(PROBLEM)
    return path


@pytest.mark.dear("measures and plans")
def test_measure_writes_a_file_that_plans(problem, run, tmp_path):
    target = tmp_path / "elsewhere" / "measured.yaml"
    status, out, err = run("measure", problem, "-o", target)
    assert (status, err) == (0, "")
    for words in ("radius", "link2, to 'post', tool at [", "no collision", f"problem: {target}"):
        assert words in out
    text = target.read_text()
    for comment in ("# Past a post, by a robot", "# ours", "# straight", "# by guess"):
        assert comment in text
    assert 'joint_signs: {joint2: "-"}' in text.replace("'", '"')
    measured = load_problem(target)
    assert 0.04 < measured.tube.radius[0] < 0.0481
    assert run("plan", target, "--method", "stop-at-corners")[0] == 0


def test_measure_as_json(problem, run_json):
    status, fields = run_json("measure", problem, "--max-radius", 0.02, "--seed", 3)
    assert (status, fields["status"]) == (0, "success")
    (segment,) = fields["segments"]
    assert (segment["radius"], segment["bindings"]) == (0.02, [])
    assert segment["joint_ranges"] == {"joint2": [None, 0.0]}


def test_a_blocked_line_is_refused_with_links_and_place(problem, run_json):
    problem.write_text(PROBLEM.replace("[0.4, 0.22, 0]", "[0.45, 0, 0]"))
    target = problem.with_name("out.yaml")
    status, fields = run_json("measure", problem, "-o", target)
    assert (status, fields["status"]) == (1, "tube_blocked")
    assert (fields["where"]["links"], fields["where"]["obstacle"]) == (["link2"], "post")
    assert not target.exists()


def test_configurations_tell_elbow_up_from_elbow_down(problem, run, run_json):
    status, fields = run_json("measure", problem, "--configurations")
    assert status == 0
    rows = {row["signs"]["joint2"]: row for row in fields["configurations"]}
    assert rows["+"]["reachable"]
    assert rows["-"]["free"]
    assert fields["suggested"]["joint2"] in "+-"
    _, out, _ = run("measure", problem, "--configurations")
    assert "suggested joint_signs: {joint2:" in out


def test_relative_paths_and_signs_survive(problem, tmp_path):
    target = tmp_path / "elsewhere" / "p.json"
    ranges = [{"joint1": (-0.5, 1.0), "joint2": (-float("inf"), 0.0)}]
    tube = Tube(load_problem(problem).tube.points, 0.02, joint_signs=ranges)
    fields = json.loads(with_other_tube(problem, target, tube))
    assert Path(fields["robot"]["urdf"]) == Path("../arm/two_link.urdf")
    assert fields["tube"]["radius"] == [0.02]
    assert fields["tube"]["joint_signs"] == {"joint1": [-0.5, 1.0], "joint2": "-"}
