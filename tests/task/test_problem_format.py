"""The problem file's format: fields, units, defaults; the kind of a document."""

import copy
import json

import jsonschema
import numpy as np
import pytest
from cases import refusal
from ruamel.yaml import YAML
from small_cycle import SMALL

from tubeplanner import ProblemError, load_problem
from tubeplanner.fields import check_fields
from tubeplanner.output.files.problem_file import read_fields
from tubeplanner.resources import bundled_problems
from tubeplanner.task.field_changes import read_problem_fields
from tubeplanner.task.problem_format import (
    ProblemFields,
    is_cycle,
    is_study,
    problem_schema,
    require_study,
)

MINIMAL_YAML = """\
robot: {urdf: arm.urdf, tool_frame: hand}
tube: {points: [[0, 0, 0], [1, 0, 0]], radius: 0.1}
start: {joints: [0, 0]}
"""
MINIMAL = {
    "robot": {"urdf": "arm.urdf", "tool_frame": "hand"},
    "tube": {"points": [[0, 0, 0], [1, 0, 0]], "radius": 0.1},
    "start": {"joints": [0, 0]},
}
ABSENT = object()
SCHEMA = problem_schema()
DEFS = SCHEMA["$defs"]
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def changed(location, value):
    """Return the least problem with one value replaced, added, or taken away."""
    data = copy.deepcopy(MINIMAL)
    *sections, key = location.split(".")
    section = data
    for name in sections:
        section = section.setdefault(name, {})
    if value is ABSENT:
        del section[key]
    else:
        section[key] = value
    return data


def fault(data):
    message = refusal(ProblemError, check_fields, ProblemFields, data, "my problem")
    assert message.startswith("my problem: ")
    return message.removeprefix("my problem: ")


def read(tmp_path, text, name="p.yaml"):
    (tmp_path / name).write_text(text, encoding="utf-8")
    return read_problem_fields(tmp_path / name)


def with_more(section, fields):
    """Return the least problem as YAML with fields added to its robot or its tube."""
    end = {"robot": "hand}", "tube": "0.1}"}[section]
    return MINIMAL_YAML.replace(end, f"{end[:-1]}, {fields}}}")


def bundled_fields(name):
    return YAML(typ="safe", pure=True).load(bundled_problems()[name].read_text("utf-8"))


@pytest.mark.parametrize(
    ("document", "cycle", "study"),
    [
        ({"format": "tubeplanner/cycle"}, True, False),
        ({"moves": []}, True, False),
        ({"format": "tubeplanner/study"}, False, True),
        ({"study": {}}, False, True),
        ({"format": "tubeplanner/problem", "tube": {}}, False, False),
        (["moves"], False, False),
    ],
)
def test_a_cycle_or_a_study_is_known_by_its_format_or_its_fields(document, cycle, study):
    assert is_cycle(document) is cycle
    assert is_study(document) is study


@pytest.mark.parametrize("read", [load_problem, read_fields])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (SMALL, r"c\.yaml: this is a cycle, .*; plan, check, info"),
        ("format: tubeplanner/study\n", r"c\.yaml: this is a study, .*; study takes it"),
    ],
)
def test_readers_of_problems_say_who_takes_cycles_and_studies(read, text, message, tmp_path):
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(ProblemError, match=message):
        read(tmp_path / "c.yaml")


def test_readers_of_studies_say_who_takes_others():
    require_study({"study": {}}, "s")
    for document, kind in (({"tube": {}}, "a problem"), ({"moves": []}, "a cycle")):
        with pytest.raises(ProblemError, match=f"^s: this is {kind}, where a study .*plan takes"):
            require_study(document, "s")


