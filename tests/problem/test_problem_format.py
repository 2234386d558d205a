"""The problem file's format: fields, units, defaults; the kind of a document."""

import copy
import json

import jsonschema
import numpy as np
import pytest
from ruamel.yaml import YAML
from small_cycle import SMALL

from tubeplanner import ProblemError, load_problem, parse_problem
from tubeplanner.files.problem_file import read_fields
from tubeplanner.problem.document_kind import is_cycle, is_study, require_study
from tubeplanner.problem.problem_fields import read_problem_fields
from tubeplanner.problem.problem_format import check_problem_fields, problem_schema
from tubeplanner.resources import bundled_problems

# Which files are cycles or studies, and what is said of a file of another kind.


@pytest.mark.parametrize(
    ("document", "expected"),
    [
        ({"format": "tubeplanner/cycle"}, True),
        ({"moves": []}, True),
        ({"format": "tubeplanner/problem", "tube": {}}, False),
        ({}, False),
        (["moves"], False),
        (None, False),
    ],
)
def test_a_cycle_is_known_by_its_format_or_its_moves(document, expected):
    assert is_cycle(document) is expected


@pytest.mark.parametrize("read", [load_problem, read_fields])
def test_what_takes_problems_refuses_cycles_and_says_what_takes_them(read, tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(SMALL)
    with pytest.raises(ProblemError, match=r"c\.yaml: this is a cycle, .*; plan, check, info"):
        read(path)


@pytest.mark.parametrize(
    ("document", "expected"),
    [({"format": "tubeplanner/study"}, True), ({"study": {}}, True), ({"moves": []}, False)],
)
def test_a_study_is_known_by_its_format_or_its_study(document, expected):
    assert is_study(document) is expected


@pytest.mark.parametrize("read", [load_problem, read_fields])
def test_what_takes_problems_refuses_studies_and_says_what_takes_them(read, tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text("format: tubeplanner/study\n")
    with pytest.raises(ProblemError, match=r"s\.yaml: this is a study, .*; study takes it"):
        read(path)


def test_what_takes_studies_says_what_takes_others():
    require_study({"study": {}}, "s")
    for document, kind in (({"tube": {}}, "a problem"), ({"moves": []}, "a cycle")):
        with pytest.raises(ProblemError, match=f"^s: this is {kind}, where a study .*plan takes"):
            require_study(document, "s")


# The problem file's shape: what is refused, by name, and what is understood.


MINIMAL = {
    "robot": {"urdf": "arm.urdf", "tool_frame": "hand"},
    "tube": {"points": [[0, 0, 0], [1, 0, 0]], "radius": 0.1},
    "start": {"joints": [0, 0]},
}
MINIMAL_YAML = """\
robot: {urdf: arm.urdf, tool_frame: hand}
tube: {points: [[0, 0, 0], [1, 0, 0]], radius: 0.1}
start: {joints: [0, 0]}
"""
ABSENT = object()


def changed(place, value):
    """Return the least problem with one value replaced, added, or taken away."""
    data = copy.deepcopy(MINIMAL)
    *sections, key = place.split(".")
    section = data
    for name in sections:
        section = section.setdefault(name, {})
    if value is ABSENT:
        del section[key]
    else:
        section[key] = value
    return data


def fault(data):
    with pytest.raises(ProblemError) as caught:
        check_problem_fields(data, "my problem")
    message = str(caught.value)
    assert message.startswith("my problem: ")
    return message.removeprefix("my problem: ")


def read(tmp_path, text, name="p.yaml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return read_problem_fields(path)


# --- names -------------------------------------------------------------------------------------

ENDPOINT = "joints, seed, position, tolerance, rotation_tolerance, pose, group_state, trajectory"
TOP = (
    "format, version, include, robot, tube, start, goal, obstacles, clearance, contacts, "
    "collision, objective, period, robustness"
)
ROBOT = (
    "urdf, package_dirs, xacro_args, srdf, tool_frame, tool_offset, base, joints, "
    "locked_joints, gravity, payload, attached, limits, motors, preset, limits_file"
)
LIMITS = "effort, velocity, position, acceleration, jerk, scale, tool_speed, "
LIMITS += "effort_rate, velocity_by_position, point_speed"
MOTORS = "armature, viscous_friction, coulomb_friction, saturation_effort, no_load_velocity, "
MOTORS += "friction_from_urdf, friction_uncertainty"
TUBE = "points, cross_section, radius, tool_radius, joint_signs, orientations, "
TUBE += "rotation_tolerance, tool_speed, visit, pass_through_points"
OBSTACLE = "name, box, sphere, cylinder, capsule, mesh, scale, position, rpy, quaternion"


@pytest.mark.parametrize(
    ("place", "value", "section", "key", "meant", "known"),
    [
        ("clearence", 1, "top level", "clearence", "clearance", TOP),
        ("robot.toolframe", "hand", "robot", "toolframe", "tool_frame", ROBOT),
        ("robot.limits.velocities", {}, "robot.limits", "velocities", "velocity", LIMITS),
        ("robot.motors.armatures", {}, "robot.motors", "armatures", "armature", MOTORS),
        (
            "robot.limits.effort",
            {"j": {"position": [0], "efort": [1]}},
            "robot.limits.effort.j",
            "efort",
            "effort",
            "position, effort",
        ),
        ("robot.payload", {"mas": 1}, "robot.payload", "mas", "mass", "mass, com, inertia"),
        ("robot.tool_offset.rpi", [0, 0, 0], "robot.tool_offset", "rpi", "rpy", "position, rpy"),
        (
            "robot.base.positon",
            [0, 0, 0],
            "robot.base",
            "positon",
            "position",
            "position, rpy, quaternion",
        ),
        ("tube.radii", 0.1, "tube", "radii", "radius", TUBE),
        ("start.joint", [0, 0], "start", "joint", "joints", ENDPOINT),
        ("goal", {"joint": [0, 0]}, "goal", "joint", "joints", ENDPOINT),
        ("obstacles", [{"name": "a", "boxx": 1}], "obstacles[0]", "boxx", "box", OBSTACLE),
        (
            "obstacles",
            [{"name": "a", "sphere": 1}, {"name": "b", "spere": 1}],
            "obstacles[1]",
            "spere",
            "sphere",
            OBSTACLE,
        ),
        ("collision.self_", True, "collision", "self_", "self", "self, ignore"),
    ],
)
def test_an_unknown_key_gets_a_suggestion_and_the_known_keys(
    place, value, section, key, meant, known
):
    expected = f"{section}: unknown key '{key}' (did you mean '{meant}'?); there is: {known}"
    assert fault(changed(place, value)) == expected


def test_an_unknown_key_that_resembles_nothing_gets_the_known_keys_only():
    assert fault(changed("xyz", 1)) == f"top level: unknown key 'xyz'; there is: {TOP}"


@pytest.mark.parametrize(
    ("place", "name"),
    [
        ("robot", "robot"),
        ("robot.urdf", "robot.urdf"),
        ("robot.tool_frame", "robot.tool_frame"),
        ("tube.points", "tube.points"),
        ("tube.radius", "tube.radius"),
        ("start", "start"),
    ],
)
def test_a_required_field_that_is_missing_is_named(place, name):
    assert fault(changed(place, ABSENT)) == f"{name} is required"


@pytest.mark.parametrize(
    ("place", "value", "name"),
    [
        ("robot.payload", {"com": [0, 0, 0]}, "robot.payload.mass"),
        ("obstacles", [{"sphere": 1}], "obstacles[0].name"),
    ],
)
def test_a_field_required_inside_an_optional_one_is_named(place, value, name):
    assert fault(changed(place, value)) == f"{name} is required"


# --- types -------------------------------------------------------------------------------------

NOT_A_NUMBER = "it must be a number"
PER_JOINT = "it must be one number for all joints, a list with one for each, or a map by name"
ONE_OR_TWO = "it must be a number, or [backwards, forwards]"


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        ("tube.radius", "wide", f"tube.radius is 'wide'; {NOT_A_NUMBER}"),
        ("tube.radius", True, f"tube.radius is True; {NOT_A_NUMBER}"),
        ("tube.radius", [0.1, "wide"], f"tube.radius[1] is 'wide'; {NOT_A_NUMBER}"),
        ("tube.points", [[0, 0, "x"]], f"tube.points[0][2] is 'x'; {NOT_A_NUMBER}"),
        ("tube.points", 5, "tube.points is 5; it must be a list"),
        ("tube.points", [[0, 0, 0, 0]], "tube.points[0] has more than 3 "),
        ("tube.points", [[0, 0], [1, 0]], "tube.points[0] has 2 "),
        ("start", [0, 0], "start is [0, 0]; it must be a map with joints, seed"),
        (
            "robot.motors",
            3,
            "robot.motors is 3; it must be a map with armature, viscous_friction, ",
        ),
        ("robot.motors.armature", "a", f"robot.motors.armature is 'a'; {PER_JOINT}"),
        (
            "robot.motors.armature",
            {"j": [1, 2]},
            f"robot.motors.armature.j is [1, 2]; {NOT_A_NUMBER}",
        ),
        (
            "robot.motors.coulomb_friction",
            True,
            f"robot.motors.coulomb_friction is True; {PER_JOINT}",
        ),
        (
            "robot.motors.coulomb_friction",
            [[1, 2, 3]],
            f"robot.motors.coulomb_friction[0] is [1, 2, 3]; {ONE_OR_TWO}",
        ),
        (
            "robot.motors.coulomb_friction",
            {"j": [1, "a"]},
            f"robot.motors.coulomb_friction.j is [1, 'a']; {ONE_OR_TWO}",
        ),
        (
            "robot.motors.friction_from_urdf",
            "yes",
            "robot.motors.friction_from_urdf is 'yes'; it must be true or false",
        ),
        (
            "robot.limits.effort",
            {"j": [1, 2, 3]},
            "robot.limits.effort.j is [1, 2, 3]; it must be a number, [backwards, forwards], or a "
            "map with position and effort",
        ),
        (
            "robot.limits.effort",
            {"j": {"position": [0], "effort": ["a"]}},
            f"robot.limits.effort.j.effort[0] is 'a'; {NOT_A_NUMBER}",
        ),
        ("robot.limits.effort", [[1, 2]], f"robot.limits.effort[0] is [1, 2]; {NOT_A_NUMBER}"),
        ("robot.limits.effort", {1: 5}, "robot.limits.effort: the key 1 is no text; quote it"),
        (
            "robot.locked_joints",
            {None: 5},
            "robot.locked_joints: the key None is no text; quote it",
        ),
        (
            "robot.locked_joints",
            {np.nan: 5},
            "robot.locked_joints: the key nan is no text; quote i",
        ),
        ("tube.joint_signs", {"j": True}, "tube.joint_signs.j is True; true and false are no num"),
        ("tube.visit", "all", "tube.visit is 'all'; it must be 'ordered' or 'any'"),
        ("tube.joint_signs", {"j": "x"}, "tube.joint_signs.j is 'x'; it must be '+', '-', "),
        ("tube.joint_signs", [{"j": 2}], "tube.joint_signs[0].j is 2; it must be '+', '-', "),
        ("tube.orientations", [[0, 0, 0]], "tube.orientations[0] has 3 values; 4 are needed"),
        ("tube.orientations", [0, 0, 0, 1], "tube.orientations[0] is 0; it must be a list"),
        ("tube.rotation_tolerance", "wide", "tube.rotation_tolerance is 'wide'; it must be a"),
        (
            "tube.rotation_tolerance",
            [0.1, [0.1, 0.1]],
            "tube.rotation_tolerance[1] is [0.1, 0.1]; it must be one angle or three bounds "
            "[x, y, z] [rad], .inf where free",
        ),
        ("tube.rotation_tolerance", [True], "tube.rotation_tolerance[0] is True; it must be one a"),
        ("tube.rotation_tolerance", [[0, 0, None]], "tube.rotation_tolerance[0] is [0, 0, None]; "),
        ("start.joints", ["a", 0], f"start.joints[0] is 'a'; {NOT_A_NUMBER}"),
        ("start.joints", {"j": "a"}, f"start.joints.j is 'a'; {NOT_A_NUMBER}"),
        ("robot.urdf", 5, "robot.urdf is 5; it must be text"),
        (
            "robot.xacro_args",
            {"prefix": [1]},
            "robot.xacro_args.prefix is [1]; it must be a text, a number, true or false",
        ),
        ("robot.gravity", [0, 0, None], "robot.gravity[2] is empty; it must be a number"),
        ("robot.joints", "joint1", "robot.joints is 'joint1'; it must be a list"),
        (
            "robot.limits.effort",
            {"elbow": "strong"},
            f"robot.limits.effort.elbow is 'strong'; {NOT_A_NUMBER}",
        ),
        (
            "robot.limits.position",
            {"elbow": [0, "x"]},
            f"robot.limits.position.elbow[1] is 'x'; {NOT_A_NUMBER}",
        ),
        (
            "robot.limits.jerk",
            "strong",
            "robot.limits.jerk is 'strong'; it must be one number for all joints, a list with one "
            "for each, or a map by name",
        ),
        ("robot.limits.jerk", True, "robot.limits.jerk is True; it must be one number for all"),
        ("robot.limits.jerk", [5, "x"], f"robot.limits.jerk[1] is 'x'; {NOT_A_NUMBER}"),
        (
            "robot.limits.velocity_by_position",
            {"elbow": {"deceleration": 6}},
            "robot.limits.velocity_by_position.elbow.offset is required",
        ),
        (
            "robot.limits.velocity_by_position",
            [None, {"deceleration": 6, "offset": 0, "uper": 1}],
            "robot.limits.velocity_by_position[1]: unknown key 'uper' (did you mean 'upper'?); "
            "there is: deceleration, offset, lower, upper",
        ),
        ("robot.limits.velocity_by_position", 5, "robot.limits.velocity_by_position is 5; it must"),
        (
            "robot.limits.point_speed",
            [{"link": "hand", "position": [0, 0, 0]}],
            "robot.limits.point_speed[0].speed is required",
        ),
        (
            "robot.limits.point_speed",
            {"link": "hand"},
            "robot.limits.point_speed is {'link': 'hand'}; it must be a list",
        ),
        (
            "clearance",
            "1 cm",
            "clearance is '1 cm'; it must be a number, or a map with default, pairs, segments",
        ),
        (
            "obstacles",
            [{"name": "a", "sphere": "1"}],
            f"obstacles[0].sphere is '1'; {NOT_A_NUMBER}",
        ),
        ("collision", {"ignore": ["a"]}, "collision.ignore[0] is 'a'; it must be a list"),
        ("format", "toolpath", "format is 'toolpath'; it must be 'tubeplanner/problem'"),
        ("version", 2, "version is 2; it must be 1"),
    ],
)
def test_a_value_of_the_wrong_type_is_named_with_its_place(place, value, message):
    assert fault(changed(place, value)).startswith(message)


@pytest.mark.parametrize("data", [None, [], "robot", 5])
def test_a_problem_that_is_no_map_is_refused(data):
    assert fault(data) == "a problem is a map with robot, tube and start"


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan])
@pytest.mark.parametrize(
    "place",
    [
        "tube.radius",
        "tube.tool_radius",
        "clearance",
        "robot.limits.scale.effort",
        "robot.locked_joints.j",
        "start.joints.j",
    ],
)
def test_numbers_outside_limits_must_be_finite(place, value):
    data = changed("start.joints", {})
    *sections, key = place.split(".")
    section = data
    for name in sections:
        section = section.setdefault(name, {})
    section[key] = value
    assert fault(data) == f"{place} is {value}; it must be a finite number"


