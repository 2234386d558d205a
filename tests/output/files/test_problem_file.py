"""Problem files written from others: comments kept, paths valid, numbers as they are."""

import copy
import io
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
import yaml
from gantry import FLOOR, gantry
from ruamel.yaml import YAML

from tubeplanner import JointTrajectory, Tube, load_problem, parse_problem
from tubeplanner.documents import parse_yaml
from tubeplanner.errors import ProblemError
from tubeplanner.output.files.fingerprint import problem_hash
from tubeplanner.output.files.new_problem_files import read_cell
from tubeplanner.output.files.problem_file import (
    change_own,
    new_fields,
    read_fields,
    with_other_tube,
    with_placement,
    with_problem,
)
from tubeplanner.resources import bundled_folder
from tubeplanner.task.field_changes import changed_problem
from tubeplanner.task.includes import ProblemLayers, merged_fields, move_paths

# A file's own fields, changed so that with what it includes they say what is wanted.


BELOW = {
    "robot": {"urdf": "a", "payload": {"mass": 1, "com": [0, 0, 1]}},
    "obstacles": [{"name": "a", "sphere": 1}, {"name": "b", "position": [1, 2, 3]}],
}
BALL, OTHER_BALL = {"name": "b", "sphere": 2}, {"name": "c", "sphere": 3}
OWN = {"clearance": 0.1, "obstacles": [BALL, OTHER_BALL]}


@pytest.mark.parametrize(
    ("path", "value", "written"),
    [
        ("clearance", 0.2, {"clearance": 0.2}),
        ("robot.payload.mass", 5, {"robot": {"payload": {"mass": 5}}}),
        ("robot.payload.com.1", 5, {"robot": {"payload": {"com": [0, 5, 1]}}}),
        ("robot.payload", None, {"robot": {"payload": None}}),
        ("robot.limits.velocity", 2, {"robot": {"limits": {"velocity": 2}}}),
        ("obstacles.a.sphere", "x2", {"obstacles": [BALL, OTHER_BALL, {"name": "a", "sphere": 2}]}),
        (
            "obstacles.b.position.0",
            9,
            {"obstacles": [BALL | {"position": [9, 2, 3]}, OTHER_BALL]},
        ),
        ("robot.urdf", "a", {}),
    ],
)
def test_only_what_is_changed_is_written(path, value, written):
    own, merged = copy.deepcopy(OWN), merged_fields(BELOW, OWN)
    target = changed_problem(merged, {path: value})
    change_own(own, merged, target)
    assert own == OWN | written
    assert merged_fields(BELOW, own) == target


# A tube and ends in place of a file's, or with a file's cell.


TEXT = """# A cell.
robot:
  urdf: arms/two_link.urdf  # ours
  tool_frame: hand
  gravity: [0, 0, 0]
start: {joints: [0, 0]}
goal: {position: [0, 0.5, 0]}
obstacles:
  # brought along
  - {name: part, mesh: part.stl, position: [5, 5, 0]}
"""
POINTS = [[0.6, 0, 0], [0.4, 0.4, 0], [0, 0.5, 0]]
GOAL = np.array([np.pi / 2 - 0.5857, 1.1714])


@pytest.fixture
def cell(tmp_path):
    """The file of a cell, beside its robot and mesh and an empty folder."""
    (tmp_path / "arms").mkdir()
    (tmp_path / "other").mkdir()
    shutil.copy(bundled_folder() / "two_link" / "two_link.urdf", tmp_path / "arms")
    shutil.copy(bundled_folder() / "ur5" / "part.stl", tmp_path)
    (tmp_path / "cell.yaml").write_text(TEXT)
    return tmp_path / "cell.yaml"


@pytest.fixture
def found(cell):
    free = load_problem(cell, reads_tube=False)
    tube = Tube(POINTS, [0.1, 0.05], joint_signs=[{"joint2": (-1, 2)}, {"joint2": "+"}])
    return free.with_tube(tube, GOAL)


def with_found(source, target, problem):
    """Write the cell of a file with the tube and ends of a problem; return the text."""
    target.write_bytes(with_problem(read_fields(source), source.parent, target, problem))
    return target.read_text()


@pytest.mark.parametrize("name", ["other/new.yaml", "new.json"])
def test_what_is_written_is_read_as_the_same_problem(cell, found, name):
    target = cell.parent / name
    with_found(cell, target, found)
    read = load_problem(target)
    np.testing.assert_array_equal(read.tube.points, found.tube.points)
    np.testing.assert_array_equal(read.tube.radius, found.tube.radius)
    assert read.tube.joint_ranges == found.tube.joint_ranges
    np.testing.assert_array_equal(read.start, found.start)
    np.testing.assert_array_equal(read.goal, found.goal)