ENDPOINT = "joints, seed, position, tolerance, rotation_tolerance, pose, group_state, trajectory"
TOP = (
    "format, version, include, robot, tube, start, goal, obstacles, clearance, contacts, "
    "collision, objective, period, robustness, holding"
)
ROBOT = (
    "urdf, package_dirs, xacro_args, srdf, tool_frame, tool_offset, base, joints, "
    "locked_joints, gravity, payload, attached, limits, motors, preset, limits_file"
)
LIMITS = (
    "effort, velocity, position, acceleration, jerk, scale, tool_speed, tool_acceleration, "
    "velocity_tolerance, effort_rate, velocity_by_position, point_speed, "
    "position_margin"
)
MOTORS = (
    "armature, viscous_friction, coulomb_friction, saturation_effort, no_load_velocity, "
    "friction_from_urdf, friction_uncertainty"
)
TUBE = (
    "route, points, cross_section, radius, tool_radius, joint_signs, orientations, "
    "rotation_tolerance, tool_speed, process, events, tool_acceleration, visit, pass_through_points"
)
OBSTACLE = (
    "name, box, sphere, cylinder, capsule, mesh, points, size, scale, position, rpy, quaternion"
)


@pytest.mark.parametrize(
    ("section", "key", "meant", "known"),
    [
        ("robot", "toolframe", "tool_frame", ROBOT),
        ("robot.limits", "velocities", "velocity", LIMITS),
        ("robot.motors", "armatures", "armature", MOTORS),
        ("robot.base", "positon", "position", "position, rpy, quaternion"),
        ("tube", "radii", "radius", TUBE),
        ("goal", "joint", "joints", ENDPOINT),
        ("collision", "self_", "self", "self, ignore"),
    ],
)
def test_an_unknown_key_gets_a_suggestion_and_the_known_keys(section, key, meant, known):
    expected = f"{section}: unknown key '{key}' (did you mean '{meant}'?); there is: {known}"
    assert fault(changed(f"{section}.{key}", 1)) == expected


def test_so_does_one_of_the_top_level_or_of_a_list():
    hint = f"there is: {TOP}"
    message = f"top level: unknown key 'clearence' (did you mean 'clearance'?); {hint}"
    assert fault(changed("clearence", 1)) == message
    message = f"unknown key 'spere' (did you mean 'sphere'?); there is: {OBSTACLE}"
    solids = [{"name": "a", "sphere": 1}, {"name": "b", "spere": 1}]
    assert fault(changed("obstacles", solids)) == f"obstacles[1]: {message}"


@pytest.mark.parametrize(
    ("location", "value", "name"),
    [
        ("tube.radius", ABSENT, "tube.radius"),
        ("start", ABSENT, "start"),
        ("robot.payload", {"com": [0, 0, 0]}, "robot.payload.mass"),
        ("obstacles", [{"sphere": 1}], "obstacles[0].name"),
    ],
)
def test_a_required_field_that_is_missing_is_named(location, value, name):
    assert fault(changed(location, value)) == f"{name} is required"


NUMBER = "it must be a number"
PER_JOINT = "it must be one number for all joints, a list with one for each, or a map by name"
ONE_OR_TWO = "it must be a number, or [backwards, forwards]"
EFFORT = f"{NUMBER}, [backwards, forwards], or a map with position and effort"
TOLERANCE = "it must be one angle or three bounds [x, y, z] [rad], .inf where free"
SCALAR = "it must be a text, a number, true or false"