@pytest.mark.parametrize("quantity", ["effort", "velocity", "acceleration", "jerk", "effort_rate"])
def test_limits_may_be_infinite(tmp_path, quantity):
    text = MINIMAL_YAML.replace("hand}", f"hand, limits: {{{quantity}: {{j: .inf}}}}}}")
    limits = read(tmp_path, text).robot.limits
    assert getattr(limits, quantity) == {"j": np.inf}


def test_position_limits_and_joint_ranges_may_be_open_on_one_side(tmp_path):
    text = MINIMAL_YAML.replace("hand}", "hand, limits: {position: {j: [-.inf, 1]}}}")
    text = text.replace("radius: 0.1", "radius: 0.1, joint_signs: {j: [0.5, .inf]}")
    fields = read(tmp_path, text)
    assert fields.robot.limits.position == {"j": (-np.inf, 1)}
    assert fields.tube.joint_signs == {"j": (0.5, np.inf)}


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("0.1", 0.1),
        ("[0.1]", [0.1]),
        ("[[0.1, 0.2, .inf]]", [(0.1, 0.2, np.inf)]),
        ("[0.1, [1, 1, 1]]", [0.1, (1, 1, 1)]),
    ],
)
def test_a_rotation_tolerance_is_angles_or_triples(tmp_path, written, value):
    more = f"radius: 0.1, orientations: [[0, 0, 0, 1]], rotation_tolerance: {written}"
    tube = read(tmp_path, MINIMAL_YAML.replace("radius: 0.1", more)).tube
    assert tube.rotation_tolerance == value
    assert tube.orientations == [(0, 0, 0, 1)]