@pytest.mark.parametrize("given", ["fr3", ["fer", "fr3"]])
def test_a_bundled_preset_stays_a_name(tmp_path, given):
    fields = {"robot": {"preset": copy.deepcopy(given)}}
    move_paths(fields, tmp_path, tmp_path / "other")
    assert fields["robot"]["preset"] == given


def test_comments_and_order_are_kept(cell, found):
    text = with_found(cell, cell.parent / "other" / "new.yaml", found)
    assert text.splitlines()[:6] == [
        "# A cell.",
        "robot:",
        "  urdf: ../arms/two_link.urdf # ours",
        "  tool_frame: hand",
        "  gravity: [0, 0, 0]",
        "tube:",
    ]
    assert "start: {joints: [0, 0]}\n" in text
    assert "  # brought along\n  - {name: part, mesh: ../part.stl, position: [5, 5, 0]}" in text


def test_json_gets_the_tube_where_a_reader_expects_it(cell, found):
    plain = cell.with_suffix(".json")
    plain.write_text(json.dumps(dict(read_fields(cell))))
    fields = json.loads(with_found(plain, cell.parent / "new.json", found))
    assert list(fields) == ["robot", "tube", "start", "goal", "obstacles"]


def test_another_tube_changes_radii_and_signs_alone(cell, found):
    target = cell.parent / "new.yaml"
    before = with_found(cell, target, found).splitlines()
    other = Tube(POINTS, 0.02, joint_signs={"joint2": "+"})
    after = with_other_tube(target, cell.parent / "narrow.yaml", other).decode().splitlines()
    changed = [line.strip() for line in after if line not in before]
    assert changed == ["radius: [0.02, 0.02]", "joint_signs: {joint2: +}"]


@pytest.mark.parametrize("in_file", [True, False])
def test_points_are_written_where_the_file_has_others_or_more(cell, in_file):
    """From a file of points, or with one that repeats another: what is written stands alone."""
    points = [POINTS[0], *POINTS]
    fields = yaml.safe_load(TEXT)
    fields["tube"] = {"visit": "ordered", "rotation_tolerance": 3.0}
    if in_file:
        rows = [",".join(map(str, [*point, 0, 0, 0, 1, 0.1])) for point in points]
        (cell.parent / "path.csv").write_text("\n".join(rows))
        fields["tube"]["points"] = "path.csv"
    else:
        orientations = [[0, 0, 0, 1]] * 4
        fields["tube"] |= {"points": points, "radius": [0.1] * 3, "orientations": orientations}
    del fields["goal"], fields["obstacles"]
    source, target = cell.parent / "many.json", cell.parent / "other" / "new.yaml"
    source.write_text(json.dumps(fields))
    tube = load_problem(source).tube
    target.write_bytes(with_other_tube(source, target, tube.with_radius([0.2, 0.3])))
    again = load_problem(target).tube
    np.testing.assert_array_equal(again.points, POINTS)
    assert again.radius.tolist() == [0.2, 0.3]
    assert again.rotation_tolerance == (3.0, 3.0)
    assert again.notes == ()


def test_the_tools_speed_is_kept_where_the_tube_is(cell, found):
    """With another radius as it was written; with other points by segment; not in another tube."""
    target, again = cell.parent / "new.json", cell.parent / "again.yaml"
    tube = replace(found.tube, tool_speed=[None, 0.5])
    fields = json.loads(with_found(cell, target, found.with_tube(tube, found.goal)))
    assert fields["tube"]["tool_speed"] == [None, 0.5]
    assert load_problem(target).tube.tool_speed.tolist() == [np.inf, 0.5]
    again.write_bytes(with_other_tube(target, again, tube.with_radius([0.2, 0.3])))
    assert load_problem(again).tube.tool_speed.tolist() == [np.inf, 0.5]
    twice = {key: [values[0], *values] for key, values in fields["tube"].items()}
    target.write_text(json.dumps(fields | {"tube": twice}))
    again.write_bytes(with_other_tube(target, again, load_problem(target).tube))
    assert load_problem(again).tube.tool_speed.tolist() == [np.inf, 0.5]
    with_found(target, again, found)
    assert load_problem(again).tube.tool_speed is None