@pytest.mark.parametrize(
    ("location", "value", "message"),
    [
        ("tube.radius", [0.1, "wide"], f"[1] is 'wide'; {NUMBER}"),
        ("tube.points", 5, " is 5; it must be a list"),
        ("tube.points", [[0, 0, 0, 0]], "[0] has more than 3 "),
        ("tube.joint_signs", {"j": True}, ".j is True; true and false are no num"),
        ("tube.joint_signs", {"j": "x"}, ".j is 'x'; it must be '+', '-', "),
        ("tube.visit", "all", " is 'all'; it must be 'ordered' or 'any'"),
        ("tube.orientations", [[0, 0, 0]], "[0] has 3 values; 4 are needed"),
        ("tube.rotation_tolerance", [0.1, [0.1, 0.1]], f"[1] is [0.1, 0.1]; {TOLERANCE}"),
        ("tube.rotation_tolerance", [True], "[0] is True; it must be one a"),
        ("start", [0, 0], " is [0, 0]; it must be a map with joints, seed"),
        ("start.joints", ["a", 0], f"[0] is 'a'; {NUMBER}"),
        ("robot.urdf", 5, " is 5; it must be text"),
        ("robot.xacro_args", {"prefix": [1]}, f".prefix is [1]; {SCALAR}"),
        ("robot.gravity", [0, 0, None], f"[2] is empty; {NUMBER}"),
        ("robot.locked_joints", {None: 5}, ": the key None is no text; quote it"),
        ("robot.motors", 3, " is 3; it must be a map with armature, viscous_friction, "),
        ("robot.motors.armature", "a", f" is 'a'; {PER_JOINT}"),
        ("robot.motors.friction_from_urdf", "yes", " is 'yes'; it must be true or false"),
        ("robot.motors.coulomb_friction", [[1, 2, 3]], f"[0] is [1, 2, 3]; {ONE_OR_TWO}"),
        ("robot.limits.effort", {"j": [1, 2, 3]}, f".j is [1, 2, 3]; {EFFORT}"),
        ("robot.limits.position", {"elbow": [0, "x"]}, f".elbow[1] is 'x'; {NUMBER}"),
        ("robot.limits.jerk", True, f" is True; {PER_JOINT}"),
        ("robot.limits.velocity_by_position", {"j": {"deceleration": 6}}, ".j.offset is required"),
        ("robot.limits.point_speed", [{"link": "a", "position": [0, 0, 0]}], "[0].speed is requi"),
        ("clearance", "1 cm", f" is '1 cm'; {NUMBER}, or a map with default, pairs, segments"),
        ("collision", {"ignore": ["a"]}, ".ignore[0] is 'a'; it must be a list"),
        ("format", "toolpath", " is 'toolpath'; it must be 'tubeplanner/problem'"),
        ("version", 2, " is 2; 1 can be read; a newer tubeplanner may read it"),
    ],
)
def test_a_value_of_the_wrong_type_is_named_with_its_place(location, value, message):
    assert fault(changed(location, value)).startswith(f"{location}{message}")


def test_a_file_of_another_version_is_named_as_such_whatever_else_is_new_in_it():
    newer = {**MINIMAL, "version": 2, "novel": 1, "robot": {**MINIMAL["robot"], "novel": [1]}}
    assert fault(newer) == "version is 2; 1 can be read; a newer tubeplanner may read it"


@pytest.mark.parametrize("data", [None, [], "robot", 5])
def test_a_problem_that_is_no_map_is_refused(data):
    assert fault(data) == "a problem is a map with robot, tube and start"


@pytest.mark.parametrize(("location", "value"), [("tube.radius", np.inf), ("clearance", np.nan)])
def test_numbers_outside_limits_must_be_finite(location, value):
    assert fault(changed(location, value)) == f"{location} is {value}; it must be a finite number"


@pytest.mark.parametrize("quantity", ["effort", "velocity", "acceleration", "jerk", "effort_rate"])
def test_limits_may_be_infinite_or_open_on_one_side(tmp_path, quantity):
    more = f"limits: {{{quantity}: {{j: .inf}}, position: {{j: [-.inf, 1]}}}}"
    limits = read(tmp_path, with_more("robot", more)).robot.limits
    assert getattr(limits, quantity) == {"j": np.inf}
    assert limits.position == {"j": (-np.inf, 1)}
    tube = read(tmp_path, with_more("tube", "joint_signs: {j: [0.5, .inf]}")).tube
    assert tube.joint_signs == {"j": (0.5, np.inf)}


@pytest.mark.parametrize(
    ("written", "value"), [("0.1", 0.1), ("[0.1, [1, 1, .inf]]", [0.1, (1, 1, np.inf)])]
)
def test_a_rotation_tolerance_is_angles_or_triples(tmp_path, written, value):
    more = f"orientations: [[0, 0, 0, 1]], rotation_tolerance: {written}"
    tube = read(tmp_path, with_more("tube", more)).tube
    assert tube.rotation_tolerance == value
    assert tube.orientations == [(0, 0, 0, 1)]


@pytest.mark.parametrize(
    ("key", "shown"), [("a\nb", r"'a\nb'"), ("k" * 300, f"'{'k' * 59}..."), ("joint1", "joint1")]
)
def test_a_key_that_cannot_be_shown_or_is_long_is_quoted(key, shown):
    where = fault(changed("robot.limits.velocity", {key: "x"})).split(" is ")[0]
    assert where.startswith(f"robot.limits.velocity.{shown}")
    assert len(where) < 100