@pytest.mark.parametrize(
    ("key", "told"), [("a\nb", r"'a\nb'"), ("k" * 300, f"'{'k' * 59}..."), ("joint1", "joint1")]
)
def test_a_key_that_cannot_be_shown_or_is_long_is_quoted(key, told):
    where = fault(changed("robot.limits.velocity", {key: "x"})).split(" is ")[0]
    assert where.startswith(f"robot.limits.velocity.{told}")
    assert len(where) < 100


# --- defaults ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("place", "default"),
    [
        ("robot.srdf", None),
        ("tube.orientations", None),
        ("tube.rotation_tolerance", None),
        ("tube.tool_speed", None),
        ("robot.limits", {"tool_speed": None}),
        ("tube.visit", "ordered"),
        ("robot.joints", None),
        ("robot.payload", None),
        ("goal", None),
        ("format", "tubeplanner/problem"),
        ("version", 1),
    ],
)
def test_defaults_may_be_written_out(place, default):
    assert check_problem_fields(changed(place, default), "my problem") == check_problem_fields(
        MINIMAL, "my problem"
    )


# --- files -------------------------------------------------------------------------------------


def test_yaml_and_json_say_the_same(tmp_path):
    from_yaml = read(tmp_path, MINIMAL_YAML)
    assert from_yaml == read(tmp_path, json.dumps(MINIMAL), "p.json")
    assert from_yaml == check_problem_fields(MINIMAL, "my problem")


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
    signs = f"radius: 0.1, joint_signs: {{j: {written}}}"
    fields = read(tmp_path, MINIMAL_YAML.replace("radius: 0.1", signs))
    assert fields.tube.joint_signs == {"j": sign}


