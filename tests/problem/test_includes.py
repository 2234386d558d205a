"""Included files: a problem as layers, merged fields, relative paths."""

import copy
import json
from pathlib import Path

import pytest

from tubeplanner.errors import ProblemError
from tubeplanner.problem.merged_fields import merged_fields
from tubeplanner.problem.path_fields import move_paths
from tubeplanner.problem.problem_fields import changed_problem, read_problem_fields
from tubeplanner.problem.problem_layers import ProblemLayers

# Two documents to one: maps by key, named lists by name, all else from the upper one.


WALL, POST = {"name": "wall", "box": [1, 1, 1]}, {"name": "post", "sphere": 0.1}


@pytest.mark.parametrize(
    ("below", "above", "merged"),
    [
        ({"a": 1, "b": 2}, {"b": 3, "c": 4}, {"a": 1, "b": 3, "c": 4}),
        ({"r": {"s": {"x": 1, "y": 2}}}, {"r": {"s": {"y": 3}}}, {"r": {"s": {"x": 1, "y": 3}}}),
        ({"r": {"x": 1}}, {"r": None}, {"r": None}),
        ({"r": 2}, {"r": {"x": 1}}, {"r": {"x": 1}}),
        ([1, 2, 3], [4], [4]),
        ([WALL, POST], [{"name": "post", "sphere": 0.2}], [WALL, {"name": "post", "sphere": 0.2}]),
        ([WALL], [{"name": "wall", "box": None}, POST], [{"name": "wall", "box": None}, POST]),
        ([POST], [{"name": "post", "position": [1, 0, 0]}], [{**POST, "position": [1, 0, 0]}]),
        ([WALL], [], [WALL]),
        ([], [WALL], [WALL]),
        ([WALL], [{"sphere": 1}], [{"sphere": 1}]),
        ([{"link": "l"}], [{"link": "m"}], [{"link": "m"}]),
        ([{"name": 3}], [WALL], [WALL]),
    ],
)
def test_the_upper_one_wins(below, above, merged):
    assert merged_fields(below, above) == merged


def test_a_name_that_is_there_twice_stays_twice():
    """The check of the problem refuses it; merging would hide it."""
    twice = [WALL, {"name": "wall", "sphere": 1}]
    for below, above in ((twice, [WALL]), ([WALL], twice), ([POST], twice)):
        names = [item["name"] for item in merged_fields(below, above)]
        assert names.count("wall") == 2


def test_neither_document_is_changed():
    below, above = {"r": {"x": 1}, "o": [dict(WALL)]}, {"r": {"y": 2}, "o": [{"name": "wall"}]}
    merged_fields(below, above)["r"]["z"] = 3
    assert (below, above) == (
        {"r": {"x": 1}, "o": [WALL]},
        {"r": {"y": 2}, "o": [{"name": "wall"}]},
    )


# Paths of a problem, moved from one folder to another.


def moved(fields):
    result = copy.deepcopy(fields)
    move_paths(result, Path("/cells/one"), Path("/plans"))
    return result


def test_every_path_is_moved():
    fields = {
        "include": ["table.yaml", "../rail.yaml"],
        "robot": {
            "urdf": "arm.urdf",
            "srdf": "arm.srdf",
            "limits_file": "limits.yaml",
            "package_dirs": ["packages", ".."],
            "preset": ["fr3", "mine.yaml"],
            "attached": [{"name": "part", "mesh": "part.stl"}],
        },
        "tube": {"points": "path.csv"},
        "start": {"trajectory": "last.json"},
        "goal": {"trajectory": "home.csv"},
        "obstacles": [{"name": "wall", "box": [1, 1, 1]}, {"name": "bin", "mesh": "m/bin.obj"}],
    }
    at = "../cells/one"
    assert moved(fields) == {
        "include": [f"{at}/table.yaml", "../cells/rail.yaml"],
        "robot": {
            "urdf": f"{at}/arm.urdf",
            "srdf": f"{at}/arm.srdf",
            "limits_file": f"{at}/limits.yaml",
            "package_dirs": [f"{at}/packages", "../cells"],
            "preset": ["fr3", f"{at}/mine.yaml"],
            "attached": [{"name": "part", "mesh": f"{at}/part.stl"}],
        },
        "tube": {"points": f"{at}/path.csv"},
        "start": {"trajectory": f"{at}/last.json"},
        "goal": {"trajectory": f"{at}/home.csv"},
        "obstacles": [
            {"name": "wall", "box": [1, 1, 1]},
            {"name": "bin", "mesh": f"{at}/m/bin.obj"},
        ],
    }


@pytest.mark.parametrize(
    ("path", "there"),
    [
        ("arm.urdf", "../cells/one/arm.urdf"),
        ("example:ur5", "example:ur5"),
        ("package://arms/arm.urdf", "package://arms/arm.urdf"),
        ("/arms/arm.urdf", "/arms/arm.urdf"),
        ("file:///arms/part.stl", "file:///arms/part.stl"),
        ("file://part.stl", "file://../cells/one/part.stl"),
    ],
)
def test_what_is_no_relative_path_stays(path, there):
    assert moved({"robot": {"urdf": path}}) == {"robot": {"urdf": there}}


