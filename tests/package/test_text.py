"""Short text: names of joints and links, dataclasses on one line, cells of tables."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

import tubeplanner as t
from tubeplanner import ProblemError
from tubeplanner.errors import MAX_SHOWN, shown, unknown_name
from tubeplanner.optimizer.stages import Sensitivity
from tubeplanner.studies.base_regions import BasePlacement, Region
from tubeplanner.text import MAX_NAME_LENGTH, require_name, short_repr, value_text, without_formulas

# Names that messages, files and figures can hold, and how values are shown in messages.
HIDDEN = [
    "a\nFAKE: passes",
    "a\x1b[31m",
    "a\x9b31m",
    "a\u202eb",
    "a\u2066b",
    "a\tb",
    "\x7f",
    "a\x00",
]


@pytest.mark.parametrize(
    "name", ["joint1", "Gelenk 1", "関節", "a,b", 'a"b', "x" * MAX_NAME_LENGTH]
)
def test_printable_names_are_taken(name):
    assert require_name("a joint", name, ProblemError) == name


@pytest.mark.parametrize(
    ("name", "message"),
    [
        *((name, "which cannot be shown; rename it") for name in HIDDEN),
        *((name, "is .*; a name must be text that is not empty") for name in (5, None, "", ["a"])),
        ("x" * 10**6, "1000000 characters long; shorten it"),
    ],
)
def test_another_name_is_refused_in_a_short_message_that_shows_it_harmless(name, message):
    with pytest.raises(ProblemError, match=message) as caught:
        require_name("a joint", name, ProblemError)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    "value",
    ["x" * 10**6, 10**5000, 10**300, [1.0] * 10**6, {1: "y" * 999}],
    ids=["text", "digits that Python does not write", "digits", "a list", "a map"],
)
def test_long_values_are_shown_short(value):
    assert len(shown(value)) <= MAX_SHOWN + 3
    assert len(unknown_name("key", value, ["a", "b"])) < 150


def test_short_values_are_shown_as_they_are():
    assert shown("a") == "'a'"
    assert shown([1, 2]) == "[1, 2]"
    assert shown("a\u202e") == "'a\\u202e'"


# Every public class prints one short line with what one wants to know of it.


MOST = 500  # [characters]
# What is printed must name these, where the class has something of its own to say.
SAYS = {
    "AttachedSolid": ["part", "0.1 x 0.2 x 0.3 m about [0, 0, 0]"],
    "Certificate": ["passed", "10 of 21 conditions required"],
    "Cycle": ["small: 4 moves of two_link to hand in 3 legs, closed"],
    "CycleCertificate": ["passed", "4 moves"],
    "CycleMotion": ["of small: ", "3 legs, 9 marks"],
    "CycleResult": ["success by refinement", "certified cycle of"],
    "Explanation": ["name='two_link/around_a_post'", "remedies=<99 Remedy>", "tried=99"],
    "JointTrajectory": [" s: ", "pieces of degree", "joint1, joint2"],
    "Obstacle": ["post", "0.0605 x 0.0605 x 0.3 m about [0.4, 0.22, 0]", "1 convex shape"],
    "PlannedItem": ["index=0", "no/such/file.yaml"],
    "Placement": [
        "of two_link/around_a_post: 100 base placements tried, best BasePlacement(x=0.1, y=0.2"
    ],
    "PlanResult": ["success by refinement", "certified trajectory of"],
    "Planner": ["two_link/around_a_post: refinement", "nothing planned yet"],
    "PlanningProblem": [
        *("two_link/around_a_post", "2 joints of two_link to hand", "3 segments"),
        *("1 obstacle,", "start by seed", "goal open"),
    ],
    "ProblemSpec": ["two_link/around_a_post: a problem in "],
    "Remedy": ["field='tube.radius'", "text='all radii times 2'"],
    "RobotModel": ["two_link", "2 joints to hand", "joint1, joint2"],
    "Room": ["field='clearance'", "after=0.02"],
    "Tube": ["3 segments", "1 m long", "0.03 to 0.05 m"],
    "WorkerProcesses": ["2"],
}
# Results of long computations: of all fields large arrays.
FILLED = [
    *("Comparison", "ComparisonRow", "Execution", "FieldRow", "FieldSweep", "HandoverErrors"),
    *("JudgedCycle", "JudgedRun", "PatternSurvey", "Plant", "SegmentMeasurement", "Study"),
    *("StudyResult", "StudyRow", "Survival", "SweepResult", "SweepRow", "Tightening"),
    *("TrajectoryMeasures", "TubeAnswer", "TubeMeasurement", "View", "ZonedPath"),
]


@pytest.fixture(scope="module")
def made(planned, small_plan):
    """One instance of every public class, by name."""
    problem, result = planned("two_link/around_a_post", "refinement")
    box = t.Obstacle.box("part", (0.1, 0.2, 0.3), np.eye(4))
    cup = t.Cup(40.0, 0.02, 0.5)
    limits = t.LimitOverrides(effort={f"joint{k}": 1.0 for k in range(99)})
    peaks = t.trajectory_peaks(problem.robot, result.trajectory)
    instances = [
        *(problem, problem.robot, problem.tube, *problem.obstacles, result, result.trajectory),
        *(result.certificate, result.certificate.conditions["effort"], result.certificate.braking),
        *(result.certificate.tolerance, result.sensitivities[0], result.status, result.location),
        *(
            peaks,
            peaks.tool_speed,
            result.bound,
            t.Planner(problem),
            t.AttachedSolid("part", box.shapes),
        ),
        *(t.ToolPose(np.eye(4)), t.GoalRegion((0, 0, 1), 0.02), t.Contact(("a", "b"), 0.03)),
        *(t.Seed(np.zeros(7)), limits, t.MotorOverrides(), t.LimitLayer("a: ", limits)),
        *(t.PointSpeed("hand", (0, 0, 0), 1.0), t.Payload(1.0), t.ToolOffset(), t.Objective()),
        *(cup, t.Holding(cup, t.Payload(1.0)), t.Tray(0.3, (0.04, 0.05)), t.Liquid(0.2)),
        t.Gripper(40.0, 0.4, (0.02, 0.03)),
        *(t.BasePose(), t.Robustness(), t.PlanOptions(), t.MeasureOptions(), t.TeachOptions()),
        *(
            t.RouteOptions(),
            t.Draw(),
            t.Progress("planning"),
            t.RunVerdict(9, 1, {"tube": 1}, 1.0, 0.0),
        ),
        *(
            t.SlowerRun("effort", 0.1, 0.5, result.location),
            t.ErrorContribution("effort", "", 0.1, 0.1, ()),
        ),
        t.SearchStatistics(*range(8), False),
        *(t.WorkerProcesses(2), t.ProblemSpec.read("example:two_link/around_a_post")),
        *t.plan_many(["no/such/file.yaml"], executor=ThreadPoolExecutor(1)),
        *(t.PlaceOptions(), *_of_places(problem, result)),
        *_of_cycles(small_plan),
        *_of_explanations(problem, result),
    ]
    named = {type(each).__name__: each for each in instances}
    return named | {name: _filled(getattr(t, name)) for name in FILLED}


def _of_cycles(result):
    """Return a cycle, its steps and its plan."""
    cycle, motion = result.motion.cycle, result.motion
    steps = {type(step): step for step in cycle.steps}
    return [
        *(cycle, *steps.values(), result, motion, result.certificate),
        *(motion.marks[0], result.sensitivities[0]),
    ]


def _of_places(problem, result):
    """Return a placement and its parts."""
    base_placement = BasePlacement(0.1, 0.2, 0.0, 1.0)
    row = t.PlacementRow(
        base_placement, "success", result.message, result.location, result.duration
    )
    base, region = (
        t.GivenPlacement(base_placement, result, result.message),
        Region.of((0, 1, 0, 1), 0.0),
    )
    grid = region.grid(100, 0.0)
    placement = t.Placement(problem, region, (), grid, (row,) * 100, base, row, result, {})
    return [base_placement, row, base, placement]


def _of_explanations(problem, result):
    """Return an explanation, a remedy and slack."""
    radii, wider, missed = [0.03] * 99, [0.06] * 99, [0.05] * 99
    values = ("m", 1.5, "all radii times 2", {"tube.radius": wider}, 1.0, missed, "50 mm", True)
    remedy = t.Remedy("tube.radius", radii, wider, *values)
    slack = t.Headroom(
        "clearance", 0.01, 0.02, "m", 1.5, "clearance 10 -> 20 mm", 0.021, "21 mm", True
    )
    explanation = t.Explanation(problem.name, problem, result, None, (remedy,) * 99, ("a",) * 99)
    return [remedy, slack, replace(explanation, tried=99)]


def _filled(cls):
    instance = cls.__new__(cls)
    for field in fields(cls):
        object.__setattr__(instance, field.name, np.zeros((100, 7)))
    return instance


CLASSES = [
    name
    for name in t.__all__
    if isinstance(each := getattr(t, name), type) and not issubclass(each, Exception)
]


@pytest.mark.parametrize("name", CLASSES)
def test_a_public_class_prints_a_short_line(made, name):
    text = repr(made[name])
    assert len(text) <= MOST
    assert "\n" not in text
    assert " object at 0x" not in text
    assert name in text
    for words in SAYS.get(name, ()):
        assert words in text


def test_a_failed_certificate_names_what_fails(stored):
    problem, trajectory = stored("two_link/around_a_post")
    fast = trajectory.scaled(0.5)
    assert "fails effort" in repr(t.verify(problem, fast))


@dataclass(frozen=True)
class _Thing:
    array: object = None
    rows: object = None
    text: str = ""
    _hidden: int = 1

    __repr__ = short_repr


@pytest.mark.parametrize(
    ("thing", "text"),
    [
        (_Thing(), "_Thing()"),
        (_Thing(array=np.zeros((3, 4))), "_Thing(array=<array (3, 4)>)"),
        (_Thing(array=np.array([1.23456, 2])), "_Thing(array=[1.2346, 2.    ])"),
        (_Thing(rows=(1, 2)), "_Thing(rows=(1, 2))"),
        (_Thing(rows=[Sensitivity] * 90), "_Thing(rows=<90 type>)"),
        (_Thing(rows={str(k): k for k in range(90)}), "_Thing(rows=<90 by name>)"),
        (_Thing(array=_Thing(text="a" * 59)), "_Thing(array=<_Thing>)"),
        (_Thing(text="a" * 90), f"_Thing(text='{'a' * 59}...)"),
    ],
)
def test_large_values_are_named_by_kind_and_count(thing, text):
    assert repr(thing) == text


# Values of fields as tables have them.


@pytest.mark.parametrize(
    ("value", "text"),
    [(2, "2"), ("x2", "x2"), (None, "null"), ([1, "a"], '[1, "a"]'), (float("-inf"), "-.inf")],
)
def test_values_are_written_as_a_table_has_them(value, text):
    assert value_text(value) == text


# No cell of a table is run by a spreadsheet, and none that is a number or text is changed.


@pytest.mark.parametrize("cell", ["=1+1", "+1+1", "-1+1", "@SUM(A1)", " =1", "-", "-x"])
def test_a_formula_becomes_text(cell):
    assert without_formulas(f"a,{cell},1\n") == f"a,'{cell},1\n"


@pytest.mark.parametrize(
    "line", ["-1,+2.5,-1e-3,-inf", "a=b,[-1],x-1,", '"a, b","c ""d""",,', '"two\nlines",1', ""]
)
def test_all_else_stays(line):
    assert without_formulas(line + "\n") == line + "\n"
