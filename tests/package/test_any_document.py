"""Any document and parts of it are taken or refused in one line."""

import numpy as np
import pytest
from any_documents import CYCLE, PROBLEM, changed_documents, whole_documents, written
from any_values import LINE, NAMES, NUMBERS, VALUES, accepted, arm, examples
from hypothesis import given
from hypothesis import strategies as st

import tubeplanner as t
from tubeplanner.robot.urdf import read_urdf
from tubeplanner.studies.study_file import study_schema
from tubeplanner.task.cycle_file import cycle_schema
from tubeplanner.task.field_changes import read_problem_fields
from tubeplanner.task.problem_format import problem_schema

# Parts of which problems and cycles are made: right ones, and some that do not fit each other.
EYE = t.placement_of()
WALL = t.Obstacle.box("wall", [0.1, 0.1, 0.1], t.placement_of([0, -0.6, 0]))
NAMED_AS_A_LINK = t.Obstacle.sphere("link1", 0.1, EYE)
PEN = t.AttachedSolid("pen", WALL.shapes)
FLAGS = st.booleans() | VALUES


def robots():
    """Return a strategy for arms of which some do not fit the others' tubes, and for any value."""
    arms = [arm(), arm(joints=("joint2", "joint1")), arm(payload=t.Payload(1.0))]
    return st.sampled_from(arms) | VALUES


TUBES = VALUES | st.sampled_from(
    [
        t.Tube(LINE, 0.03),
        t.Tube(LINE, 0.03, joint_signs={"joint2": "-"}),
        t.Tube(LINE, 0.03, joint_signs={"nothing": "-"}),
        t.Tube(LINE, 0.03, joint_signs={"joint2": [1e5, 1e6]}),
        t.Tube([*LINE, [0.4, 0.3, 0]], [0.03, 0.1], tool_speed=[1, None], clearance=[0.1, None]),
        t.Tube(LINE, 0.03, orientations=[[0, 0, 0, 1]] * 2, rotation_tolerance=0.1),
        t.Tube(LINE, None, cross_section={"box": [0.1, 0.2], "up": [0, 0, 1]}),
        t.Tube([[9, 9, 9], [9, 9, 10]], 0.1),
        t.Tube(LINE, 0.5, visit="any"),
    ]
)
HERE, THERE = (t.placement_of([0.3, y, 0]) for y in (-0.3, 0.3))
ENDS = VALUES | st.sampled_from(
    [
        *(np.array([-0.2, -1.0]), [-0.2, -1.0], np.zeros(3), np.zeros((1, 2)), None),
        *({"joint1": 0, "joint2": -1.0}, {"joint1": 0}, t.Seed({"joint1": 0, "joint2": -1})),
        *(t.Seed(np.array([0.0, -1.0])), t.Seed(None), t.Seed("a"), t.Seed(np.zeros(5))),
        *(t.ToolPose(HERE), t.ToolPose(THERE, np.array([0, -1.0])), t.ToolPose(THERE, "a")),
        *(t.GoalRegion(np.array([0.3, 0.3, 0])), t.GoalRegion(np.array([0.3, 0.3, 0]), 0.01, 0.1)),
        t.GoalRegion(np.array([9, 9, 9])),
    ]
)
SOLIDS = (
    VALUES | st.just(WALL) | st.lists(st.sampled_from([WALL, NAMED_AS_A_LINK, PEN]), max_size=3)
)
NAMED_PAIRS = [("wall", "link1"), ("wall", "wall"), ("wall", "hand"), ("a", "b"), ("pen", "link1")]
PAIRS = st.sampled_from([*NAMED_PAIRS, "ab", (1,)])
CONTACTS = st.sampled_from(
    [
        *(t.Contact(("wall", "link1"), 0.1), t.Contact(("a", "b"), 0.1)),
        t.Contact(("wall", "hand"), 0.1, ("goal",)),
    ]
)
WEIGHTS = [{}, {"a": 1}, {"joint1": 0, "joint2": 0}]
OBJECTIVES = st.sampled_from(
    [t.Objective(duration=1.0), *(t.Objective(minimise="energy", weights=w) for w in WEIGHTS)]
)
OF_PROBLEMS = {
    "robot": st.deferred(robots),
    "tube": TUBES,
    "start": ENDS,
    "goal": ENDS,
    "obstacles": SOLIDS,
    "attached": SOLIDS,
    "clearance": NUMBERS | VALUES,
    "pair_clearances": VALUES | st.dictionaries(PAIRS, NUMBERS | VALUES, max_size=2),
    "contacts": VALUES | st.lists(CONTACTS, max_size=2),
    "self_collision": FLAGS,
    "ignore_collisions": VALUES | st.lists(PAIRS, max_size=2),
    "objective": VALUES | OBJECTIVES,
    "period": NUMBERS | VALUES,
    "robustness": VALUES | st.just(t.Robustness()),
    "name": NAMES | VALUES,
}
OF_MOVES = {
    **{name: OF_PROBLEMS[name] for name in ("robot", "tube", "goal", "clearance", "objective")},
    **{name: OF_PROBLEMS[name] for name in ("pair_clearances", "contacts", "ignore_collisions")},
    "name": NAMES | VALUES,
    "passes_through": FLAGS,
}