@pytest.mark.parametrize("suffix", ["yaml", "json"])
def test_boxes_are_written_and_read(cell, found, suffix):
    boxes = [None, {"box": [0.1, 0.04], "up": [0, 0, 1]}]
    tube = Tube(POINTS, [0.1, None], cross_section=boxes, joint_signs={"joint2": "+"})
    target, narrow = cell.parent / f"new.{suffix}", cell.parent / f"narrow.{suffix}"
    with_found(cell, target, found.with_tube(tube, found.goal))
    fields = read_fields(target)["tube"]
    assert (fields["radius"], fields["cross_section"]) == ([0.1, None], boxes)
    again = load_problem(target).tube
    np.testing.assert_array_equal(again.cross_section, tube.cross_section)
    np.testing.assert_array_equal(again.radius, tube.radius)
    narrow.write_bytes(with_other_tube(target, narrow, tube.scaled(0.5)))
    np.testing.assert_allclose(load_problem(narrow).tube.radius, [0.05, 0.01])
    discs = with_other_tube(target, narrow, Tube(POINTS, 0.1))
    assert "cross_section" not in discs.decode()


def test_a_file_of_obstacles_needs_no_more(tmp_path):
    only = tmp_path / "only.yaml"
    only.write_text("obstacles: [{name: ball, sphere: 0.1}]\nclearance: 0.01\n")
    fields = new_fields("example:two_link", "hand", only)
    assert list(fields) == ["format", "version", "robot", "obstacles", "clearance"]
    only.write_text("clearance: 0.01\n")
    with pytest.raises(ProblemError, match=r"only.yaml: obstacles is required: a list of solids"):
        new_fields("example:two_link", "hand", only)


# What separates lines for one reader of YAML is a space to another.
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("obstacles: [\n", r"bad.yaml is malformed: line 1"),
        ("robot: {urdf: a}\u2028tube: {}\u2028", r"bad.yaml cannot be rewritten with its comments"),
    ],
)
def test_a_file_that_cannot_be_written_again_is_refused(tmp_path, text, message):
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(ProblemError, match=message) as caught:
        read_fields(tmp_path / "bad.yaml")
    assert str(caught.value).isprintable()


SHARED = """# Twins.
tube:
  points: [&p [0.45, -0.3, 0.000], [0.45, 0.1, 0], *p]  # there and back
obstacles:
  - &a {name: post, cylinder: [0.03, 0.3], position: [0.4, 0.22, 0]}
  - <<: *a
    name: twin  # the other
"""


@pytest.mark.parametrize(
    "changes",
    [
        {"obstacles.twin.position.0": 0.9, "tube.points.0.2": 0.1},
        {"obstacles.post.position": "x2", "robot.payload": {"mass": 2, "com": [0, 0, 1]}},
        {"tube.points": "x2", "robot.limits.effort.joint1": 5},
    ],
)
def test_changes_are_written_as_they_are_read_and_comments_are_kept(changes, tmp_path):
    source = tmp_path / "shared.yaml"
    source.write_text(SHARED)
    stream = io.StringIO()
    YAML().dump(read_fields(source, changes), stream)
    written = stream.getvalue()
    assert parse_yaml(written) == changed_problem(parse_yaml(SHARED), changes)
    for comment in ("# Twins.", "# there and back", "# the other"):
        assert comment in written
    assert "payload: {mass: 2, com: [0, 0, 1]}" in written or "robot.payload" not in changes


# Files that include others keep them and say the same, from anywhere.


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
SHORT_POINTS = [[0.3 + 0.3 * np.cos(1), 0.3 * np.sin(1), 0], [0.4, 0.4, 0]]
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
    rows = [",".join(map(str, [*point, 0.1])) for point in SHORT_POINTS]
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
    alone["robot"]["preset"] = "presets/mine.yaml"
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
    tube = Tube(SHORT_POINTS, 0.05, joint_signs=signs)
    contents = with_other_tube(folder / "main.yaml", folder / "new.yaml", tube)
    read = written(folder, "new.yaml", contents, monkeypatch)
    names = problem.robot.joint_names
    np.testing.assert_array_equal(read.tube.ranges_of(names), tube.ranges_of(names))


def test_a_box_of_the_cell_does_not_come_back(folder, monkeypatch):
    cell = folder / "cells" / "cell.yaml"
    box = "{box: [0.1, 0.1], up: [0, 0, 1]}"
    cell.write_text(CELL.replace("tool_radius: 0.001", f"cross_section: {box}"))
    contents = with_other_tube(folder / "main.yaml", folder / "new.yaml", Tube(SHORT_POINTS, 0.05))
    assert not written(folder, "new.yaml", contents, monkeypatch).tube.is_box.any()