@pytest.mark.parametrize(
    "fields",
    [
        {"include": "a.yaml"},
        {"robot": {"preset": "a.yaml"}},
    ],
)
def test_one_or_a_list_are_the_same(fields):
    assert "../cells/one/a.yaml" in str(moved(fields))


@pytest.mark.parametrize("preset", ["fr3", "frr3", "arm.2", ["fer", "fr3"]])
def test_a_preset_without_an_ending_is_a_name(preset):
    assert moved({"robot": {"preset": preset}}) == {"robot": {"preset": preset}}


@pytest.mark.parametrize(
    "fields",
    [
        [],
        {"robot": 3, "tube": [], "obstacles": "none", "include": 3},
        {"robot": {"urdf": 3, "attached": [3], "package_dirs": [None]}, "tube": {"points": [[1]]}},
        {"obstacles": [[], {"mesh": None}], "robot": {"preset": [3]}},
    ],
)
def test_what_is_no_path_where_one_should_be_stays(fields):
    assert moved(fields) == fields


def test_what_is_at_two_places_is_moved_once():
    part = {"mesh": "part.stl"}
    fields = {"obstacles": [part, part]}
    move_paths(fields, Path("/cells"), Path("/plans"))
    assert fields["obstacles"] == [{"mesh": "../cells/part.stl"}] * 2


# Files that include others: what they give together, and what is wrong with them.


