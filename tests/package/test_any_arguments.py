"""Any arguments, calls and changes are taken or refused in one line."""

import inspect
import json

import numpy as np
import pytest
from any_documents import CYCLE, PROBLEM, changed_documents, require_told
from any_values import NAMES, NUMBERS, VALUES, accepted, examples
from hypothesis import given
from hypothesis import strategies as st
from small_cycle import SMALL

import tubeplanner as t
from tubeplanner.cli.main import main
from tubeplanner.task.problem_format import problem_schema

# Any arguments make an object of the public API or raise one of our errors, never another's.
EYE = t.placement_of()
WALL = t.Obstacle.box("wall", [0.1, 0.1, 0.1], EYE)
STILL = {"joint_names": ["a"], "breakpoints": [0.0, 1.0], "coefficients": np.zeros((6, 1, 1))}
RIGHT = {
    "Tube": (t.Tube, {"points": [[0.3, 0, 0], [0.3, 0.3, 0]], "radius": [0.03]}),
    "box": (t.Obstacle.box, {"name": "wall", "size": [0.1, 0.1, 0.1], "placement": EYE}),
    "sphere": (t.Obstacle.sphere, {"name": "ball", "radius": 0.1, "placement": EYE}),
    "cylinder": (t.Obstacle.cylinder, {"name": "a", "radius": 0.1, "length": 1, "placement": EYE}),
    "mesh": (t.Obstacle.mesh, {"name": "part", "path": "no.stl", "placement": EYE}),
    "Obstacle": (t.Obstacle, {"name": "wall", "shapes": WALL.shapes}),
    "placement_of": (t.placement_of, {"position": [0, 0, 0], "rpy": [0, 0, 0]}),
    "Contact": (t.Contact, {"links": ("a", "b"), "within": 0.03}),
    "GoalRegion": (t.GoalRegion, {"position": np.zeros(3), "tolerance": 0.01}),
    "ToolPose": (t.ToolPose, {"placement": EYE}),
    "Objective": (t.Objective, {"slack": 0.1, "minimise": "energy"}),
    "PlanOptions": (t.PlanOptions, {}),
    "JointTrajectory": (t.JointTrajectory, STILL),
    "Payload": (t.Payload, {"mass": 1.0}),
    "ToolOffset": (t.ToolOffset, {}),
    "BasePose": (t.BasePose, {}),
    "PointSpeed": (t.PointSpeed, {"link": "hand", "position": (0.0, 0.0, 0.0), "speed": 1.0}),
    "LimitOverrides": (t.LimitOverrides, {"velocity": {"joint1": 3.0}}),
    "MotorOverrides": (t.MotorOverrides, {}),
    "Tolerance": (t.Tolerance, {}),
}


@pytest.mark.parametrize("what", RIGHT)
@examples(15)
@given(data=st.data())
def test_any_value_makes_an_object_or_is_refused(what, data):
    make, right = RIGHT[what]
    known = st.sampled_from(sorted(inspect.signature(make).parameters))
    names = data.draw(st.lists(known, min_size=1, max_size=2))
    arguments = {**right, **{name: data.draw(VALUES) for name in names}}
    repr(accepted(make, **arguments))


# Any change of fields, in Python or by --set, is made or refused in one line.
FILE = "example:two_link/around_a_post"
PATHS = st.text(max_size=12) | st.sampled_from(
    [
        *("", ".", "..", "tube.", ".tube", "tube..radius", "\x1b[31m", "include", "include.0"),
        *("tube", "tube.radius", "tube.points.1", "tube.points.1.0", "tube.joint_signs.joint2"),
        *("obstacles.post.position", "obstacles.0", "obstacles.nothing", "collision.ignore.0"),
        *("robot.limits.velocity", "robot.limits.velocity.joint1", "robot.motors.armature"),
        *("robot.payload", "robot.payload.mass", "robot.attached.0.name", "clearance"),
        *("clearance.default", "clearance.pairs.0.clearance", "collision.self", "format", "period"),
        *("objective.slack", "objective.duration", "goal", "goal.position.2", "start.seed.0"),
        *("start.joints", "robustness.mass", "moves.over.tube.radius", "moves.0.goal.joints"),
    ]
)
FACTORS = st.sampled_from(["x0.5", "x1e999", "x-1", "x1e308", "x.5", "x0"])
NEW = VALUES | FACTORS | NUMBERS | st.lists(NUMBERS, min_size=3, max_size=3)
CHANGES = VALUES | st.dictionaries(PATHS | st.integers() | st.none(), NEW, max_size=3)
TEXTS = st.text(max_size=8) | st.sampled_from(
    [
        *("0.02", "x0.5", "x1e999", ".nan", ".inf", "[0.1, 0.2]", "{a: 1}", "null", "true", "'"),
        *("[", "{", "&a [*a]", "*x", "!!python/object:os.system x", "1e400", "9" * 400),
        *("|", "[x0.5]"),
        *(
            "\x1b[31m",
            "- a",
            "~",
            "a: b: c",
            "<<: {}",
            "\u202e",
            "0x10",
            "1_0",
            "[x0.5]",
            "[" * 300,
        ),
    ]
)
OPTIONS = st.builds("{}={}".format, PATHS, TEXTS) | NAMES | st.text(max_size=10)