@pytest.mark.parametrize(
    ("prefix", "section"),
    [("", SCHEMA), ("robot.", DEFS["RobotFields"]), ("tube.", DEFS["TubeFields"])],
)
def test_defaults_may_be_written_out(prefix, section):
    plain = check_fields(ProblemFields, MINIMAL, "my problem")
    for name in (
        section["properties"].keys() - MINIMAL.keys() - {"urdf", "tool_frame", "points", "radius"}
    ):
        if name not in section.get("required", ()):
            default = section["properties"][name].get("default")
            assert check_fields(ProblemFields, changed(f"{prefix}{name}", default), "p") == plain


def test_arguments_of_a_macro_file_keep_their_types():
    arguments = {"prefix": "left_", "grip": True, "count": 2, "length": 0.5}
    values = check_fields(
        ProblemFields, changed("robot.xacro_args", arguments), "p"
    ).robot.xacro_args
    assert values == arguments
    assert [type(value) for value in values.values()] == [str, bool, int, float]


def test_yaml_and_json_say_the_same_in_frozen_fields(tmp_path):
    from_yaml = read(tmp_path, MINIMAL_YAML)
    assert from_yaml == read(tmp_path, json.dumps(MINIMAL), "p.json")
    assert from_yaml == check_fields(ProblemFields, MINIMAL, "my problem")
    with pytest.raises(ValueError, match="frozen"):
        from_yaml.clearance = 1.0


@pytest.mark.parametrize(
    ("written", "value"),
    [("1e-3", 1e-3), ("1E+1", 10.0), ("5", 5.0), (".5", 0.5), ("1_000.0", 1000.0), ("+2", 2.0)],
)
def test_numbers_are_read_as_people_write_them(tmp_path, written, value):
    fields = read(tmp_path, MINIMAL_YAML.replace("radius: 0.1", f"radius: {written}"))
    assert fields.tube.radius == value


@pytest.mark.parametrize(
    ("written", "sign"), [("+", "+"), ("-", "-"), ('"0"', "0"), ("0", 0), ("+1", 1), ("-1", -1)]
)
def test_signs_may_be_written_with_and_without_quotes(tmp_path, written, sign):
    fields = read(tmp_path, with_more("tube", f"joint_signs: {{j: {written}}}"))
    assert fields.tube.joint_signs == {"j": sign}


def test_a_byte_order_mark_does_no_harm_and_words_stay_words(tmp_path):
    """Older YAML took `on` for a truth value."""
    text = MINIMAL_YAML.replace("hand", "on")
    assert read(tmp_path, f"\ufeff{text}").robot.tool_frame == "on"


TWICE = MINIMAL_YAML + "start: {joints: [1, 1]}\n"


@pytest.mark.parametrize(
    ("name", "text", "fragments"),
    [
        ("p.yaml", TWICE, ['duplicate key "start"', "line 4"]),
        ("p.json", '{"robot": {"urdf": "a", "urdf": "b"}}', ["the key 'urdf' is given twice"]),
        ("p.yaml", "robot: [1,", ["line 1"]),
        ("p.yaml", "robot:\n\turdf: x", ["line 2", "cannot start any token"]),
        ("p.yaml", "robot: !!python/object:os.system {}", ["line 1", "could not determine"]),
        ("p.json", "", ["line 1 column 1"]),
    ],
)
def test_a_malformed_file_is_named_with_the_line(tmp_path, name, text, fragments):
    message = refusal(ProblemError, read, tmp_path, text, name)
    assert message.startswith(f"problem file {tmp_path / name} is malformed: ")
    assert "\n" not in message
    for fragment in fragments:
        assert fragment in message