def test_words_that_older_yaml_took_for_truth_values_stay_words(tmp_path):
    fields = read(tmp_path, MINIMAL_YAML.replace("hand", "on"))
    assert fields.robot.tool_frame == "on"


@pytest.mark.parametrize(
    ("name", "text", "fragments"),
    [
        ("p.yaml", MINIMAL_YAML + "start: {joints: [1, 1]}\n", ['duplicate key "start"', "line 4"]),
        (
            "p.yaml",
            MINIMAL_YAML.replace("[0, 0]}", "{j: 0, j: 1}}"),
            ['duplicate key "j"', "line 3"],
        ),
        ("p.json", '{"robot": {"urdf": "a", "urdf": "b"}}', ["the key 'urdf' is given twice"]),
        ("p.yaml", "robot: [1,", ["line 1"]),
        ("p.yaml", "robot:\n\turdf: x", ["line 2", "cannot start any token"]),
        ("p.yaml", "robot: !!python/object:os.system {}", ["line 1", "could not determine"]),
        ("p.json", '{"robot": 1,', ["line 1 column 13"]),
        ("p.json", "", ["line 1 column 1"]),
    ],
)
def test_a_malformed_file_is_named_with_the_line(tmp_path, name, text, fragments):
    with pytest.raises(ProblemError) as caught:
        read(tmp_path, text, name)
    message = str(caught.value)
    assert message.startswith(f"problem file {tmp_path / name} is malformed: ")
    assert "\n" not in message
    for fragment in fragments:
        assert fragment in message


