"""Included files: a problem as layers, merged fields, relative paths."""

import copy
import json
from pathlib import Path

import pytest
from cases import refusal

from tubeplanner.errors import ProblemError
from tubeplanner.task.field_changes import changed_problem, read_problem_fields
from tubeplanner.task.includes import ProblemLayers, merged_fields, move_paths

WALL, POST = {"name": "wall", "box": [1, 1, 1]}, {"name": "post", "sphere": 0.1}
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


def moved(fields):
    """Return the fields of a file of another folder, with paths from the folder `plans`."""
    result = copy.deepcopy(fields)
    move_paths(result, Path("/cells/one"), Path("/plans"))
    return result


@pytest.fixture
def main(tmp_path):
    """Return a problem file that includes a file of a folder beside it."""
    (tmp_path / "cells").mkdir()
    (tmp_path / "cells" / "cell.yaml").write_text(CELL)
    (tmp_path / "main.yaml").write_text(MAIN)
    return tmp_path / "main.yaml"


def write(folder, **files):
    for name, text in files.items():
        (folder / f"{name}.yaml").write_text(text)


def fault(path, **changes):
    return refusal(ProblemError, read_problem_fields, path, changes)


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
        ([WALL], [{"sphere": 1}], [{"sphere": 1}]),
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
    before = copy.deepcopy((below, above))
    merged_fields(below, above)["r"]["z"] = 3
    assert (below, above) == before


def all_paths(here, above):
    """Return fields with every path that a problem may have, from a folder and the one above."""
    return {
        "include": [f"{here}table.yaml", f"{above}rail.yaml"],
        "robot": {
            "urdf": f"{here}arm.urdf",
            "srdf": f"{here}arm.srdf",
            "limits_file": f"{here}limits.yaml",
            "package_dirs": [f"{here}packages", above.rstrip("/")],
            "preset": ["fr3", f"{here}mine.yaml"],
            "attached": [{"name": "part", "mesh": f"{here}part.stl"}],
        },
        "tube": {"points": f"{here}path.csv"},
        "start": {"trajectory": f"{here}last.json"},
        "goal": {"trajectory": f"{here}home.csv"},
        "obstacles": [WALL, {"name": "bin", "mesh": f"{here}m/bin.obj"}],
    }


def test_every_path_is_moved():
    assert moved(all_paths("", "../")) == all_paths("../cells/one/", "../cells/")
    one = ({"include": "a.yaml"}, {"robot": {"preset": "a.yaml"}})  # not a list
    for fields in (*one, {"robot": {"package_dirs": {"arms": "a.yaml"}}}):
        assert "../cells/one/a.yaml" in str(moved(fields))
    shared = {"mesh": "part.stl"}
    fields = {"obstacles": [shared, shared]}
    move_paths(fields, Path("/cells"), Path("/plans"))
    assert fields["obstacles"] == [{"mesh": "../cells/part.stl"}] * 2


@pytest.mark.parametrize(
    ("path", "there"),
    [
        ("arm.urdf", "../cells/one/arm.urdf"),
        ("example:ur5", "example:ur5"),
        ("package://arms/arm.urdf", "package://arms/arm.urdf"),
        ("/arms/arm.urdf", "/arms/arm.urdf"),
        ("file:///arms/part.stl", "file:///arms/part.stl"),
        ("file://part.stl", "file://../cells/one/part.stl"),
        ("file://localhost/arms/part.stl", "file://localhost/arms/part.stl"),
        ("file:/arms/part.stl", "file:/arms/part.stl"),
        ("model://arms/part.stl", "model://arms/part.stl"),
    ],
)
def test_only_relative_paths_are_moved(path, there):
    assert moved({"robot": {"urdf": path}}) == {"robot": {"urdf": there}}


@pytest.mark.parametrize(
    "fields",
    [
        [],
        {"robot": 3, "tube": [], "obstacles": "none", "include": 3},
        {"robot": {"urdf": 3, "attached": [3], "package_dirs": [None]}, "tube": {"points": [[1]]}},
        {"obstacles": [[], {"mesh": None}], "robot": {"preset": [3]}},
        {"robot": {"preset": "fr3"}},  # without an ending it is a name
        {"robot": {"preset": "arm.2"}},
    ],
)
def test_a_value_that_is_no_path_stays(fields):
    assert moved(fields) == fields


def test_a_file_and_what_it_includes_are_one_problem(main):
    fields = read_problem_fields(main)
    assert (fields.robot.urdf, fields.robot.tool_frame) == ("arms/arm.urdf", "hand")
    assert (fields.robot.payload.mass, fields.robot.payload.com) == (2, (0, 0, 0.1))
    assert fields.clearance == 0.02
    assert [solid.name for solid in fields.obstacles] == ["table", "bin", "post"]
    assert (fields.obstacles[1].mesh, fields.obstacles[1].position) == ("cells/bin.stl", (1, 0, 0))