def test_a_file_that_is_not_there_no_text_or_empty_is_named(tmp_path):
    path = tmp_path / "p.yaml"
    message = refusal(ProblemError, read_problem_fields, path)
    assert message == f"problem file {path} cannot be read: No such file or directory"
    path.write_bytes(b"\xff\xfe\x00")
    message = refusal(ProblemError, read_problem_fields, path)
    assert message.startswith(f"problem file {path} ")
    assert "'utf-8' codec can't decode byte 0xff in position 0" in message
    message = refusal(ProblemError, read, tmp_path, "# nothing yet\n")
    assert message == f"{path}: a problem is a map with robot, tube and start"


@pytest.mark.parametrize("literal", ["NaN", "Infinity", "-Infinity"])
def test_json_numbers_that_are_not_finite_are_refused(tmp_path, literal):
    text = json.dumps(MINIMAL).replace('"radius": 0.1', f'"radius": {literal}')
    with pytest.raises(ProblemError, match=r"tube\.radius is .*; it must be a finite number"):
        read(tmp_path, text, "p.json")


def test_the_schema_is_plain_json_closed_and_described_at_every_level():
    assert json.loads(json.dumps(SCHEMA)) == SCHEMA
    assert SCHEMA["title"] == "tubeplanner problem"
    for section in (SCHEMA, *DEFS.values()):
        assert section["type"] == "object"
        assert section["additionalProperties"] is False
        assert section["description"]
        for name, field in section["properties"].items():
            assert field.get("title") or "$ref" in field or "anyOf" in field or "const" in field
            assert field.get("description"), name


def test_the_schema_has_the_fields_of_the_contract():
    robot, tube = DEFS["RobotFields"], DEFS["TubeFields"]
    assert set(SCHEMA["required"]) == {"robot", "start"}  # route finds a tube
    assert set(robot["required"]) == {"urdf", "tool_frame"}
    assert tube["anyOf"] == [{"required": ["points"]}, {"required": ["route"]}]
    assert set(tube["then"]["required"]) == {"radius"}  # unless a file has it
    for section, names in (
        (SCHEMA, TOP),
        (robot, ROBOT),
        (tube, TUBE),
        (DEFS["LimitFields"], LIMITS),
        (DEFS["MotorFields"], MOTORS),
        (DEFS["ObstacleFields"], OBSTACLE),
        (DEFS["CollisionFields"], "self, ignore"),
    ):
        assert list(section["properties"]) == names.split(", ")


@pytest.mark.parametrize("name", bundled_problems())
def test_bundled_problems_fit_the_schema(name):
    fields = bundled_fields(name)
    VALIDATOR.validate(fields)
    assert read_problem_fields(bundled_problems()[name]).robot.urdf == fields["robot"]["urdf"]


POINTS = [[0, 0, 0]]
BOX = {"box": [0.2, 0.04], "up": [0.5, 0, 1]}


@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"start": {"jonts": [0]}}, ["start"]),
        ({"tube": {"points": POINTS}}, ["tube"]),
        ({"tube": {"points": POINTS, "radius": 1, "tool_speed": "x"}}, ["tube"]),
        ({"tube": {"points": POINTS, "radius": 1, "cross_section": {"box": [1, 1]}}}, ["tube"]),
    ],
)
def test_wrong_ones_do_not(change, path):
    errors = VALIDATOR.iter_errors(bundled_fields("two_link/around_a_post") | change)
    assert [list(error.absolute_path) for error in errors] == [path]


@pytest.mark.parametrize(
    "end",
    [
        {"pose": {"position": [0.4, 0, 0.4], "rpy": [0, 0, 0]}, "seed": [0, 0, 0, 0, 0, 0]},
        {"group_state": "ready"},
        {"trajectory": "last.json"},
    ],
)
def test_named_ends_and_includes_fit_it(end):
    fields = bundled_fields("ur5/over_the_wall") | {"start": end, "goal": end}
    for include in ("cell.yaml", ["cell.yaml", "tool.yaml"]):
        VALIDATOR.validate(fields | {"include": include})


def test_boxes_fit_it():
    fields = bundled_fields("ur5/over_the_wall")
    del fields["tube"]["radius"]
    mixed = {"radius": [0.03, None, 0.03], "cross_section": [None, BOX, None]}
    for more in ({"cross_section": BOX}, mixed):
        VALIDATOR.validate(fields | {"tube": fields["tube"] | more})
