"""Rewritten problem files with included ones: they keep them and plan the same, from anywhere."""

import json
import shutil

import numpy as np
import pytest

from tubeplanner import JointTrajectory, Tube, load_problem, parse_problem
from tubeplanner.documents import parse_yaml
from tubeplanner.files.fingerprint import problem_hash
from tubeplanner.files.problem_file import read_fields, with_other_tube, with_problem
from tubeplanner.files.taught_problem import read_cell
from tubeplanner.problem.problem_layers import ProblemLayers
from tubeplanner.resources import bundled_folder

CELL = """\
robot:
  urdf: arms/two_link.urdf  # ours
  tool_frame: hand
  gravity: [0, 0, 0]
  package_dirs: [packages]
  srdf: arms/arm.srdf
  limits_file: limits.yaml
  preset: [presets/mine.yaml]
  attached:
    - {name: tool, mesh: part.stl, scale: 0.1, position: [0, 0, 0.2]}
tube:
  tool_radius: 0.001
  joint_signs: {joint1: "+", joint2: "+"}
obstacles:
  - {name: part, mesh: part.stl, position: [5, 5, 0]}
  - {name: bin, mesh: package://parts/bin.stl, position: [5, 0, 0]}
"""
MAIN = """\
# Two of them share a cell.
include: cells/cell.yaml
tube:
  points: path.csv  # recorded
start: {trajectory: last.json}
obstacles:
  - {name: part, position: [5, 6, 0]}  # moved
"""
POINTS = [[0.3 + 0.3 * np.cos(1), 0.3 * np.sin(1), 0], [0.4, 0.4, 0]]
PRESET = {
    "format": "tubeplanner/preset",
    "joints": 2,
    "limits": {"jerk": 500},
    "sources": {"limits.jerk": "controller"},
}
SRDF = '<robot name="a"><disable_collisions link1="base" link2="link2"/></robot>'


@pytest.fixture
def folder(tmp_path):
    cells = tmp_path / "cells"
    for name in ("arms", "presets", "packages/parts"):
        (cells / name).mkdir(parents=True)
    (tmp_path / "elsewhere" / "deep").mkdir(parents=True)
    shutil.copy(bundled_folder() / "two_link" / "two_link.urdf", cells / "arms")
    shutil.copy(bundled_folder() / "ur5" / "part.stl", cells)
    shutil.copy(bundled_folder() / "ur5" / "part.stl", cells / "packages" / "parts" / "bin.stl")
    (cells / "presets" / "mine.yaml").write_text(json.dumps(PRESET))
    (cells / "limits.yaml").write_text("joint_limits: {joint1: {max_velocity: 2}}")
    (cells / "arms" / "arm.srdf").write_text(SRDF)
    (cells / "cell.yaml").write_text(CELL)
    (tmp_path / "main.yaml").write_text(MAIN)
    last = JointTrajectory(["joint1", "joint2"], [0, 1], [[[0.0, 0.0]], [[0.0, 1.0]]])
    last.save(tmp_path / "last.json")
    rows = [",".join(map(str, [*point, 0.1])) for point in POINTS]
    (tmp_path / "path.csv").write_text("\n".join(rows))
    return tmp_path


def written(folder, name, contents, monkeypatch):
    """Return the problem of a file written, loaded from elsewhere by a relative name."""
    (folder / name).write_bytes(contents)
    monkeypatch.chdir(folder / "elsewhere")
    return load_problem(f"../{name}")


def test_a_problem_with_included_files_is_the_merged_one(folder):
    problem = load_problem(folder / "main.yaml")
    merged = ProblemLayers.read(folder / "main.yaml").merged
    (folder / "one.json").write_text(json.dumps(merged))
    assert problem_hash(load_problem(folder / "one.json")) == problem_hash(problem)
    taken = parse_problem(parse_yaml(MAIN), folder)
    assert problem_hash(taken) == problem_hash(problem)
    assert problem.robot.limits.jerk.tolist() == [500, 500]
    assert problem.robot.limits.velocity[0] == 2
    assert ("base", "link2") in problem.ignore_collisions
    assert [solid.name for solid in problem.obstacles] == ["part", "bin"]


@pytest.mark.parametrize("name", ["new.yaml", "elsewhere/new.yaml", "elsewhere/deep/new.json"])
@pytest.mark.parametrize("source", ["main.yaml", "alone.yaml"])
def test_every_path_is_found_from_another_folder(folder, source, name, monkeypatch):
    alone = parse_yaml(CELL) | {"start": {"trajectory": "../last.json"}}
    alone["tube"] |= {"points": "../path.csv"}
    (folder / "cells" / "alone.yaml").write_text(json.dumps(alone))
    path = folder / ("cells" if source == "alone.yaml" else "") / source
    problem = load_problem(path)
    tube = problem.tube.scaled(0.5)
    read = written(folder, name, with_other_tube(path, folder / name, tube), monkeypatch)
    assert problem_hash(read) == problem_hash(problem.with_tube(tube))