def some(parts, most):
    """Return a strategy for a few of these arguments, by name."""
    names = st.lists(st.sampled_from(list(parts)), min_size=1, max_size=most, unique=True)
    return names.flatmap(lambda names: st.fixed_dictionaries({name: parts[name] for name in names}))


# Any document either loads or raises one of our errors, never another library's.
STUDY = {
    "format": "tubeplanner/study",
    "study": {
        "problem": "example:two_link/paper_1_30mm",
        "vary": {"tube.radius": [0.02], "robot.payload.mass": {"from": 0.1, "to": 2, "count": 3}},
        "options": {"method": "stop-at-corners"},
    },
}
URDF = """<robot name="arm"><link name="base"/><link name="bar"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="1 1 1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="bar"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A file that every example writes anew."""
    return tmp_path_factory.mktemp("any") / "any.json"


@examples(25)
@given(changed_documents(PROBLEM, problem_schema()), st.booleans())
def test_a_changed_problem_loads_or_is_refused(document, reads_tube):
    repr(accepted(t.parse_problem, document, reads_tube=reads_tube))


@examples(15)
@given(changed_documents(CYCLE, cycle_schema()))
def test_a_changed_cycle_loads_or_is_refused(document):
    repr(accepted(t.parse_cycle, document))


@pytest.mark.parametrize(
    ("parse", "schema"), [(t.parse_problem, problem_schema()), (t.parse_cycle, cycle_schema())]
)
@examples(10)
@given(data=st.data())
def test_any_document_loads_or_is_refused(parse, schema, data):
    accepted(parse, data.draw(whole_documents(schema) | VALUES))


@examples(15)
@given(document=changed_documents(STUDY, study_schema()) | whole_documents(study_schema()))
def test_any_study_poses_its_points_or_is_refused(file, document):
    if written(file, document) and (study := accepted(t.load_study, file)):
        for index in range(min(3, len(study.points))):
            accepted(study.spec, study.points[index])


@examples(15)
@given(document=changed_documents(PROBLEM, problem_schema()))
def test_a_changed_file_loads_or_is_refused(file, document):
    if written(file, document):
        accepted(t.load_problem, file)


@examples(25)
@given(st.text() | st.binary() | VALUES.map(repr), st.sampled_from([".yaml", ".json"]))
def test_any_file_is_read_or_refused(tmp_path_factory, content, suffix):
    path = tmp_path_factory.getbasetemp() / f"any{suffix}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "replace"))
    try:
        read_problem_fields(path)
    except t.TubePlannerError as error:
        assert str(path) in str(error)


@examples(25)
@given(st.integers(0, len(URDF)), st.integers(0, 12), st.text(max_size=6))
def test_any_damage_to_a_urdf_is_harmless_or_named(tmp_path_factory, start, length, new):
    path = tmp_path_factory.getbasetemp() / "any.urdf"
    damaged = URDF[:start] + new + URDF[start + length :]
    path.write_bytes(damaged.encode("utf-8", "replace"))
    try:
        read_urdf(path).kinematic_xml()
    except t.TubePlannerError as error:
        assert str(path) in str(error)


# Parts that do not fit each other make a problem or a cycle, or are refused in one line.
SEED = t.Seed(np.array([0.0, -1.0]))
BACK = [LINE[1], [0.2, 0.1, 0], LINE[0]]