def test_a_file_that_is_no_text_is_named(tmp_path):
    (tmp_path / "p.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ProblemError) as caught:
        read_problem_fields(tmp_path / "p.yaml")
    assert str(caught.value).startswith(f"problem file {tmp_path / 'p.yaml'} ")
    assert "'utf-8' codec can't decode byte 0xff in position 0" in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ProblemError) as caught:
        read_problem_fields(tmp_path / "p.yaml")
    path = tmp_path / "p.yaml"
    assert str(caught.value) == f"problem file {path} cannot be read: No such file or directory"


def test_a_byte_order_mark_does_no_harm(tmp_path):
    (tmp_path / "p.yaml").write_text(MINIMAL_YAML, encoding="utf-8-sig")
    assert read_problem_fields(tmp_path / "p.yaml").robot.tool_frame == "hand"


def test_an_empty_file_is_no_problem(tmp_path):
    with pytest.raises(ProblemError, match="a problem is a map with robot, tube and start"):
        read(tmp_path, "# nothing yet\n")


@pytest.mark.parametrize("literal", ["NaN", "Infinity", "-Infinity"])
def test_json_numbers_that_are_not_finite_are_refused(tmp_path, literal):
    text = json.dumps(MINIMAL).replace('"radius": 0.1', f'"radius": {literal}')
    with pytest.raises(ProblemError, match=r"tube\.radius is .*; it must be a finite number"):
        read(tmp_path, text, "p.json")


