"""Any arguments of a public function or command are taken or refused; nothing is planned here."""

import math
from contextlib import nullcontext, suppress
from pathlib import Path

import numpy as np
import pytest
from any_documents import PROBLEM as DOCUMENT
from any_documents import changed_documents, require_told, written
from any_values import LINE, VALUES, accepted, arm, examples
from hypothesis import given
from hypothesis import strategies as st
from small_cycle import small_cycle
from studied import Here, small_study

import tubeplanner as t
from tubeplanner.cli import console
from tubeplanner.cli.main import main
from tubeplanner.outcome import Infeasible, Location, PlanStatus
from tubeplanner.planning import legs
from tubeplanner.planning.result import refused_result
from tubeplanner.studies import explanation as explain_module
from tubeplanner.studies import placement, rows
from tubeplanner.studies import plan_many as plan_many_module
from tubeplanner.studies.tubes import measurement as sign_patterns
from tubeplanner.studies.tubes import measurement as tube_measurement
from tubeplanner.studies.tubes import route
from tubeplanner.studies.tubes import teach as teach_module
from tubeplanner.task.problem_format import problem_schema

FILE = "example:two_link/around_a_post"
PROBLEM = t.PlanningProblem(
    arm(), t.Tube(LINE, 0.03, joint_signs={"joint2": "-"}), t.Seed(np.array([0.0, -1.0]))
)
CYCLE = small_cycle()
STUDY = small_study()
STILL = t.JointTrajectory(["joint1", "joint2"], [0.0, 1.0], np.zeros((6, 1, 2)))
TRAIL = np.array([[0.0, -1.0], [0.3, -1.0], [0.5, -0.8]])
Q = np.zeros((5, 2))
NAMED = [FILE, "none.yaml", Path("."), "", "example:", "example:x/y", "a\0b", "x" * 300]
# By the names of arguments: values that are right somewhere. The first is right everywhere.
GIVEN = {
    "problem": [PROBLEM, CYCLE, FILE, "none.yaml", Path("x")],
    "file": [FILE, "none.yaml", PROBLEM],
    "other": [PROBLEM, CYCLE, None],
    "problems": [[PROBLEM], [FILE], [5], [None, PROBLEM], "abc", PROBLEM],
    "options": [
        *(None, t.PlanOptions(), t.PlanOptions("suh-bishop"), t.TeachOptions(), t.RouteOptions()),
        {},
    ],
    "measure_options": [None, t.MeasureOptions(), t.PlanOptions()],
    "place_options": [t.PlaceOptions(points=1), t.PlanOptions(), 5],
    "radii": [[0.02], np.array([0.01, 0.02]), [], [0], [math.nan], 0.02, ["a"], [10**400]],
    "scales": [None, [1], np.array([1.0, 2.0]), [0]],
    "methods": [["refinement"], "refinement", ["x"], [], [[]], [None]],
    "region": [[0, 0.1, 0, 0.1], [0, 0.1, 0, 0.1, 0, 1], [1, 0, 0, 1], [0, math.inf, 0, 1], "abcd"],
    "stands_on": [["post"], [], ["x"], "post", [5]],
    "changes": [None, {}, {"tube.radius": 0.02}, {"x": 1}, {5: 1}],
    "path": ["tube.radius", "obstacles.post.position", "objective.slack", "x", ""],
    "values": [[0.02], ["x2"], [], np.array([0.01]), [None], "ab"],
    "time_limit": [1.0, 0, -1, None, "a", math.nan, math.inf],
    "executor": [Here(), 5],
    "progress": [None, lambda what: None, 5],
    "journal": [None, "/nonexistent/x", "/dev/null", 5],
    "trail": [TRAIL, Q, TRAIL[:1], np.zeros((0, 2)), TRAIL.tolist(), TRAIL * np.nan],
    "samples": [TRAIL, Q, np.zeros(3), TRAIL.tolist()],
    "joint_names": [["joint1", "joint2"], ["joint1"], ["joint1", "joint1", "joint2"], "ab"],
    "robot": [arm(), PROBLEM, None],
    "trajectory": [STILL, None, TRAIL],
    "tolerance": [None, t.Tolerance(), 0.1],
    "q": [Q, np.zeros(2), np.zeros((5, 3))],
    "v": [Q, np.zeros((4, 2))],
    "a": [Q],
    "jerk": [None, Q],
    "segment": [None, np.zeros(5, int), np.zeros(5), np.full(5, 99), np.zeros(3, int)],
    "directory": [".", "/nonexistent", Path("/")],
    "name": NAMED,
    "reads_tube": [True, 0],
    "study": [STUDY, FILE],
    "urdf": ["example:two_link", "x", "", 5],
    "tool_frame": ["hand", "x", 5],
    "joints": [None, ["joint1"], "joint1", [], [5]],
    "locked_joints": [None, {"joint1": 1.0}, {"x": 1}, {"joint1": "a"}, []],
    "tool_offset": [None, t.ToolOffset(), 5],
    "base": [None, t.BasePose(), 5],
    "gravity": [(0, 0, -9.81), "abc", (0, 0), [None] * 3, [[0, 0, 0]]],
    "payload": [None, t.Payload(1.0), 5],
    "limits": [None, t.LimitOverrides(velocity={"joint1": 1.0}), [], [5]],
    "motors": [None, t.MotorOverrides(), 5],
    "package_dirs": [(), ["."], "abc", [5]],
    "xacro_args": [None, {"a": 1}, {5: 5}],
}