def test_a_measured_tube_changes_only_the_tube_of_the_file(folder):
    tube = load_problem(folder / "main.yaml").tube.scaled(0.5)
    target = folder / "elsewhere" / "new.yaml"
    text = with_other_tube(folder / "main.yaml", target, tube).decode()
    assert text.startswith("# Two of them share a cell.\ninclude: ../cells/cell.yaml\n")
    assert "{name: part, position: [5, 6, 0]}" in text
    assert "# moved" in text
    assert list(parse_yaml(text)) == ["include", "tube", "start", "obstacles"]


@pytest.mark.parametrize("signs", [{"joint2": "+"}, {}, {"joint1": "0"}])
def test_signs_of_the_cell_do_not_come_back(folder, signs, monkeypatch):
    problem = load_problem(folder / "main.yaml")
    tube = Tube(POINTS, 0.05, joint_signs=signs)
    contents = with_other_tube(folder / "main.yaml", folder / "new.yaml", tube)
    read = written(folder, "new.yaml", contents, monkeypatch)
    names = problem.robot.joint_names
    np.testing.assert_array_equal(read.tube.ranges_of(names), tube.ranges_of(names))


def test_a_box_of_the_cell_does_not_come_back(folder, monkeypatch):
    cell = folder / "cells" / "cell.yaml"
    box = "{box: [0.1, 0.1], up: [0, 0, 1]}"
    cell.write_text(CELL.replace("tool_radius: 0.001", f"cross_section: {box}"))
    contents = with_other_tube(folder / "main.yaml", folder / "new.yaml", Tube(POINTS, 0.05))
    assert not written(folder, "new.yaml", contents, monkeypatch).tube.is_box.any()


def test_a_route_stands_above_the_tube_and_ends_of_the_cell(folder, monkeypatch):
    """All of the cell's tube that the found one has not, and a seed, go back to defaults."""
    cell = folder / "cells" / "cell.yaml"
    cell.write_text(CELL + "goal: {seed: [0, 1]}\n")
    problem = load_problem(folder / "main.yaml")
    found = problem.with_tube(Tube(POINTS, [0.1]), np.array([0.5, 0.5]))
    found = found.with_tube(Tube([POINTS[0], found.robot.tool_position(found.goal[None])[0]], 0.1))
    fields = read_fields(folder / "main.yaml")
    contents = with_problem(fields, folder, folder / "new.yaml", found)
    assert parse_yaml(contents.decode())["start"] == {"joints": [0.0, 1.0]}
    read = written(folder, "new.yaml", contents, monkeypatch)
    assert problem_hash(read) == problem_hash(found)
    assert read.tube.tool_radius == 0


@pytest.mark.parametrize("text", ["include: main.yaml\nstart: {joints: [0, 1]}\n", "{}\n"])
def test_a_tube_stands_where_a_reader_expects_it_though_the_robot_is_included(folder, text):
    found = load_problem(folder / "main.yaml")
    found = found.with_tube(Tube(POINTS, 0.4), found.start)
    (folder / "short.yaml").write_text(text)
    fields = read_fields(folder / "short.yaml")
    contents = with_problem(fields, folder, folder / "new.yaml", found).decode()
    order = ["include", "tube", "start", "goal"]
    assert list(parse_yaml(contents)) == [key for key in order if f"{key}:" in contents]


@pytest.mark.parametrize(
    "changes", [{"obstacles.bin.position": [5, 1, 0]}, {"robot.gravity.2": -1}]
)
def test_changes_are_written_above_what_is_included(folder, changes, monkeypatch):
    problem = load_problem(folder / "main.yaml", changes=changes)
    contents = with_other_tube(folder / "main.yaml", folder / "n.yaml", problem.tube, changes)
    assert problem_hash(written(folder, "n.yaml", contents, monkeypatch)) == problem_hash(problem)
    assert parse_yaml((folder / "cells" / "cell.yaml").read_text()) == parse_yaml(CELL)


def test_a_trails_cell_has_what_is_included_but_no_tube(folder):
    cell = read_cell(None, None, None, str(folder / "main.yaml"))
    assert cell.fields["include"] == "cells/cell.yaml"
    assert not {"tube", "start", "goal"} & (cell.fields.keys() | cell.known.keys())
    assert cell.known["robot"]["urdf"] == "cells/arms/two_link.urdf"


def test_obstacles_of_a_file_are_those_with_its_included_ones(folder, monkeypatch):
    monkeypatch.chdir(folder / "elsewhere")
    cell = read_cell("example:ur5", "tool0", folder / "main.yaml", None)
    meshes = [solid["mesh"] for solid in cell.fields["obstacles"]]
    assert meshes == ["../cells/part.stl", "package://parts/bin.stl"]