def test_later_files_win_over_earlier_ones_and_the_file_itself_over_all(main):
    write(main.parent, a="clearance: 0.1\nperiod: 0.1", b="clearance: 0.2\nperiod: 0.2")
    write(main.parent, main="include: [cells/cell.yaml, a.yaml, b.yaml]\nperiod: 0.3")
    merged = ProblemLayers.read(main).merged
    assert (merged["clearance"], merged["period"]) == (0.2, 0.3)
    assert merged["robot"]["urdf"] == "arms/arm.urdf"
    assert "include" not in merged


def test_included_files_include_also_along_two_paths(main):
    cells = main.parent / "cells"
    write(cells, low="period: 0.1\nclearance: 0.5", cell=f"include: low.yaml\n{CELL}")
    fields = read_problem_fields(main)
    assert (fields.period, fields.clearance) == (0.1, 0.02)
    main.write_text(MAIN.replace("cells/cell.yaml", "[cells/cell.yaml, cells/low.yaml]"))
    fields = read_problem_fields(main)
    assert (fields.period, fields.clearance) == (0.1, 0.5)


def test_a_bundled_problem_or_nothing_may_be_included(tmp_path):
    for nothing in ("[]", "null"):
        write(tmp_path, alone=f"include: {nothing}\nperiod: 0.1")
        assert ProblemLayers.read(tmp_path / "alone.yaml").merged == {"period": 0.1}
    write(tmp_path, mine="include: example:ur5/over_the_wall\nclearance: 0.01")
    fields = read_problem_fields(tmp_path / "mine.yaml")
    assert (fields.robot.urdf, fields.clearance) == ("example:ur5", 0.01)
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({"include": ["mine.yaml"], "clearance": 0.5}))
    assert read_problem_fields(path).clearance == 0.5


def test_values_are_changed_after_files_are_included(main):
    changes = {"robot.payload.mass": "x2", "obstacles.table.position.2": -0.2}
    fields = read_problem_fields(main, changes)
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
    write(tmp_path, a="include: a.yaml")
    assert "a.yaml includes a.yaml, a circle" in fault(tmp_path / start)


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
        ("include: cells", "is a folder"),
        ("include: list.yaml", "list.yaml: an included file is a map"),
        ("include: preset.yaml", "preset.yaml: format is 'tubeplanner/preset'; an included file"),
        ("include: broken.yaml", "included file"),
        ("include: newer.yaml", "newer.yaml: version: 1 can be read; a newer tubeplanner may"),
    ],
)
def test_a_file_that_cannot_be_included_is_named(main, text, fragment):
    files = {"list": "[1, 2]", "preset": "format: tubeplanner/preset", "broken": "{"}
    write(main.parent, main=text, newer="{version: 2, novel: 1}", **files)
    assert fragment in fault(main)


@pytest.mark.parametrize(
    ("cell", "own", "blamed"),
    [
        ("colour: red", "", "cell"),
        ("", "colour: red", "main"),
        ("clearance: far", "clearance: wide", "main"),
        ("obstacles: [{name: a, sphere: big}]", "obstacles: [{name: b, sphere: 1}]", "cell"),
        ("obstacles: [{name: a, sphere: 1}]", "obstacles: [{name: b, sphere: big}]", "main"),
        ("robot: {color: red}", "robot: {urdf: a}", "cell"),
    ],
)
def test_a_fault_is_blamed_on_the_file_that_has_it(tmp_path, cell, own, blamed):
    start = "start: {joints: [0]}\n"
    robot = "" if "robot" in cell else "robot: {urdf: a, tool_frame: b}\n"
    write(tmp_path, cell=cell or "period: 0.1", main=f"include: cell.yaml\n{start}{robot}{own}")
    message = fault(tmp_path / "main.yaml")
    assert message.startswith(f"{tmp_path / blamed}.yaml: "), message


def test_an_item_is_found_by_its_name_in_the_file_that_has_it(tmp_path):
    """An item after those of another file has another index."""
    write(tmp_path, low="obstacles: [{name: a, sphere: 1}]")
    write(tmp_path, high="obstacles: [{name: b, sphere: big}]")
    write(tmp_path, main="include: [low.yaml, high.yaml]\nrobot: {urdf: a, tool_frame: b}")
    message = fault(tmp_path / "main.yaml")
    assert message.startswith(f"{tmp_path / 'high.yaml'}: obstacles[1].sphere is 'big'")


def test_a_changed_value_is_not_blamed_on_an_included_file(main):
    assert fault(main, clearance="far").startswith(f"{main}: clearance is 'far'")