def replanned(problem, options, other, progress):
    return t.Planner(problem, options).replan(other, progress)


def planned_many(problems, options, executor):
    return list(t.plan_many(problems, options, executor))


# The arguments of functions; `a=b` stands for an argument a whose values are those of b.
FUNCTIONS = {
    "plan": "problem options progress",
    "replanned": "problem options other progress",
    "planned_many": "problems options executor",
    "sweep": "problem radii scales options executor progress",
    "sweep_field": "problem=file path values changes options executor progress",
    "compare": "problem methods options progress",
    "explain": "problem=file changes options time_limit executor progress",
    "place": "problem=file region stands_on changes options=place_options executor journal "
    "progress",
    "measure_tube": "problem options=measure_options progress",
    "survey_patterns": "problem options=measure_options progress",
    "teach": "problem trail options progress",
    "joint_trail": "robot joint_names samples",
    "find_route": "problem options progress",
    "verify": "problem trajectory tolerance",
    "trajectory_peaks": "robot trajectory",
    "lower_bound": "task=problem",
    "scaling_factor": "problem q v a jerk segment",
    "load_problem": "name directory reads_tube changes",
    "load_cycle": "name directory changes",
    "load_study": "name directory",
    "run_study": "study journal executor progress",
    "load_robot": "urdf tool_frame joints locked_joints tool_offset base gravity payload limits "
    "motors package_dirs xacro_args directory",
}


def function_of(name):
    """Return a function and the kinds of its arguments by their names."""
    function = {"replanned": replanned, "planned_many": planned_many}.get(name)
    pairs = [word.split("=") for word in FUNCTIONS[name].split()]
    return function or getattr(t, name), {pair[0]: pair[-1] for pair in pairs}


@pytest.fixture(autouse=True, scope="module")
def nothing_is_planned():
    """Planning, measuring and searching end at once without an answer."""
    blocked = Infeasible(PlanStatus.NO_TRAJECTORY, "not planned here", Location())

    def refused(*arguments, **named):
        return refused_result(blocked, "refinement")

    def raises(*arguments, **named):
        raise blocked

    with pytest.MonkeyPatch.context() as patch:
        for module in (placement, explain_module):
            patch.setattr(module, "plan", refused)
        for module in (plan_many_module, rows):
            patch.setattr(module, "plan_task", refused)
        for module in (plan_many_module, rows):
            patch.setattr(module, "WorkerProcesses", lambda: nullcontext(Here()))
        patch.setattr(console, "workers_of", lambda *arguments: nullcontext(None))
        patch.setattr(legs, "_shortest", refused)
        patch.setattr(tube_measurement, "_segments_of_some_branch", raises)
        patch.setattr(teach_module, "_corners", raises)
        patch.setattr(route, "goal_configurations", raises)
        patch.setattr(sign_patterns, "_row", raises)
        yield


@pytest.mark.dear("eight calls of every function")
@pytest.mark.parametrize("name", FUNCTIONS)
@examples(8)
@given(data=st.data())
def test_any_arguments_are_taken_or_refused(name, data):
    function, kinds = function_of(name)
    arguments = {key: GIVEN[kind][0] for key, kind in kinds.items()}
    for key in data.draw(st.lists(st.sampled_from(list(kinds)), min_size=1, max_size=2)):
        arguments[key] = data.draw(st.sampled_from(GIVEN[kinds[key]]) | VALUES)
    with suppress(Infeasible):  # what is stubbed says that there is no answer
        repr(accepted(function, **arguments))


