"""Field paths: where they lead, what they make and scale, what is said of those to nowhere."""

import copy
import json
import re

import numpy as np
import pytest

from tubeplanner import load_problem, parse_problem
from tubeplanner.documents import parse_yaml
from tubeplanner.errors import OptionError, ProblemError
from tubeplanner.task.field_changes import (
    changed_problem,
    factor_of,
    parse_change,
    parse_variation,
    read_problem_fields,
)
from tubeplanner.task.problem_format import ProblemFields

DOCUMENT = {
    "robot": {"urdf": "arm.urdf", "tool_frame": "hand", "limits": {"velocity": 2}, "payload": None},
    "tube": {
        "points": [[0, 0, 0], [1, 0, 0], [1, 1, 0]],
        "radius": [0.1, None],
        "cross_section": [None, {"box": [0.2, 0.1], "up": [0, 0, 1]}],
        "joint_signs": [{"joint.1": "+"}, {}],
    },
    "start": {"joints": [0, 0]},
    "obstacles": [
        {"name": "front wall", "box": [1, 2, 3], "position": [0.5, 0, 0]},
        {"name": "post", "sphere": 0.1},
        {"name": "post.2", "sphere": 0.2},
        {"name": "0", "sphere": 0.3},
    ],
}


def changed(changes):
    """Return the document with changes; the original stays unchanged."""
    before = copy.deepcopy(DOCUMENT)
    after = changed_problem(DOCUMENT, changes)
    assert before == DOCUMENT
    return after


def at(data, *keys):
    for key in keys:
        data = data[key]
    return data


@pytest.mark.parametrize(
    ("path", "value", "keys"),
    [
        ("tube.radius", 0.2, ["tube", "radius"]),
        ("tube.joint_signs.0.joint.1", "-", ["tube", "joint_signs", 0, "joint.1"]),
        ("tube.cross_section.1.up.0", 1, ["tube", "cross_section", 1, "up", 0]),
        ("obstacles.front wall.position", [1, 2, 3], ["obstacles", 0, "position"]),
        ("obstacles.post.sphere", 1, ["obstacles", 1, "sphere"]),
        ("obstacles.post.2.sphere", 1, ["obstacles", 2, "sphere"]),
        ("obstacles.0.sphere", 1, ["obstacles", 3, "sphere"]),
        ("obstacles.post", {"name": "other"}, ["obstacles", 1]),
    ],
)
def test_a_path_leads_to_one_place(path, value, keys):
    after, expected = changed({path: value}), copy.deepcopy(DOCUMENT)
    at(expected, *keys[:-1])[keys[-1]] = value
    assert after == expected


def test_missing_keys_are_made_where_the_schema_has_them():
    result = changed(
        {"robot.payload.mass": 2, "robot.limits.effort.elbow": 3, "goal.joints": [1, 1]}
    )
    assert result["robot"]["payload"] == {"mass": 2}
    assert result["robot"]["limits"] == {"velocity": 2, "effort": {"elbow": 3}}
    assert result["goal"] == {"joints": [1, 1]}
    sections = changed({"tube.cross_section.0.box": [1, 2]})["tube"]["cross_section"]
    assert sections[0] == {"box": [1, 2]}


SECTIONS = {
    "": None,
    "robot.payload.": "PayloadFields",
    "robot.limits.": "LimitFields",
    "robot.limits.velocity_by_position.joint1.": "VelocityByPositionFields",
    "robot.tool_offset.": "ToolOffsetFields",
    "collision.": "CollisionFields",
    "objective.": "ObjectiveFields",
    "goal.": "EndpointFields",
    "obstacles.post.": "ObstacleFields",
}


@pytest.mark.parametrize("path", SECTIONS)
def test_every_field_of_the_schema_can_be_made(path):
    """Every key of the schema can be changed, also where the file leaves the key out."""
    schema = ProblemFields.model_json_schema(by_alias=True)
    fields = (schema["$defs"][SECTIONS[path]] if path else schema)["properties"]
    assert fields
    for key in fields.keys() - {"include"}:  # files are included before values are changed
        assert changed({f"{path}{key}": "the value"}) != DOCUMENT


