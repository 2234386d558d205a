"""`info`: a robot, problem or cycle; the installation; `links`: how closely they are covered."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from arms import axle, opened

import tubeplanner
from tubeplanner.cli import info
from tubeplanner.cli.contents import task_text
from tubeplanner.cli.info import installation
from tubeplanner.native.library import LIBRARY
from tubeplanner.task.field_changes import parse_change
from tubeplanner.task.info import problem_info

BARE = """<robot name="bare"><link name="base"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/>
  <axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="0" velocity="2"/></joint>
<link name="arm"><inertial><origin xyz="0.2 0 0"/><mass value="1.5"/>
  <inertia ixx="0.1" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>
  <collision><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="slide" type="prismatic"><parent link="arm"/><child link="tip"/>
  <origin xyz="0.3 0 0"/><axis xyz="1 0 0"/></joint>
<link name="tip"/></robot>"""


@pytest.fixture
def bare(tmp_path):
    path = tmp_path / "bare.urdf"
    path.write_text(BARE)
    return path


def _json(run, *arguments):
    status, text, _ = run("info", *arguments, "--json")
    assert status == 0
    return json.loads(text)


def test_a_robot_without_limits_is_described(run, bare):
    robot = _json(run, bare)
    named = (robot["name"], robot["tool_frame"], robot["tool_frame_is_given"])
    assert named == ("bare", "tip", False)
    turn, slide = robot["joints"]
    assert turn["limits"]["position"] == {"value": [-1.0, 2.0], "source": "URDF"}
    assert turn["limits"]["velocity"] == {"value": 2.0, "source": "URDF"}
    assert turn["limits"]["effort"] == {"value": None, "source": "none"}
    assert slide["limits"]["position"] == {"value": None, "source": "none"}
    arm = robot["links"][1]
    assert (arm["collision"], arm["visual"]) == ({"box": 1, "sphere": 1}, {})
    assert (arm["mass"], robot["mass"], arm["is_leaf"]) == (1.5, 1.5, False)
    velocity, effort, position, mass = robot["missing"]
    assert "slide (the URDF has none)" in velocity and "turn" not in velocity
    assert "turn (the URDF has 0), slide" in effort and "robot.limits.effort" in effort
    assert "slide" in position and "robot.limits.position" in position
    assert "what slide moves" in mass and "<inertial>" in mass
    _, text, _ = run("info", bare)
    for words in ("bare: 2 joints to tip, the end", "-1 to 2", "box, sphere", "1.5 kg"):
        assert words in text
    assert "effort from: none" in text
    assert "velocity from: URDF (turn); none (slide)" in text
    assert "missing:\n  velocity limit of slide" in text


def test_another_tool_frame_is_chosen(run, bare):
    found = _json(run, bare, "--tool-frame", "arm")
    assert (found["tool_frame"], found["tool_frame_is_given"]) == ("arm", True)
    assert [joint["name"] for joint in found["joints"]] == ["turn"]
    assert found["other_joints"][0]["name"] == "slide"


def test_a_problem_has_start_tube_and_solids(run):
    found = _json(run, "example:ur5/every_field")
    task = found["task"]
    assert found["refused"] is None
    assert len(task["points"]) == len(task["segments"]) + 1
    assert (task["segments"][0]["radius"], task["start"]["kind"]) == (0.03, "joints")
    assert task["start"]["tool"] == pytest.approx([0.45, -0.3, 0.2], abs=1e-3)
    assert (task["payload"]["mass"], len(task["obstacles"])) == (5.0, 5)
    wall = next(each for each in task["obstacles"] if each["name"] == "wall")
    assert wall["size"] == pytest.approx([0.6, 0.05, 0.25])
    assert (len(wall["center"]), wall["shapes"]) == (3, 1)
    text = run("info", "example:ur5/every_field")[1]
    assert "obstacle wall: 0.6 x 0.05 x 0.25 m" in text
    assert "elbow_joint >= 0" in text
    assert "rotation within [0.0524, 0.0524, free]; " in run("info", "example:ur5/level_tray")[1]


def test_where_the_robot_stands_is_told(run):
    name = "example:two_link/around_a_post"
    robot = _json(run, name)
    assert (robot["root_link"], robot["base"]) == ("base", None)
    assert "stands at" not in run("info", name)[1]
    at = ("--set", "robot.base.position=[0.1, 0, 2]")
    turns = {
        "not turned": (),
        "rpy [0, 3.1, 0] rad": ("--set", "robot.base.rpy=[0, 3.1, 0]"),
        "quaternion [0, 0, 1, 0]": ("--set", "robot.base.quaternion=[0, 0, 1, 0]"),
    }
    for words, turn in turns.items():
        text = run("info", name, *at, *turn)[1]
        assert f"base: base stands at [0.1, 0, 2] m, {words}\n" in text
    base = _json(run, name, *at, *turns["rpy [0, 3.1, 0] rad"])["base"]
    assert base == {"position": [0.1, 0, 2], "rpy": [0, 3.1, 0], "quaternion": None}


def test_a_problem_that_does_not_load_is_described_and_says_why(run, bare):
    path = bare.parent / "p.yaml"
    path.write_text(
        "robot: {urdf: bare.urdf, tool_frame: tip, limits: {effort: {turn: 7}}}\n"
        "tube: {points: [[0.3, 0, 0], [0.4, 0, 0]], radius: 0.01}\nstart: {seed: [0, 0]}\n"
    )
    found = _json(run, path)
    assert found["task"] is None
    assert "joint 'slide' has position limits [0, 0]" in found["refused"]
    assert found["joints"][0]["limits"]["effort"] == {"value": 7.0, "source": "problem file"}
    assert "the problem does not load: " in run("info", path)[1]


DOUBTS = {
    "obstacles=[{name: wall, box: [300, 100, 200], position: [900, 0, 0]}]": [
        "size 300 m, 500 times the arm's reach (obstacle 'wall'), more than 50: millimetres?",
        "distance from the arm's base 750 m, 1,250 times the arm's reach (obstacle 'wall'), ",
    ],
    "obstacles=[{name: hall, box: [40, 40, 0.1], position: [0, 0, -3]}]": [],
    "obstacles=[{name: wall, sphere: 0.1, position: [0, 0, 3], rpy: [0, 0, 90]}]": [
        "rpy 90 rad (obstacles.wall.rpy), more than 6.3: degrees?"
    ],
    "robot.payload={mass: 0.1, com: [0, 0, 80]}": ["distance from the last link 80 m, 133 times"],
    "goal={position: [0.3, 0.5, 0], tolerance: 2}": [
        "the goal's ball holds the start: there the tool is 1000 mm from goal.position, and "
        "goal.tolerance is 2000 mm; no motion is needed"
    ],
    "goal={position: [0.3, 0.5, 0], tolerance: 0.1}": [],
}


@pytest.mark.parametrize(("change", "sentences"), DOUBTS.items())
def test_what_no_cell_has_is_questioned(change, sentences):
    field, value = parse_change("--set", change)
    notes = problem_info("example:two_link/paper_1_30mm", {field: value}).robot.notes
    assert len(notes) == len(sentences), notes
    for note, sentence in zip(notes, sentences, strict=True):
        assert note.startswith(sentence)


def test_changed_fields_count(run):
    change = "robot.limits.scale={velocity: 0.5}"
    problem = _json(run, "example:ur5/over_the_wall", "--set", change)
    assert problem["task"]["name"] == "ur5/over_the_wall"
    assert problem["joints"][0]["limits"]["velocity"] == {"value": 1.575, "source": "URDF x 0.5"}
    status, _, error = run("info", "example:ur5", "--set", "robot.urdf=x")
    assert status == 2 and "--set changes a problem file" in error


def test_states_and_pairs_of_an_srdf_are_listed(bare):
    (bare.parent / "bare.srdf").write_text(
        '<robot name="bare"><group_state name="home" group="g"><joint name="turn" value="0.5"/>'
        '</group_state><disable_collisions link1="base" link2="arm"/></robot>'
    )
    path = bare.parent / "p.yaml"
    path.write_text(
        "robot: {urdf: bare.urdf, srdf: bare.srdf, tool_frame: tip}\nstart: {seed: [0, 0]}"
    )
    info = problem_info(path)
    assert info.as_dict()["srdf"]["states"] == {"home": {"turn": 0.5}}
    text = task_text(info)
    assert "state home: turn 0.5" in text
    assert "1 pairs of links may touch" in text


def test_meshes_that_are_not_closed_are_named(run, tmp_path):
    axle(tmp_path)
    mesh = trimesh.load(tmp_path / "ring.stl")
    opened(mesh, "no top", tmp_path / "ring.stl")
    assert _json(run, tmp_path / "arm.urdf")["open_meshes"] == {"ring": {"ring.stl": 32}}
    _, text, _ = run("info", tmp_path / "arm.urdf")
    assert "their openings count as solid" in text
    assert "export them closed: ring (ring.stl, 32 edges)" in text
    (tmp_path / "ring.stl").write_bytes(b"solid")
    _, text, _ = run("info", tmp_path / "arm.urdf")
    assert "note: link 'ring': mesh" in text


def test_the_picture_is_a_png(run, bare):
    path = bare.parent / "arm.png"
    assert _json(run, bare, "--plot", path)["plot"] == str(path)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert run("info", bare, "--plot", bare.parent / "arm.jpg")[0] == 2


def rows(text):
    """Return the cells of the rows of all tables, by the first."""
    cells = ([cell.strip() for cell in line.split("│")[1:-1]] for line in text.splitlines())
    return {row[0]: row[1:] for row in cells if row}


def test_moves_rests_and_what_is_carried_are_told(run, cycle_path):
    status, text, _ = run("info", cycle_path)
    assert status == 0
    assert "4 moves in 3 legs (each without a stop); ends where it begins" in text
    table = rows(text)
    assert table["beside"] == ["1", "0.35 m", "in any configuration", "0.5 kg, part"]
    assert table["back"] == ["1", "0.7906 m", "as the cycle begins", "nothing"]
    assert "at rest: gripper 'open' (0.06 s), detach part" in table
    _, text, _ = run("info", cycle_path, "--set", "closed=false")
    assert rows(text)["back"][2] == "in any configuration"


def test_what_does_not_load_is_told_with_the_reason(run, run_json, cycle_path):
    words = ("info", cycle_path, "--set", "period=0.004")
    status, text, _ = run(*words)
    assert status == 0
    assert text.rstrip().endswith("no multiple of the period, 0.004 s; give 0.048 or 0.052")
    _, answer = run_json(*words)
    assert answer["cycle"] is None
    assert "dwell is 0.05 s" in answer["refused"]


def test_links_are_listed_with_what_their_covers_stand_off(run, run_json):
    status, report = run_json("links", "example:two_link/around_a_post")
    assert (status, report["status"]) == (0, "success")
    assert {"link", "shapes", "outer_error", "closer_shapes", "closer_error"} == {
        *report["links"][0]
    }
    assert all(each["outer_error"] >= 0 for each in report["links"])
    reasons = {pair["reason"] for pair in report["left_out"]}
    assert reasons <= {"neighbours", "always touching", "ignored"}
    text = run("links", "example:two_link/around_a_post")[1]
    assert all(each["link"] in text for each in report["links"])


@pytest.mark.dear("reads the meshes of an arm")
def test_meshes_are_measured(run_json):
    listed = run_json("links", "example:ur5/over_the_wall")[1]["links"]
    assert any(each["outer_error"] > 1e-3 for each in listed)


# ---- Without an argument: the installation.


def test_the_installation_is_described(run, run_json, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("TUBEPLANNER_CACHE", str(tmp_path / "covers"))
    monkeypatch.setenv("TUBEPLANNER_PURE", "")
    monkeypatch.setattr(info, "REQUIREMENTS", {"simulate": "no-such-thing>=3"})
    status, fields = run_json("info")
    assert (status, fields["status"]) == (0, "success")
    page = (Path(__file__).parents[2] / "docs/reference/json_output.md").read_text()
    assert all(f"`{key}`" in page for key in fields)
    assert (fields["version"], fields["build"]) == (tubeplanner.__version__, LIBRARY.build)
    assert fields["cache"] == fields["environment"]["TUBEPLANNER_CACHE"] == "~/covers"
    assert fields["required"]["numpy"] == np.__version__
    assert fields["optional"] == {"no-such-thing": None}
    text = run("info")[1]
    assert str(tmp_path) not in text
    assert "optional: no-such-thing not found" in text
    assert text.splitlines()[0] == f"tubeplanner {tubeplanner.__version__}, {LIBRARY.build}"


def test_an_installed_package_names_its_requirements_as_the_checkout_does(monkeypatch, tmp_path):
    in_checkout = installation()["required"]
    assert "ruamel-yaml" in in_checkout
    lines = [*reversed(in_checkout), "ezdxf>=1.3; extra == 'dxf'", "drake>=1.51 ; extra == 'bench'"]
    monkeypatch.setattr("importlib.metadata.requires", lambda name: lines)
    monkeypatch.setattr(info, "_PROJECT", tmp_path / "pyproject.toml")
    assert installation()["required"] == in_checkout


@pytest.mark.parametrize(
    "option", ["--tool-frame a", "--package-dir a", "--xacro-arg a=1", "--plot a.png", "--set a=1"]
)
def test_the_installation_has_no_options_of_a_robot(run, option):
    status, _, error = run("info", *option.split())
    assert status == 2
    assert f"{option.split()[0]} is for a robot or a problem; name one" in error