def steps_of(kind, named, **parts):
    """Return a strategy for steps of a kind with a name, or others if it is among the parts."""
    return some(parts, 2).map(lambda given: accepted(kind, **{"name": named, **given}))


NAME = NAMES | VALUES
RESTS = st.one_of(
    steps_of(t.Event, "grip", name=NAME, setting=VALUES, dwell=NUMBERS | VALUES),
    steps_of(t.Attach, "wall", name=NAME, payload=st.just(t.Payload(0.5)), solid=st.just(PEN)),
    steps_of(t.Attach, "wall", payload=VALUES, solid=VALUES),
    steps_of(t.Detach, "wall", name=NAME, leaves_obstacle=FLAGS),
)
OF_CYCLES = {
    **{"start": ENDS, "obstacles": SOLIDS, "attached": SOLIDS, "closed": FLAGS},
    **{"self_collision": FLAGS, "period": NUMBERS | VALUES, "name": NAME},
}


def moves(points, name):
    """Return a strategy for moves along points, other arguments of which may be anything."""
    tube = t.Tube(points, 0.05, joint_signs={"joint2": "-"})
    right = {"name": name, "robot": arm(), "tube": tube}
    others = st.just({}) | some(OF_MOVES, 2)
    return others.map(lambda given: accepted(t.Move, **{**right, **given}))


@examples(50)
@given(some(OF_PROBLEMS, 4))
def test_any_parts_make_a_problem_or_are_refused(given):
    tube = t.Tube(LINE, 0.03, joint_signs={"joint2": "-"})
    right = {"robot": arm(), "tube": tube, "start": SEED}
    if problem := accepted(t.PlanningProblem, **{**right, **given}):
        repr(problem)
        accepted(lambda: problem.collision)
        accepted(problem.farther_apart, 0.1)
        assert problem.joined.distinct_joint_bounds[0].shape[1] == 2


@examples(25)
@given(st.tuples(moves(LINE, "over"), RESTS, moves(BACK, "back"), RESTS), some(OF_CYCLES, 2))
def test_any_steps_make_a_cycle_or_are_refused(steps, given):
    right = {"start": SEED, "obstacles": [WALL], "steps": [each for each in steps if each]}
    repr(accepted(t.Cycle, **{**right, **given}))


@examples(10)
@given(VALUES | st.lists(RESTS, max_size=2) | moves(LINE, "over"))
def test_what_are_no_steps_is_refused(steps):
    repr(accepted(t.Cycle, SEED, steps))


def problem(**given):
    return t.PlanningProblem(**{"robot": arm(), "tube": t.Tube(LINE, 0.03), "start": SEED, **given})


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: problem(robot="arm.urdf"),
            "robot is 'arm.urdf'; give a RobotModel, as load",
        ),
        (lambda: problem(tube=LINE), "tube is [[0.3, -0.3, 0], [0.3, 0.3, 0]]; give a Tube"),
        (lambda: problem(self_collision=1), "self_collision is 1; give True or False"),
        (lambda: problem(name=None), "name is None; give text"),
        (lambda: problem(obstacles=np.array(1.0)), "obstacles[0] is array(1.); give Obstacle.box"),
        (
            lambda: problem(ignore_collisions=[("a", 1)]),
            "ignore_collisions[0] is ('a', 1); give pairs of nam",
        ),
        (
            lambda: problem(ignore_collisions=[[[1], [1, 2]]]),
            "ignore_collisions[0] is [[1], [1, 2]]; give pai",
        ),
        (lambda: t.Move("over", None, None), "move 'over': robot is None;"),
        (lambda: t.Attach("pen", payload=1), "attach 'pen': payload is 1; give a Payload"),
        (lambda: t.Attach("pen", solid=1), "attach 'pen': solid is 1; give an AttachedSolid"),
        (lambda: t.Detach(5), "what is detached is 5; a name must be text that is not empty"),
        (lambda: t.Detach("pen", "no"), "detach 'pen': leaves_obstacle is 'no'; give True"),
        (lambda: t.Cycle(SEED, 5), "steps[0] is 5; give Move, Event, Attach or Detach"),
        (lambda: t.Cycle(SEED, [], closed=1), "closed is 1; give True or False"),
    ],
)
def test_a_part_or_step_of_another_kind_is_named(make, message):
    with pytest.raises(t.ProblemError) as caught:
        make()
    assert str(caught.value).startswith(message)