CELL = """\
robot: {urdf: ../arms/arm.urdf, tool_frame: hand, payload: {mass: 2}}
obstacles:
  - {name: table, box: [1, 1, 0.1], position: [0, 0, -0.1]}
  - {name: bin, mesh: bin.stl}
clearance: 0.02
"""
MAIN = """\
include: cells/cell.yaml
robot: {payload: {com: [0, 0, 0.1]}}
tube: {points: [[0, 0, 0], [1, 0, 0]], radius: 0.1}
start: {joints: [0, 0]}
obstacles: [{name: bin, position: [1, 0, 0]}, {name: post, sphere: 0.1}]
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "cells").mkdir()
    (tmp_path / "cells" / "cell.yaml").write_text(CELL)
    (tmp_path / "main.yaml").write_text(MAIN)
    return tmp_path


def write(folder, **files):
    for name, text in files.items():
        (folder / f"{name}.yaml").write_text(text)


def fault(path, **changes):
    with pytest.raises(ProblemError) as caught:
        read_problem_fields(path, changes)
    return str(caught.value)


def test_a_file_and_what_it_includes_are_one_problem(folder):
    fields = read_problem_fields(folder / "main.yaml")
    assert (fields.robot.urdf, fields.robot.tool_frame) == ("arms/arm.urdf", "hand")
    assert (fields.robot.payload.mass, fields.robot.payload.com) == (2, (0, 0, 0.1))
    assert fields.clearance == 0.02
    assert [solid.name for solid in fields.obstacles] == ["table", "bin", "post"]
    assert (fields.obstacles[1].mesh, fields.obstacles[1].position) == ("cells/bin.stl", (1, 0, 0))


def test_later_files_win_over_earlier_ones_and_the_file_itself_over_all(folder):
    write(folder, a="clearance: 0.1\nperiod: 0.1", b="clearance: 0.2\nperiod: 0.2")
    write(folder, main="include: [cells/cell.yaml, a.yaml, b.yaml]\nperiod: 0.3")
    merged = ProblemLayers.read(folder / "main.yaml").merged
    assert (merged["clearance"], merged["period"]) == (0.2, 0.3)
    assert merged["robot"]["urdf"] == "arms/arm.urdf"
    assert "include" not in merged


def test_included_files_include(folder):
    write(folder / "cells", low="period: 0.1\nclearance: 0.5", cell=f"include: low.yaml\n{CELL}")
    fields = read_problem_fields(folder / "main.yaml")
    assert (fields.period, fields.clearance) == (0.1, 0.02)


def test_one_file_may_be_included_along_two_ways(folder):
    write(folder, low="period: 0.1", a="include: low.yaml", b="include: low.yaml\nclearance: 1")
    write(folder, main=f"{MAIN}\n".replace("cells/cell.yaml", "[cells/cell.yaml, a.yaml, b.yaml]"))
    assert read_problem_fields(folder / "main.yaml").period == 0.1


@pytest.mark.parametrize("form", ["[]", "null"])
def test_a_file_that_includes_nothing_is_itself(folder, form):
    write(folder, alone=f"include: {form}\nperiod: 0.1")
    assert ProblemLayers.read(folder / "alone.yaml").merged == {"period": 0.1}


def test_a_bundled_problem_may_be_included(tmp_path):
    write(tmp_path, mine="include: example:ur5/over_the_wall\nclearance: 0.01")
    fields = read_problem_fields(tmp_path / "mine.yaml")
    assert (fields.robot.urdf, fields.clearance) == ("example:ur5", 0.01)


def test_values_are_changed_after_files_are_included(folder):
    changes = {"robot.payload.mass": "x2", "obstacles.table.position.2": -0.2}
    fields = read_problem_fields(folder / "main.yaml", changes)
    assert fields.robot.payload.mass == 4
    assert fields.obstacles[0].position == (0, 0, -0.2)
    with pytest.raises(ProblemError, match=r"include: values are changed after files are included"):
        changed_problem({}, {"include": "other.yaml"})


@pytest.mark.parametrize("start", ["a.yaml", "top.yaml"])
def test_files_that_include_each_other_are_named_in_their_order(tmp_path, start):
    write(tmp_path, top="include: a.yaml", a="include: b.yaml", b="include: [a.yaml]")
    message = fault(tmp_path / start)
    circle = "a.yaml includes b.yaml includes a.yaml"
    assert message.startswith(f"{tmp_path / 'b.yaml'}: include: {circle}")
    assert message.endswith("a circle; take one of them out")


def test_a_file_that_includes_itself_is_refused(tmp_path):
    write(tmp_path, a="include: a.yaml")
    assert "a.yaml includes a.yaml, a circle" in fault(tmp_path / "a.yaml")


def test_more_files_than_anyone_needs_are_refused(tmp_path):
    for k in range(8):
        write(tmp_path, **{f"f{k}": f"include: [f{k + 1}.yaml, f{k + 1}.yaml]"})
    write(tmp_path, f8="period: 0.1")
    assert "more than 100 files are included" in fault(tmp_path / "f0.yaml")


@pytest.mark.parametrize(
    ("text", "fragment"),
    [
        ("include: nowhere.yaml", "main.yaml: include: problem file"),
        ("include: 3", "main.yaml: include is 3; it must be a file or a list of files"),
        ("include: [cells/cell.yaml, {}]", "it must be a file or a list of files"),
        ("include: {a: b}", "it must be a file or a list of files"),
        ("include: cells", "is a folder"),
        ("include: list.yaml", "list.yaml: an included file is a map"),
        ("include: preset.yaml", "preset.yaml: format is 'tubeplanner/preset'; an included file"),
        ("include: broken.yaml", "included file"),
    ],
)
def test_what_cannot_be_included_is_named(folder, text, fragment):
    write(folder, main=text, list="[1, 2]", preset="format: tubeplanner/preset", broken="{")
    assert fragment in fault(folder / "main.yaml")


@pytest.mark.parametrize(
    ("cell", "own", "blamed"),
    [
        ("colour: red", "", "cell"),
        ("clearance: far", "", "cell"),
        ("", "colour: red", "main"),
        ("clearance: 1", "clearance: far", "main"),
        ("clearance: far", "clearance: wide", "main"),
        ("obstacles: [{name: a, sphere: 1}, {name: b, sphere: big}]", "", "cell"),
        ("obstacles: [{name: a, sphere: big}]", "obstacles: [{name: b, sphere: 1}]", "cell"),
        ("obstacles: [{name: a, sphere: 1}]", "obstacles: [{name: b, sphere: big}]", "main"),
        ("robot: {color: red}", "robot: {urdf: a}", "cell"),
        ("robot: {color: {a: 1}}", "robot: {urdf: a}", "cell"),
    ],
)
def test_a_fault_is_blamed_on_the_file_that_has_it(tmp_path, cell, own, blamed):
    start = "start: {joints: [0]}\n"
    robot = "" if "robot" in cell else "robot: {urdf: a, tool_frame: b}\n"
    write(tmp_path, cell=cell or "period: 0.1", main=f"include: cell.yaml\n{start}{robot}{own}")
    message = fault(tmp_path / "main.yaml")
    assert message.startswith(f"{tmp_path / blamed}.yaml: "), message


def test_an_item_is_found_by_its_name_in_the_file_that_has_it(tmp_path):
    """Behind another file's items it has another index."""
    write(tmp_path, low="obstacles: [{name: a, sphere: 1}]")
    write(tmp_path, high="obstacles: [{name: b, sphere: big}]")
    write(tmp_path, main="include: [low.yaml, high.yaml]\nrobot: {urdf: a, tool_frame: b}")
    message = fault(tmp_path / "main.yaml")
    assert message.startswith(f"{tmp_path / 'high.yaml'}: obstacles[1].sphere is 'big'")


def test_a_changed_value_is_not_blamed_on_an_included_file(folder):
    message = fault(folder / "main.yaml", clearance="far")
    assert message.startswith(f"{folder / 'main.yaml'}: clearance is 'far'")


def test_json_includes_yaml(folder):
    (folder / "main.json").write_text(json.dumps({"include": ["main.yaml"], "clearance": 0.5}))
    assert read_problem_fields(folder / "main.json").clearance == 0.5