@pytest.mark.dear("each change is made from a file and by the command line")
@examples(15)
@given(st.just(PROBLEM) | changed_documents(PROBLEM, problem_schema(), 1), CHANGES)
def test_any_changes_of_a_problem_are_made_or_refused(document, changes):
    repr(accepted(t.parse_problem, document, changes=changes))


@examples(10)
@given(CHANGES)
def test_any_changes_of_a_cycle_or_a_file_are_made_or_refused(changes):
    repr(accepted(t.parse_cycle, CYCLE, changes=changes))
    repr(accepted(t.load_problem, FILE, changes=changes))


@pytest.fixture(scope="module")
def cycle_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("any") / "small.yaml"
    path.write_text(SMALL)
    return path


@examples(15)
@given(
    given=st.lists(OPTIONS, min_size=1, max_size=2),
    kind=st.sampled_from(["problem", "cycle", "robot"]),
    as_json=st.booleans(),
)
def test_any_set_is_made_or_refused_in_one_line(capfd, cycle_file, given, kind, as_json):
    file = {"problem": FILE, "cycle": str(cycle_file), "robot": "example:two_link"}[kind]
    words = ["info", file, *(word for each in given for word in ("--set", each))]
    status = main([*words, *(["--json"] * as_json)])
    require_told(status, *capfd.readouterr(), as_json)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("clearance", 0)], "changes are [('clearance', 0)]; give a map from field paths"),
        ({5: 1}, "5 is no field path; give text, such as 'tube.radius'"),
    ],
)
def test_changes_of_another_kind_are_named(changes, message):
    with pytest.raises(t.ProblemError) as caught:
        t.parse_problem(PROBLEM, changes=changes)
    assert str(caught.value).startswith(message)


def nested(depth):
    return [] if depth == 0 else [nested(depth - 1)]


def test_what_is_nested_too_deep_is_refused_in_documents_and_changes(tmp_path):
    too_deep = "lists and maps are nested more than 100 deep"
    with pytest.raises(t.ProblemError, match=f"^problem: {too_deep}"):
        t.parse_problem({**PROBLEM, "obstacles": nested(500)})
    with pytest.raises(t.ProblemError, match=f"^clearance: {too_deep}"):
        t.parse_problem(PROBLEM, changes={"clearance": nested(500)})
    path = tmp_path / "deep.json"
    path.write_text(json.dumps({**PROBLEM, "obstacles": nested(400)}))
    with pytest.raises(t.ProblemError, match=f"{path} is malformed: {too_deep}"):
        t.load_problem(path, changes={"tube.radius": 0.02})


def test_a_factor_of_a_number_that_no_float_can_be_is_refused():
    huge = {**PROBLEM, "clearance": 10**400}
    with pytest.raises(t.ProblemError, match=r"clearance: x0\.5 of a number that is too large"):
        t.parse_problem(huge, changes={"clearance": "x0.5"})


@pytest.mark.parametrize("value", [np.zeros(3), np.zeros(0), [np.zeros(3)]])
def test_arrays_in_a_document_are_blamed_on_it(value):
    with pytest.raises(t.ProblemError, match=r"^problem: top level: unknown key 'a'"):
        t.parse_problem({**PROBLEM, "a": value})
    with pytest.raises(t.ProblemError, match=r"^problem: format is "):
        t.parse_problem({**PROBLEM, "format": value})