def test_the_fields_cannot_be_changed_after_reading():
    fields = check_problem_fields(MINIMAL, "my problem")
    with pytest.raises(ValueError, match="frozen"):
        fields.clearance = 1.0


# --- schema ------------------------------------------------------------------------------------


def resolve(schema, part):
    """Return the object schema behind a property: a reference, or the one choice that is one."""
    for choice in [part, *part.get("anyOf", []), part.get("items", {})]:
        if "$ref" in choice:
            return schema["$defs"][choice["$ref"].rpartition("/")[2]]
    return None


def require_valid(schema, section, data):
    """Assert that a map has the required keys and only known ones, down to every section."""
    assert set(section.get("required", [])) <= set(data)
    if "then" in section and not isinstance(data["points"], str):
        assert set(section["then"]["required"]) <= set(data)
    assert set(data) <= set(section["properties"])
    for key, value in data.items():
        below = resolve(schema, section["properties"][key])
        for item in value if isinstance(value, list) else [value]:
            if below is not None and isinstance(item, dict):
                require_valid(schema, below, item)


def test_the_schema_is_plain_json_and_closed_at_every_level():
    schema = problem_schema()
    assert json.loads(json.dumps(schema)) == schema
    for section in [schema, *schema["$defs"].values()]:
        assert section["type"] == "object"
        assert section["additionalProperties"] is False


def test_the_schema_asks_for_what_the_contract_asks_for():
    schema = problem_schema()
    robot, tube = (resolve(schema, schema["properties"][name]) for name in ("robot", "tube"))
    assert set(schema["required"]) == {"robot", "start"}  # route finds a tube
    assert set(robot["required"]) == {"urdf", "tool_frame"}
    assert set(tube["required"]) == {"points"}
    assert set(tube["then"]["required"]) == {"radius"}  # unless a file has the points
    limits = resolve(schema, robot["properties"]["limits"])
    motors = resolve(schema, robot["properties"]["motors"])
    collision = resolve(schema, schema["properties"]["collision"])
    obstacle = resolve(schema, schema["properties"]["obstacles"])
    for section, names in (
        (schema, TOP),
        (robot, ROBOT),
        (tube, TUBE),
        (limits, LIMITS),
        (motors, MOTORS),
        (obstacle, OBSTACLE),
        (collision, "self, ignore"),
    ):
        assert list(section["properties"]) == names.split(", ")


@pytest.mark.parametrize("path", bundled_problems().values(), ids=bundled_problems().keys())
def test_bundled_problems_fit_the_schema(path):
    schema = problem_schema()
    data = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    require_valid(schema, schema, data)
    assert read_problem_fields(path).robot.urdf == data["robot"]["urdf"]


def test_the_schema_check_itself_can_fail():
    schema = problem_schema()
    for broken in (changed("robot.urdff", "x"), changed("tube.radius", ABSENT)):
        with pytest.raises(AssertionError):
            require_valid(schema, schema, broken)


def test_arguments_of_a_macro_file_keep_their_types():
    given = {"prefix": "left_", "grip": True, "count": 2, "length": 0.5}
    fields = check_problem_fields(changed("robot.xacro_args", given), "p")
    kept = fields.robot.xacro_args
    assert kept == given
    assert [type(value) for value in kept.values()] == [str, bool, int, float]


# The schema that editors complete problem files with.


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