def test_a_route_stands_above_the_tube_and_ends_of_the_cell(folder, monkeypatch):
    """All of the cell's tube that the found one has not, and a seed, go back to defaults."""
    cell = folder / "cells" / "cell.yaml"
    cell.write_text(CELL + "goal: {seed: [0, 1]}\n")
    problem = load_problem(folder / "main.yaml")
    result = problem.with_tube(Tube(SHORT_POINTS, [0.1]), np.array([0.5, 0.5]))
    result = result.with_tube(
        Tube([SHORT_POINTS[0], result.robot.tool_position(result.goal[None])[0]], 0.1)
    )
    fields = read_fields(folder / "main.yaml")
    contents = with_problem(fields, folder, folder / "new.yaml", result)
    assert parse_yaml(contents.decode())["start"] == {"joints": [0.0, 1.0]}
    read = written(folder, "new.yaml", contents, monkeypatch)
    assert problem_hash(read) == problem_hash(result)
    assert read.tube.tool_radius == 0


@pytest.mark.parametrize("text", ["include: main.yaml\nstart: {joints: [0, 1]}\n", "{}\n"])
def test_a_tube_stands_where_a_reader_expects_it_though_the_robot_is_included(folder, text):
    result = load_problem(folder / "main.yaml")
    result = result.with_tube(Tube(SHORT_POINTS, 0.4), result.start)
    (folder / "short.yaml").write_text(text)
    fields = read_fields(folder / "short.yaml")
    contents = with_problem(fields, folder, folder / "new.yaml", result).decode()
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
    assert not {"tube", "start", "goal"} & (cell.fields.keys() | cell.merged.keys())
    assert cell.merged["robot"]["urdf"] == "cells/arms/two_link.urdf"


def test_obstacles_of_a_file_are_those_with_its_included_ones(folder, monkeypatch):
    monkeypatch.chdir(folder / "elsewhere")
    cell = read_cell("example:ur5", "tool0", folder / "main.yaml", None)
    meshes = [solid["mesh"] for solid in cell.fields["obstacles"]]
    assert meshes == ["../cells/part.stl", "package://parts/bin.stl"]


# The robot at another place.


PLACE = {
    "robot.base": {"position": [-0.3, 0.1, 0.0], "rpy": [0.0, 0.0, -0.9]},
    "start": {"seed": [0.1, 0.2]},
    "goal": {"seed": {"along": 0.3, "across": 0.4}},
}


@pytest.fixture
def best(tmp_path):
    """A file in another folder, to write to."""
    (tmp_path / "other").mkdir()
    return tmp_path / "other" / "best.yaml"


def placed(source, target, changes=None):
    """Write a placement to a file; return its content."""
    target.write_bytes(with_placement(source, target, PLACE, changes))
    return yaml.safe_load(target.read_text())


def test_base_and_ends_are_others_and_all_else_stays(tmp_path, best):
    source = gantry(tmp_path, [FLOOR])
    source.write_text(source.read_text().replace("tube:", "tube:  # straight on"))
    before, fields = yaml.safe_load(source.read_text()), placed(source, best)
    assert fields["robot"].pop("base") == PLACE["robot.base"]
    assert (fields.pop("start"), fields.pop("goal")) == (PLACE["start"], PLACE["goal"])
    assert fields["robot"].pop("urdf") == "../gantry.urdf"
    before.pop("start")
    before["robot"].pop("urdf")
    assert fields == before
    text = best.read_text()
    assert "tube:  # straight on" in text
    assert "  base: {position: [-0.3, 0.1, 0.0], rpy: [0.0, 0.0, -0.9]}\n" in text
    assert load_problem(best).robot.base.position == (-0.3, 0.1, 0.0)


def test_what_an_included_file_says_of_base_and_ends_no_longer_counts(tmp_path, best):
    cell = gantry(tmp_path, name="cell", goal={"position": [0.5, 0, 0], "tolerance": 0.001})
    fields = yaml.safe_load(cell.read_text())
    fields["robot"]["base"] = {"position": [1, 1, 1], "quaternion": [0, 0, 1, 1]}
    cell.write_text(yaml.safe_dump(fields))
    source = tmp_path / "problem.yaml"
    source.write_text("include: [cell.yaml]\ntube: {radius: 0.002}\nstart: {joints: [0, 0]}\n")
    assert placed(source, best)["include"] == ["../cell.yaml"]
    loaded = load_problem(best)
    assert loaded.robot.base.quaternion is None
    assert loaded.robot.base.rpy == (0, 0, -0.9)
    assert loaded.start.joints.tolist() == [0.1, 0.2]
    assert loaded.goal.joints.tolist() == [0.3, 0.4]


def test_a_place_is_written_as_json_too_with_other_changes(tmp_path, best):
    target = best.with_suffix(".json")
    placed(gantry(tmp_path), target, {"tube.radius": 0.002})
    fields = json.loads(target.read_text())
    assert fields["robot"]["base"] == PLACE["robot.base"]
    assert fields["tube"]["radius"] == 0.002
