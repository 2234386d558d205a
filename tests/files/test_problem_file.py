"""Problem files written from others: comments kept, paths valid, numbers as they are."""

import copy
import io
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from ruamel.yaml import YAML

from tubeplanner import Tube, load_problem
from tubeplanner.documents import parse_yaml
from tubeplanner.errors import ProblemError
from tubeplanner.files.problem_file import (
    new_fields,
    read_fields,
    with_other_tube,
    with_problem,
)
from tubeplanner.problem.path_fields import move_paths
from tubeplanner.problem.problem_fields import changed_problem
from tubeplanner.resources import bundled_folder

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
    (tmp_path / "arms").mkdir()
    (tmp_path / "other").mkdir()
    shutil.copy(bundled_folder() / "two_link" / "two_link.urdf", tmp_path / "arms")
    shutil.copy(bundled_folder() / "ur5" / "part.stl", tmp_path)
    (tmp_path / "cell.yaml").write_text(TEXT)
    return tmp_path


@pytest.fixture
def found(cell):
    free = load_problem(cell / "cell.yaml", reads_tube=False)
    tube = Tube(POINTS, [0.1, 0.05], joint_signs=[{"joint2": (-1, 2)}, {"joint2": "+"}])
    return free.with_tube(tube, GOAL)


@pytest.mark.parametrize("name", ["other/new.yaml", "new.json"])
def test_what_is_written_is_read_as_the_same_problem(cell, found, name):
    target = cell / name
    target.write_bytes(with_problem(read_fields(cell / "cell.yaml"), cell, target, found))
    read = load_problem(target)
    np.testing.assert_array_equal(read.tube.points, found.tube.points)
    np.testing.assert_array_equal(read.tube.radius, found.tube.radius)
    assert read.tube.joint_ranges == found.tube.joint_ranges
    np.testing.assert_array_equal(read.start, found.start)
    np.testing.assert_array_equal(read.goal, found.goal)


def test_presets_and_files_of_limits_are_found_from_elsewhere(cell, found):
    preset = {
        "format": "tubeplanner/preset",
        "joints": 2,
        "limits": {"jerk": 500},
        "sources": {"limits.jerk": "controller"},
    }
    (cell / "arms" / "mine.yaml").write_text(json.dumps(preset))
    (cell / "limits.yaml").write_text("joint_limits: {joint1: {max_velocity: 2}}")
    folder = cell / "other"
    for given, written in (
        ("arms/mine.yaml", "../arms/mine.yaml"),
        (["arms/mine.yaml"], ["../arms/mine.yaml"]),
    ):
        fields = read_fields(cell / "cell.yaml")
        fields["robot"] |= {"preset": given, "limits_file": "limits.yaml"}
        target = folder / "new.yaml"
        target.write_bytes(with_problem(fields, cell, target, found))
        robot = read_fields(target)["robot"]
        assert (robot["preset"], robot["limits_file"]) == (written, "../limits.yaml")
        limits = load_problem(target).robot.limits
        assert limits.jerk.tolist() == [500, 500]
        assert limits.velocity[0] == 2


@pytest.mark.parametrize("given", ["fr3", ["fer", "fr3"]])
def test_a_bundled_preset_stays_a_name(cell, given):
    fields = {"robot": {"preset": copy.deepcopy(given)}}
    move_paths(fields, cell, cell / "other")
    assert fields["robot"]["preset"] == given


def test_comments_and_order_are_kept(cell, found):
    target = cell / "other" / "new.yaml"
    text = with_problem(read_fields(cell / "cell.yaml"), cell, target, found).decode()
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
    plain = json.dumps(dict(read_fields(cell / "cell.yaml")))
    (cell / "cell.json").write_text(plain)
    target = cell / "new.json"
    fields = json.loads(with_problem(read_fields(cell / "cell.json"), cell, target, found))
    assert list(fields) == ["robot", "tube", "start", "goal", "obstacles"]


def test_another_tube_changes_radii_and_signs_alone(cell, found):
    target = cell / "new.yaml"
    target.write_bytes(with_problem(read_fields(cell / "cell.yaml"), cell, target, found))
    other = Tube(POINTS, 0.02, joint_signs={"joint2": "+"})
    text = with_other_tube(target, cell / "narrow.yaml", other).decode()
    before, after = target.read_text().splitlines(), text.splitlines()
    changed = [line.strip() for line in after if line not in before]
    assert changed == ["radius: [0.02, 0.02]", "joint_signs: {joint2: +}"]