@pytest.mark.parametrize(
    ("name", "argument", "value", "message"),
    [
        ("plan", "options", t.RouteOptions(), "options are RouteOptions(seed=1, edges=300000"),
        ("plan", "progress", 5, "progress is 5; give a function, which is called with every stage"),
        ("planned_many", "problems", FILE, f"problems are '{FILE}'; give a list or a generator"),
        ("planned_many", "executor", [], "executor is []; give one of concurrent.futures"),
        ("sweep", "radii", ["a"], "radius is 'a'; it must be > 0 and finite"),
        ("sweep", "radii", [10**400], "radius is 1000"),
        ("sweep", "radii", 0.02, "radius is 0.02; give a list of numbers"),
        ("sweep", "progress", {}, "progress is {}; give a function"),
        ("sweep_field", "path", ["tube"], "['tube'] is no field path; give text"),
        ("sweep_field", "values", {0.02: 1}, "values is {0.02: 1}; give a list of what tube"),
        ("compare", "methods", [["refinement"]], "unknown method ['refinement']"),
        ("explain", "time_limit", None, "time_limit is None; it must be a number > 0"),
        ("explain", "executor", 5, "executor is 5; give one of concurrent.futures"),
        ("place", "region", 1.0, "region is 1.0; give a list of four or six numbers"),
        ("place", "journal", 5, "journal is 5; give a path"),
        ("measure_tube", "problem", FILE, f"the problem is '{FILE}'; give a PlanningProblem"),
        ("survey_patterns", "options", t.PlanOptions(), "options are PlanOptions(method"),
        ("teach", "trail", TRAIL * np.nan, "the trail has values that are not finite"),
        ("teach", "trail", TRAIL[0], "the trail has the shape (2,); give samples, 2 num"),
        ("joint_trail", "joint_names", "ab", "joint_names is 'ab'; give a list of names"),
        ("joint_trail", "robot", None, "the robot is None; give a RobotModel"),
        ("find_route", "problem", FILE, f"the problem is '{FILE}'; give a PlanningProblem"),
        ("verify", "tolerance", 0.1, "the tolerance is 0.1; give Tolerance"),
        ("trajectory_peaks", "trajectory", TRAIL, "the trajectory is array([[ 0. , -1. ],"),
        ("scaling_factor", "v", np.zeros((4, 2)), "v has the shape (4, 2); give (N, 2), as many"),
        ("scaling_factor", "segment", [0, 0, 0, 0, 9], "segment is [0, 0, 0, 0, 9]; give 5 whole"),
        ("load_problem", "directory", 5, "directory is 5; give a path"),
        ("run_study", "study", FILE, f"the study is '{FILE}'; give a Study"),
        ("load_robot", "gravity", [None] * 3, "robot.gravity [None, None, None] must be three"),
        ("load_robot", "locked_joints", [1], "robot.locked_joints is [1]; give a map by name"),
        ("load_robot", "xacro_args", {5: 5}, "robot.xacro_args: the key 5 is no name; give text"),
        ("load_robot", "payload", 5, "robot.payload is 5; give a Payload"),
        ("load_robot", "joints", 5, "robot.joints is 5; give a list of names"),
        ("load_robot", "tool_frame", ["hand"], "unknown tool_frame ['hand']"),
        ("load_robot", "limits", 5, "limits are 5; give LimitOverrides or a LimitLayer"),
        ("load_robot", "package_dirs", [5], "robot.package_dirs is 5; give a path"),
    ],
)
def test_an_argument_of_another_kind_is_named(name, argument, value, message):
    function, kinds = function_of(name)
    arguments = {key: GIVEN[kind][0] for key, kind in kinds.items()}
    with pytest.raises(t.TubePlannerError) as caught:
        function(**{**arguments, argument: value})
    assert message in str(caught.value)


def test_radii_may_be_an_array():
    rows = t.sweep(PROBLEM, np.array([0.03, 0.02], dtype=np.float32)).rows
    assert [row.value for row in rows] == pytest.approx([0.02, 0.03])


NUMBER_LIST = {"type": "array", "items": {"type": "number"}}
TRAJECTORY = {
    "type": "object",
    "properties": {
        "format": {"const": "tubeplanner/trajectory"},
        "version": {"const": 1},
        "joint_names": {"type": "array", "items": {"type": "string"}},
        "breakpoints": NUMBER_LIST,
        "coefficients": {"type": "array", "items": {"type": "array", "items": NUMBER_LIST}},
        "seams": {},
        "notes": {},
    },
}
MOTION = {
    "format": "tubeplanner/trajectory",
    "version": 1,
    "joint_names": ["joint1", "joint2"],
    "breakpoints": [0.0, 0.5, 1.0],
    "coefficients": [[[0.0, 0.1], [0.2, 0]], [[0.0, 0], [0, 0]], [[0.1, -1], [0.1, -1]]],
}


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A file that every example writes anew."""
    return tmp_path_factory.mktemp("any") / "any.json"


@pytest.mark.dear("problems are explained and measured")
@pytest.mark.parametrize("command", ["explain", "measure"])
@examples(4)
@given(document=changed_documents(DOCUMENT, problem_schema(), 2), as_json=st.booleans())
def test_any_problem_is_answered(capfd, file, command, document, as_json):
    if written(file, document):
        status = main([command, str(file), *(["--json"] * as_json)])
        out, err = capfd.readouterr()
        if command == "explain" and status == 2 and out and not as_json:
            assert ": bad_input: " in out.splitlines()[0]
            status = 1  # answered: what helps, or that nothing does
        require_told(status, out, err, as_json)


@examples(15)
@given(document=changed_documents(MOTION, TRAJECTORY), as_json=st.booleans())
def test_any_trajectory_is_judged_or_refused(capfd, file, document, as_json):
    if written(file, document):
        words = ["check", FILE, str(file)]
        status = main([*words, *(["--json"] * as_json)])
        require_told(status, *capfd.readouterr(), as_json)