def test_changes_are_made_in_their_order():
    inner_last = {"robot.payload": {"mass": 1, "com": [0, 0, 1]}, "robot.payload.mass": "x3"}
    assert changed(inner_last)["robot"]["payload"] == {"mass": 3, "com": [0, 0, 1]}
    assert inner_last["robot.payload"]["mass"] == 1
    outer_last = {"robot.payload.mass": 2, "robot.payload": {"mass": 1}}
    assert changed(outer_last)["robot"]["payload"] == {"mass": 1}


def test_a_factor_scales_every_number_below_and_nothing_else():
    assert changed({"tube.radius": "x0.5"})["tube"]["radius"] == [0.05, None]
    assert changed({"tube.radius.0": "x2"})["tube"]["radius"] == [0.2, None]
    assert changed({"tube.points": "x-2"})["tube"]["points"][2] == [-2, -2, 0]
    wall = changed({"obstacles.front wall": "x2"})["obstacles"][0]
    assert wall == {"name": "front wall", "box": [2, 4, 6], "position": [1, 0, 0]}
    flagged = changed({"collision": {"self": True, "ignore": []}, "robot": "x2"})
    assert flagged["robot"]["limits"] == {"velocity": 4}
    with pytest.raises(ProblemError, match="x2 has no number to scale"):
        changed({"collision": {"self": True}, "collision.self": "x2"})


def test_what_an_alias_stands_for_elsewhere_stays():
    shared = parse_yaml("tube: {points: [&a [1, 2, 3], *a], radius: &r [1, 2]}\nrobot: {x: *r}")
    assert changed_problem(shared, {"tube.points": "x2"})["tube"]["points"] == [[2, 4, 6]] * 2
    assert changed_problem(shared, {"tube.points.0.0": 9})["tube"]["points"][1] == [1, 2, 3]
    assert changed_problem(shared, {"tube.radius.0": 9})["robot"]["x"] == [1, 2]


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("tube.raduis", 1, "unknown key 'raduis' (did you mean 'radius'?); there is: route, "),
        ("obstacles.pots.sphere", 1, "unknown name 'pots' (did you mean 'post'?); there is: front"),
        ("tube.points.3", [0, 0, 0], "tube.points has no item '3'; there are 3, from 0 to 2"),
        ("tube.points.-1.0", 1, "tube.points has no item '-1'"),
        ("start.joints.0.a", 1, "start.joints.0 is 0, which has no parts; give it as a whole"),
        ("robot.attached.0.name", "a", "robot.attached is not given; give it as a whole"),
        ("", 1, "unknown key ''"),
        ("robot.tool_frame", "x2", "it is 'hand': x2 has no number to scale; give a value"),
        ("robot.gravity", "x0.5", "nothing is given there: x0.5 has no number to scale"),
    ],
)
def test_a_path_that_leads_nowhere_is_refused_by_name(path, value, message):
    with pytest.raises(ProblemError, match=re.escape(f"{path}: {message}")):
        changed({path: value})


def test_a_changed_value_is_checked_as_the_files_own(tmp_path):
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(DOCUMENT))
    with pytest.raises(ProblemError, match=r"mine\.json: tube\.radius is 'wide'; it must be a num"):
        read_problem_fields(path, {"tube.radius": "wide"})
    path.write_text("[1]")
    with pytest.raises(ProblemError, match=r"mine\.json: a problem is a map"):
        read_problem_fields(path, {"tube.radius": 1})


MOTORS = {
    "robot": {
        "urdf": "example:two_link",
        "tool_frame": "hand",
        "gravity": [0, 0, 0],
        "limits": {"effort": {"joint1": [90, 80]}},
        "motors": {"armature": [0.4, 0.2], "coulomb_friction": {"joint1": 2, "joint2": [1, 3]}},
    },
    "tube": {"points": [[0.6, 0, 0], [0.4, 0.4, 0]], "radius": 0.1},
    "start": {"seed": [0, 1]},
}
TABLE = {"joint1": {"position": [0, 2], "effort": [5, 9]}}


def test_problems_are_loaded_with_changes(bundled):
    plain = bundled("two_link/around_a_post")
    changes = {"tube.radius": "x0.5", "obstacles.post.position.0": 0.5}
    other = load_problem("example:two_link/around_a_post", changes=changes)
    np.testing.assert_array_equal(other.tube.radius, plain.tube.radius / 2)
    near, far = (each.obstacles[0].shapes[0].vertices.mean(axis=0) for each in (plain, other))
    np.testing.assert_allclose(far - near, [0.1, 0, 0], atol=1e-12)
    assert parse_problem(MOTORS, changes={"objective.slack": 0.25}).objective.slack == 0.25


