"""Problem files with the robot at another place."""

import json

import pytest
import yaml

from gantry import FLOOR, gantry
from tubeplanner import load_problem
from tubeplanner.files.problem_file import with_placement

PLACE = {
    "robot.base": {"position": [-0.3, 0.1, 0.0], "rpy": [0.0, 0.0, -0.9]},
    "start": {"seed": [0.1, 0.2]},
    "goal": {"seed": {"along": 0.3, "across": 0.4}},
}


def written(source, target, changes=None):
    """Return what the file holds that a placement is written to."""
    target.write_bytes(with_placement(source, target, PLACE, changes))
    return yaml.safe_load(target.read_text())


@pytest.fixture
def other(tmp_path):
    folder = tmp_path / "other"
    folder.mkdir()
    return folder


def test_base_and_ends_are_others_and_all_else_stays(tmp_path, other):
    source = gantry(tmp_path, [FLOOR])
    source.write_text(source.read_text().replace("tube:", "tube:  # straight on"))
    before, fields = yaml.safe_load(source.read_text()), written(source, other / "best.yaml")
    assert fields["robot"].pop("base") == PLACE["robot.base"]
    assert (fields.pop("start"), fields.pop("goal")) == (PLACE["start"], PLACE["goal"])
    assert fields["robot"].pop("urdf") == "../gantry.urdf"
    before.pop("start")
    before["robot"].pop("urdf")
    assert fields == before
    text = (other / "best.yaml").read_text()
    assert "tube:  # straight on" in text
    assert "  base: {position: [-0.3, 0.1, 0.0], rpy: [0.0, 0.0, -0.9]}\n" in text
    assert load_problem(other / "best.yaml").robot.base.position == (-0.3, 0.1, 0.0)


def test_what_an_included_file_says_of_base_and_ends_no_longer_counts(tmp_path, other):
    cell = gantry(tmp_path, name="cell", goal={"position": [0.5, 0, 0], "tolerance": 0.001})
    fields = yaml.safe_load(cell.read_text())
    fields["robot"]["base"] = {"position": [1, 1, 1], "quaternion": [0, 0, 1, 1]}
    cell.write_text(yaml.safe_dump(fields))
    source = tmp_path / "problem.yaml"
    source.write_text("include: [cell.yaml]\ntube: {radius: 0.002}\nstart: {joints: [0, 0]}\n")
    assert written(source, other / "best.yaml")["include"] == ["../cell.yaml"]
    loaded = load_problem(other / "best.yaml")
    assert loaded.robot.base.quaternion is None
    assert loaded.robot.base.rpy == (0, 0, -0.9)
    assert loaded.start.joints.tolist() == [0.1, 0.2]
    assert loaded.goal.joints.tolist() == [0.3, 0.4]


def test_a_place_is_written_as_json_too_with_other_changes(tmp_path, other):
    written(gantry(tmp_path), other / "best.json", {"tube.radius": 0.002})
    fields = json.loads((other / "best.json").read_text())
    assert fields["robot"]["base"] == PLACE["robot.base"]
    assert fields["tube"]["radius"] == 0.002
