"""The schema that editors complete problem files with."""

import jsonschema
import pytest
from ruamel.yaml import YAML

from tubeplanner import parse_problem
from tubeplanner.problem.problem_format import problem_schema
from tubeplanner.resources import bundled_problems

SCHEMA = problem_schema()


@pytest.mark.parametrize("name", bundled_problems())
def test_bundled_problems_are_valid(name):
    fields = YAML(typ="safe", pure=True).load(bundled_problems()[name].read_text())
    jsonschema.Draft202012Validator(SCHEMA).validate(fields)


@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"start": {"jonts": [0]}}, ["start"]),
        ({"clearance": "wide"}, ["clearance"]),
        ({"tube": {"points": [[0, 0, 0]]}}, ["tube"]),
        ({"tube": {"points": [[0, 0, 0]], "radius": 1, "tool_speed": "x"}}, ["tube"]),
        (
            {"tube": {"points": [[0, 0, 0]], "radius": 1, "cross_section": {"box": [1, 1]}}},
            ["tube"],
        ),
        ({"tube": {"points": [[0, 0, 0]], "cross_section": None}}, ["tube"]),
    ],
)
def test_wrong_ones_are_not(change, path):
    path_of_two_link = bundled_problems()["two_link/around_a_post"]
    fields = YAML(typ="safe", pure=True).load(path_of_two_link.read_text())
    errors = list(jsonschema.Draft202012Validator(SCHEMA).iter_errors({**fields, **change}))
    assert [list(error.absolute_path) for error in errors] == [path]


def test_every_field_has_a_title_and_a_description():
    assert SCHEMA["title"] == "tubeplanner problem"
    for section in (SCHEMA, *SCHEMA["$defs"].values()):
        assert section["description"]
        for name, field in section["properties"].items():
            assert field.get("title") or "$ref" in field or "anyOf" in field or "const" in field
            assert field.get("description"), name


def test_physical_fields_say_their_unit():
    units = {
        "RobotFields": ["gravity", "locked_joints"],
        "TubeFields": [
            "points",
            "radius",
            "tool_radius",
            "joint_signs",
            "rotation_tolerance",
            "tool_speed",
        ],
        "PayloadFields": ["mass", "com", "inertia"],
        "LimitFields": [
            "effort",
            "velocity",
            "position",
            "acceleration",
            "jerk",
            "tool_speed",
            "effort_rate",
        ],
        "VelocityByPositionFields": ["deceleration", "offset", "lower", "upper"],
        "PointSpeedFields": ["position", "speed"],
        "ObstacleFields": ["box", "sphere", "cylinder", "capsule", "position", "rpy"],
        "EndpointFields": ["joints", "seed"],
        "PoseFields": ["position", "rpy"],
        "BaseFields": ["position", "rpy"],
    }
    for section, names in units.items():
        for name in names:
            field = SCHEMA["$defs"][section]["properties"][name]
            assert "[" in field["description"], name


@pytest.mark.parametrize(
    "end",
    [
        {"pose": {"position": [0.4, 0, 0.4], "rpy": [0, 0, 0]}, "seed": [0, 0, 0, 0, 0, 0]},
        {"pose": {"position": [0.4, 0, 0.4], "quaternion": [0, 0, 0, 1]}},
        {"group_state": "ready"},
        {"trajectory": "last.json"},
    ],
)
@pytest.mark.parametrize("include", ["cell.yaml", ["cell.yaml", "tool.yaml"]])
def test_named_ends_and_includes_are_valid(end, include):
    path = bundled_problems()["ur5/over_the_wall"]
    fields = YAML(typ="safe", pure=True).load(path.read_text())
    fields |= {"start": end, "goal": end, "include": include}
    jsonschema.Draft202012Validator(SCHEMA).validate(fields)


@pytest.mark.parametrize("radius", [None, 0.03, [0.03, None, 0.03]])
def test_boxes_are_valid(radius):
    path = bundled_problems()["ur5/over_the_wall"]
    fields = YAML(typ="safe", pure=True).load(path.read_text())
    box = {"box": [0.2, 0.04], "up": [0.5, 0, 1]}
    fields["tube"] |= {"radius": radius, "cross_section": [None, box, None] if radius else box}
    if radius is None:
        del fields["tube"]["radius"]
    jsonschema.Draft202012Validator(SCHEMA).validate(fields)
    tube = parse_problem(fields, path.parent).tube
    assert tube.is_box.tolist() == ([False, True, False] if radius else [True] * 3)