@pytest.mark.parametrize(
    ("path", "value", "armature", "backwards", "forwards"),
    [
        (".armature", "x0.5", [0.2, 0.1], [2, 1], [2, 3]),
        (".coulomb_friction", "x2", [0.4, 0.2], [4, 2], [4, 6]),
        (".coulomb_friction.joint2.0", 5, [0.4, 0.2], [2, 5], [2, 3]),
        (".coulomb_friction.joint1", [5, 6], [0.4, 0.2], [5, 1], [6, 3]),
        ("", {}, [0, 0], [0, 0], [0, 0]),
    ],
)
def test_paths_lead_into_motors(path, value, armature, backwards, forwards):
    motors = parse_problem(MOTORS, changes={f"robot.motors{path}": value}).robot.motors
    np.testing.assert_allclose(motors.armature, armature)
    np.testing.assert_allclose(motors.backwards_friction, backwards)
    np.testing.assert_allclose(motors.forwards_friction, forwards)


@pytest.mark.parametrize(
    ("changes", "position", "backwards", "forwards"),
    [
        ({".joint1": "x0.5"}, [0], [45], [40]),
        ({"": TABLE}, [0, 2], [5, 9], [5, 9]),
        ({"": TABLE, ".joint1.effort.0": 7}, [0, 2], [7, 9], [7, 9]),
    ],
)
def test_paths_lead_into_effort_limits(changes, position, backwards, forwards):
    changes = {f"robot.limits.effort{path}": value for path, value in changes.items()}
    (table,) = parse_problem(MOTORS, changes=changes).robot.limits.effort_ranges
    np.testing.assert_array_equal(table.position, position)
    np.testing.assert_array_equal(table.backwards, backwards)
    np.testing.assert_array_equal(table.forwards, forwards)


WALL = "obstacles.front wall.position"


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("tube.radius=0.02", "tube.radius", 0.02),
        (" tube.radius = x0.5 ", "tube.radius", "x0.5"),
        (f"{WALL}=[0.6,0,0.2]", WALL, [0.6, 0, 0.2]),
        ("robot.payload={mass: 2}", "robot.payload", {"mass": 2}),
        ("robot.urdf=a=b", "robot.urdf", "a=b"),
        ("tube.joint_signs.elbow='+'", "tube.joint_signs.elbow", "+"),
    ],
)
def test_a_change_is_a_path_and_a_value_in_yaml(text, path, value):
    assert parse_change("--set", text) == (path, value)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a=1,2.5", [1, 2.5]),
        ("a=[0.01,0.02],[0.02,0.03]", [[0.01, 0.02], [0.02, 0.03]]),
        ("a=x0.5, x1,x2", ["x0.5", "x1", "x2"]),
        ("a={mass: 1}, null", [{"mass": 1}, None]),
    ],
)
def test_a_variation_is_a_list_without_its_brackets(text, values):
    assert parse_variation("--vary", text) == ("a", values)


@pytest.mark.parametrize("text", ["tube.radius", "=1", "tube.radius=", "", " = "])
def test_half_a_change_is_refused(text):
    with pytest.raises(OptionError, match=r"--set '.*': give FIELD.PATH=VALUE, such as"):
        parse_change("--set", text)
    with pytest.raises(OptionError, match=r"--vary '.*': give FIELD.PATH=V1,V2,..., such as"):
        parse_variation("--vary", text)


@pytest.mark.parametrize("text", ["a=[1", "a=1]", "a={", "a=1], [2"])
def test_malformed_values_are_refused(text):
    with pytest.raises(OptionError, match=r"--vary 'a=.*': the value is no YAML: line 1"):
        parse_variation("--vary", text)


FACTORS = {"x0.5": 0.5, "x2": 2, "x.5": 0.5, "x1e-3": 0.001, "x-1": -1}


@pytest.mark.parametrize("value", [*FACTORS, "x", "x2y", "xy", "2x", "xinf", 2, None])
def test_a_factor_is_an_x_before_a_number(value):
    assert factor_of(value) == FACTORS.get(value)