@pytest.mark.parametrize("in_file", [True, False])
def test_points_are_written_where_the_file_has_others_or_more(cell, in_file):
    """From a file of points, or with one that repeats another: what is written stands alone."""
    points = [POINTS[0], *POINTS]
    fields = TEXT.replace("goal:", "g:").split("g:")[0] + "tube:\n  visit: ordered\n"
    turned = "  orientations: [[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 1]]\n"
    fields += "  rotation_tolerance: 3.0\n"
    if in_file:
        rows = [",".join(map(str, [*point, 0, 0, 0, 1, 0.1])) for point in points]
        (cell / "path.csv").write_text("\n".join(rows))
        fields += "  points: path.csv\n"
    else:
        fields += f"  points: {points}\n  radius: [0.1, 0.1, 0.1]\n{turned}"
    (cell / "many.yaml").write_text(fields)
    tube = load_problem(cell / "many.yaml").tube
    target = cell / "other" / "new.yaml"
    target.write_bytes(with_other_tube(cell / "many.yaml", target, tube.with_radius([0.2, 0.3])))
    again = load_problem(target).tube
    np.testing.assert_array_equal(again.points, POINTS)
    assert again.radius.tolist() == [0.2, 0.3]
    assert again.rotation_tolerance == (3.0, 3.0)
    assert again.notes == ()


def test_the_tools_speed_is_kept_where_the_tube_is(cell, found):
    """With another radius as it was written; with other points by segment; not in another tube."""
    target, again = cell / "new.json", cell / "again.yaml"
    tube = replace(found.tube, tool_speed=[None, 0.5])
    problem = found.with_tube(tube, found.goal)
    target.write_bytes(with_problem(dict(read_fields(cell / "cell.yaml")), cell, target, problem))
    assert json.loads(target.read_text())["tube"]["tool_speed"] == [None, 0.5]
    assert load_problem(target).tube.tool_speed.tolist() == [np.inf, 0.5]
    again.write_bytes(with_other_tube(target, again, tube.with_radius([0.2, 0.3])))
    assert load_problem(again).tube.tool_speed.tolist() == [np.inf, 0.5]
    fields = json.loads(target.read_text())
    twice = {key: [values[0], *values] for key, values in fields["tube"].items()}
    target.write_text(json.dumps(fields | {"tube": twice}))
    again.write_bytes(with_other_tube(target, again, load_problem(target).tube))
    assert load_problem(again).tube.tool_speed.tolist() == [np.inf, 0.5]
    again.write_bytes(with_problem(read_fields(target), cell, again, found))
    assert load_problem(again).tube.tool_speed is None


def test_a_file_of_obstacles_needs_no_more(cell):
    (cell / "only.yaml").write_text("obstacles: [{name: ball, sphere: 0.1}]\nclearance: 0.01\n")
    fields = new_fields("example:two_link", "hand", cell / "only.yaml")
    assert list(fields) == ["format", "version", "robot", "obstacles", "clearance"]


def test_a_file_without_obstacles_is_refused(cell):
    (cell / "none.yaml").write_text("clearance: 0.01\n")
    with pytest.raises(ProblemError, match=r"none.yaml: obstacles is required: a list of solids"):
        new_fields("example:two_link", "hand", cell / "none.yaml")


def test_a_malformed_file_is_refused_by_line(cell):
    (cell / "bad.yaml").write_text("obstacles: [\n")
    with pytest.raises(ProblemError, match=r"bad.yaml is malformed: line 1"):
        read_fields(cell / "bad.yaml")


BOXES = [None, {"box": [0.1, 0.04], "up": [0, 0, 1]}]


@pytest.mark.parametrize("name", ["new.yaml", "new.json"])
def test_boxes_are_written_and_read(cell, found, name):
    tube = Tube(POINTS, [0.1, None], cross_section=BOXES, joint_signs={"joint2": "+"})
    target = cell / name
    boxed = found.with_tube(tube, found.goal)
    target.write_bytes(with_problem(read_fields(cell / "cell.yaml"), cell, target, boxed))
    fields = read_fields(target)["tube"]
    assert fields["radius"] == [0.1, None]
    assert fields["cross_section"] == BOXES
    again = load_problem(target).tube
    np.testing.assert_array_equal(again.cross_section, tube.cross_section)
    np.testing.assert_array_equal(again.radius, tube.radius)
    narrow = with_other_tube(target, cell / f"narrow_{name}", tube.scaled(0.5))
    (cell / f"narrow_{name}").write_bytes(narrow)
    np.testing.assert_allclose(load_problem(cell / f"narrow_{name}").tube.radius, [0.05, 0.01])
    discs = with_other_tube(target, cell / f"discs_{name}", Tube(POINTS, 0.1))
    assert "cross_section" not in discs.decode()


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


def test_yaml_that_cannot_be_written_again_with_its_comments_is_refused(cell):
    # What separates lines for one reader is a space to another.
    (cell / "lines.yaml").write_text("robot: {urdf: example:two_link}\u2028tube: {radius: 1}\u2028")
    with pytest.raises(
        ProblemError, match=r"lines.yaml cannot be rewritten with its comments"
    ) as e:
        read_fields(cell / "lines.yaml")
    assert str(e.value).isprintable()
