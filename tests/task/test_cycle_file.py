"""The cycle file's format; load_cycle, parse_cycle; files of either kind."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from small_cycle import SMALL

from cycles import DWELL, HOME, PART, PICK, PLACE, planar_arm
from tubeplanner import (
    Attach,
    Cycle,
    Detach,
    Event,
    GoalRegion,
    PlanningProblem,
    ProblemError,
    RobotError,
    Seed,
    ToolPose,
    load_cycle,
    parse_cycle,
)
from tubeplanner.documents import parse_yaml
from tubeplanner.resources import bundled_cycles
from tubeplanner.task.cycle_file import cycle_schema, is_cycle_file, load_problem_or_cycle
from tubeplanner.task.info import cycle_info

# The cycle file's shape: what editors complete it with, and what messages say of it.


SCHEMA = cycle_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)
SAMPLE = Path(__file__).parents[1] / "data/cases" / "every_cycle_field.yaml"
MOVE = (
    "name, tube, goal, to, limits, clearance, contacts, objective, collision, pass_through, holding"
)
KIND = r"it must be a map with name or to \(of a move\), event, attach or detach"
TOP = (
    "format, version, include, robot, start, obstacles, clearance, collision, objective, "
    "period, robustness, closed, moves"
)
TO_PICK, CLOSE, TAKE, TO_PLACE, OPEN, LET_GO, BACK = range(7)


def cycle_fields():
    """Return the fields of the cycle `pick_and_place`."""
    robot = planar_arm()
    home, pick, location = robot.tool_position(np.array([HOME, PICK, PLACE])).round(9).tolist()
    return {
        "format": "tubeplanner/cycle",
        "robot": {"urdf": "example:two_link", "tool_frame": "hand", "gravity": [0, 0, 0]},
        "start": {"joints": HOME.tolist()},
        "obstacles": [{"name": "part", "sphere": PART[0], "position": [*pick[:2], PART[1]]}],
        "closed": True,
        "moves": [
            {"name": "to_pick", "tube": {"points": [home, pick], "radius": 0.2}},
            {"event": "gripper", "set": "close", "dwell": DWELL},
            {"attach": "part"},
            {"name": "to_place", "tube": {"points": [pick, location], "radius": 0.2}},
            {"event": "gripper", "set": "open", "dwell": DWELL},
            {"detach": "part"},
            {"name": "back", "tube": {"points": [location, home], "radius": 0.2}},
        ],
    }


def with_(k, **changes):
    """Return the fields of the cycle with changes of step k or the header; None removes a field."""
    fields = cycle_fields()
    holder = fields if k is None else fields["moves"][k]
    holder.update(changes)
    for name in [name for name, value in changes.items() if value is None]:
        del holder[name]
    return fields


def with_step(step):
    fields = cycle_fields()
    fields["moves"].insert(1, step)
    return fields


def without(*steps):
    fields = cycle_fields()
    fields["moves"] = [step for k, step in enumerate(fields["moves"]) if k not in steps]
    return fields


def test_the_sample_has_every_field_and_is_a_cycle():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    fields = parse_yaml(SAMPLE.read_text())
    VALIDATOR.validate(fields)
    assert list(fields) == TOP.split(", ")
    by_kind = {"name": "Move", "event": "Event", "attach": "Attach", "detach": "Detach"}
    for key, kind in by_kind.items():
        names = {name for step in fields["moves"] if key in step for name in step}
        assert names == set(SCHEMA["$defs"][f"{kind}Fields"]["properties"])
    cycle = load_cycle(SAMPLE)
    assert [len(leg.moves) for leg in cycle.legs] == [2, 1, 1, 1]


def test_every_field_has_a_description_and_durations_their_unit():
    assert SCHEMA["title"] == "tubeplanner cycle"
    for section in (SCHEMA, *SCHEMA["$defs"].values()):
        assert section["description"]
        assert all(field.get("description") for field in section["properties"].values())
    assert "[s]" in SCHEMA["$defs"]["EventFields"]["properties"]["dwell"]["description"]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            with_(CLOSE, dwel=1),
            r"moves\[1\]: unknown key 'dwel' \(did you mean 'dwell'\?\); there is: event, set, d",
        ),
        (with_(TAKE, paylod=1), r"moves\[2\]: unknown key 'paylod'.*: attach, pay.*, holding$"),
        (with_(LET_GO, leave=1), r"moves\[5\]: unknown key 'leave'.*: detach, leave_as_obstacle$"),
        (with_(TO_PICK, goall=1), rf"moves\[0\]: unknown key 'goall' .*; there is: {MOVE}$"),
        (
            with_(TAKE, payload={"mas": 1}),
            r"moves\[2\]\.payload: unknown key 'mas' .*: mass, com, in",
        ),
        (
            with_(TAKE, shape={"name": "a", "box": [1, 1, 1]}),
            r"moves\[2\]\.shape: unknown key 'name'",
        ),
        (
            with_(TO_PICK, collision={"self": True}),
            r"moves\[0\]\.collision: unknown key 'self'; there is: ig",
        ),
        (with_(TO_PICK, tube={"radius": 1}), r"moves\[0\]\.tube\.points is required"),
        (with_(TO_PICK, tube=None), r"moves\[0\]\.tube is required"),
        (with_(CLOSE, dwell="1"), r"moves\[1\]\.dwell is '1'; it must be a number"),
        (with_(CLOSE, event=3), r"moves\[1\]\.event is 3; it must be text"),
        (with_(CLOSE, attach="part"), r"moves\[1\]: unknown key 'attach'"),
        (
            with_(CLOSE, set=[1]),
            r"moves\[1\]\.set is \[1\]; it must be a text, a number, true or fal",
        ),
        (
            with_(TO_PLACE, pass_through="no"),
            r"moves\[3\]\.pass_through is 'no'; it must be true or f",
        ),
        (with_step(None), rf"moves\[1\] is empty; {KIND}"),
        (with_step({}), rf"moves\[1\] is \{{\}}; {KIND}"),
        (with_step("go"), rf"moves\[1\] is 'go'; {KIND}"),
        (with_step({"payload": 1}), rf"moves\[1\] is \{{'payload': 1\}}; {KIND}"),
        (with_(None, moves={"a": 1}), r"moves is \{'a': 1\}; it must be a list"),
        (with_(None, goal={}), f"top level: unknown key 'goal'; .*: {TOP}$"),
        (with_(None, tube={"radius": 1}), "top level: unknown key 'tube'"),
        (with_(None, closed="y"), "closed is 'y'; it must be true or false"),
        (with_(None, format="tubeplanner/problem"), "format is 'tubeplanner/problem'; it must be"),
        (with_(None, start=None), "start is required"),
    ],
)
def test_messages_name_the_step_and_its_field(fields, message):
    assert list(VALIDATOR.iter_errors(fields))
    with pytest.raises(ProblemError, match=f"^my cycle: {message}"):
        parse_cycle(fields, name="my cycle")


@pytest.mark.parametrize("value", ["close", 0.4, 3, True, False, None])
def test_an_event_sets_what_it_is_given(value):
    fields = cycle_fields()
    fields["moves"][CLOSE]["set"] = value
    VALIDATOR.validate(fields)
    setting = parse_cycle(fields).steps[CLOSE].setting
    assert setting == value
    assert type(setting) is (float if value == 3 and value is not True else type(value))


# Cycles from files: what a move takes from its cycle, and what messages say of it.


NEAR, FAR = planar_arm().tool_position(np.array([PICK, PLACE])).tolist()
SEAMS = [HOME, PICK, PLACE, HOME]


def test_a_cycle_is_read():
    cycle = parse_cycle(cycle_fields(), name="my cycle")
    assert (cycle.name, cycle.closed, cycle.period) == ("my cycle", True, None)
    kinds = [type(step).__name__ for step in cycle.steps]
    assert kinds == ["Move", "Event", "Attach", "Move", "Event", "Detach", "Move"]
    assert cycle.steps[CLOSE] == Event("gripper", "close", DWELL)
    assert cycle.steps[LET_GO] == Detach("part")
    np.testing.assert_array_equal(cycle.start, HOME)
    assert cycle.legs[0].robot is cycle.legs[2].robot
    assert all(leg.joined.ends_openly for leg in cycle.legs)


def test_a_file_is_read_with_what_it_includes_and_what_is_changed(tmp_path):
    fields = cycle_fields()
    (tmp_path / "cell.yaml").write_text(json.dumps({"obstacles": fields.pop("obstacles")}))
    rows = [",".join(map(str, point)) for point in fields["moves"][BACK]["tube"]["points"]]
    (tmp_path / "back.csv").write_text("\n".join(["x,y,z", *rows]))
    fields["moves"][BACK]["tube"] = {"points": "back.csv", "radius": 0.2}
    (tmp_path / "pick.yaml").write_text(json.dumps({**fields, "include": "cell.yaml"}))
    changes = {"moves.to_place.tube.radius": 0.1, "moves.1.dwell": 0.5, "closed": False}
    cycle = load_cycle("pick.yaml", tmp_path, changes=changes)
    assert cycle.name == f"{tmp_path.name}/pick"
    assert [obstacle.name for obstacle in cycle.obstacles] == ["part"]
    assert cycle.steps[TO_PLACE].tube.radius.tolist() == [0.1]
    assert cycle.steps[BACK].tube.points.shape == (2, 3)
    assert (cycle.steps[CLOSE].dwell, cycle.closed) == (0.5, False)
    with pytest.raises(ProblemError, match=r"moves\.1\.dwel: unknown key 'dwel'"):
        load_cycle("pick.yaml", tmp_path, changes={"moves.1.dwel": 0.5})
    (tmp_path / "cell.yaml").write_text(json.dumps({"obstacles": [{"name": "a", "sphere": "x"}]}))
    with pytest.raises(ProblemError, match=r"cell\.yaml: obstacles\[0\]\.sphere is 'x'"):
        load_cycle("pick.yaml", tmp_path)


@pytest.mark.parametrize(
    ("goal", "kind"),
    [
        ({"joints": PICK.tolist()}, np.ndarray),
        ({"seed": PICK.tolist()}, Seed),
        ({"position": NEAR}, GoalRegion),
        ({"pose": {"position": NEAR, "rpy": [0, 0, float(PICK.sum())]}}, ToolPose),
        (None, type(None)),
    ],
)
def test_a_move_ends_as_a_problem_does(goal, kind):
    fields = cycle_fields()
    fields["moves"][TO_PICK]["goal"] = goal
    assert type(parse_cycle(fields).legs[0].joined.goal) is kind


SRDF = """<robot name="two_link">
  <group name="arm"><chain base_link="base" tip_link="hand"/></group>
  <group_state name="up" group="arm">
    <joint name="joint1" value="0.5"/><joint name="joint2" value="0.2"/>
  </group_state>
</robot>"""


def test_a_move_without_a_tube_goes_where_it_says(tmp_path):
    (tmp_path / "arm.srdf").write_text(SRDF)
    fields = with_(None, closed=False)
    fields["robot"]["srdf"] = "arm.srdf"
    goal = {"position": [0.2, 0.3, 0.0]}
    fields["moves"][BACK:] = [{"to": "up"}, {"name": "aside", "goal": goal}, {"to": "start"}]
    VALIDATOR.validate(fields)
    up, aside, back = parse_cycle(fields, tmp_path).steps[BACK:]
    assert [each.name for each in (up, aside, back)] == ["up", "aside", "start"]
    np.testing.assert_array_equal(up.goal, [0.5, 0.2])
    np.testing.assert_array_equal(back.goal, HOME)
    begins = [FAR, up.end_position, goal["position"]]
    ends = [*begins[1:], planar_arm().tool_position(HOME)]
    for move, begin, end in zip((up, aside, back), begins, ends, strict=True):
        assert move.tube.is_anywhere
        np.testing.assert_allclose(move.tube.points, [begin, end], atol=1e-9)


def test_the_last_move_of_a_closed_cycle_goes_back_to_a_start_that_is_chosen():
    fields = with_(None, start={"seed": HOME.tolist()})
    fields["moves"][BACK] = {"to": "start"}
    last = parse_cycle(fields).steps[-1]
    assert last.ends_openly
    np.testing.assert_allclose(last.end_position, planar_arm().tool_position(HOME), atol=1e-6)


def test_limits_of_a_move_are_above_the_robots():
    fields = with_(TO_PLACE, limits={"scale": {"velocity": 0.5}})
    fields["robot"]["limits"] = {"velocity": {"joint1": 3.0}, "scale": {"effort": 0.9}}
    legs = parse_cycle(fields).legs
    limits = [leg.robot.limits for leg in legs]
    np.testing.assert_allclose(limits[1].velocity, limits[0].velocity / 2)
    np.testing.assert_allclose(limits[1].effort, limits[0].effort)
    np.testing.assert_allclose([each.velocity[0] for each in limits], [3.0, 1.5, 3.0])
    assert legs[0].robot is legs[2].robot


def test_a_move_has_its_own_clearance_and_objective_or_the_cycles():
    pairs = [{"links": ["part", "link1"], "clearance": 0.03}]
    fields = with_(TO_PLACE, clearance={"default": 0.02}, objective={"slack": 0.1})
    fields |= {"clearance": {"default": 0.01, "pairs": pairs}, "objective": {"slack": 0.2}}
    moves = [leg.joined for leg in parse_cycle(fields).legs]
    assert [move.clearance for move in moves] == [0.01, 0.02, 0.01]
    assert [move.pair_clearances for move in moves] == [{("part", "link1"): 0.03}] * 3
    assert [move.objective.slack for move in moves] == [0.2, 0.1, 0.2]
    alone = parse_cycle(with_(TO_PLACE, clearance={"default": 0.02, "segments": [0.04]})).legs
    assert [leg.joined.clearance for leg in alone] == [0.0, 0.02, 0.0]
    assert alone[1].joined.tube.clearance.tolist() == [0.04]


def test_what_is_not_checked_is_what_the_cycle_and_the_move_say():
    fields = with_(None, collision={"ignore": [["part", "link1"]]})
    fields["moves"][BACK]["collision"] = {"ignore": [["part", "hand"]]}
    moves = [leg.joined for leg in parse_cycle(fields).legs]
    assert [set(move.ignore_collisions) for move in moves] == [
        {("part", "link1")},
        {("part", "link1")},
        {("part", "link1"), ("part", "hand")},
    ]
    assert not parse_cycle(with_(None, collision={"self": False})).self_collision


def test_what_is_attached_weighs_and_has_a_shape():
    payload = {"mass": 1.5, "com": [0, 0, 0.1], "inertia": [0.1, 0.1, 0.1, 0, 0, 0]}
    shape = {"sphere": PART[0], "position": [0, 0, 0.2]}
    fields = with_(TAKE, attach="tray", payload=payload, shape=shape)
    fields["moves"][LET_GO] = {"detach": "tray", "leave_as_obstacle": False}
    cycle = parse_cycle(fields)
    step = cycle.steps[TAKE]
    assert isinstance(step, Attach)
    assert (step.payload.mass, step.payload.com) == (1.5, (0, 0, 0.1))
    np.testing.assert_allclose(step.solid.shapes[0].center, [0, 0, 0.2])
    assert cycle.steps[LET_GO] == Detach("tray", leaves_obstacle=False)
    alone = with_(TAKE, attach="tray", payload=payload)
    alone["moves"][LET_GO] = {"detach": "tray"}
    assert parse_cycle(alone).steps[TAKE].solid is None


def test_a_joint_may_be_locked():
    fields = cycle_fields()
    fields["robot"] |= {"joints": ["joint1"], "locked_joints": {"joint2": 0.6}}
    fields |= {"start": {"joints": [0.1]}, "closed": False, "moves": fields["moves"][:1]}
    arm = planar_arm(joints=["joint1"], locked_joints={"joint2": 0.6})
    ends = arm.tool_position(np.array([[0.1], [0.3]])).tolist()
    fields["moves"][0]["tube"] = {"points": ends, "radius": 0.2}
    assert parse_cycle(fields).robot.joint_names == ("joint1",)


def test_moves_may_pass_through_where_nothing_happens():
    fields = without(CLOSE, TAKE, OPEN, LET_GO)
    fields["moves"][1]["pass_through"] = True
    cycle = parse_cycle(fields)
    assert [leg.name for leg in cycle.legs] == ["to_pick, to_place", "back"]


HEAVY = {"mass": -1.0}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (with_(None, moves=[]), "moves has no move; give one with a name and a tube"),
        (with_(CLOSE, dwell=-1), r"moves\[1\]: event 'gripper': dwell is -1 s; 0 to 100000 s are"),
        (with_(CLOSE, event=""), r"moves\[1\]: the name of an event is ''"),
        (with_(TO_PLACE, name="a\nb"), r"moves\[3\].name is 'a.nb', with the character"),
        (
            with_(TAKE, payload=HEAVY),
            r"moves\[2\]: attach 'part': payload: mass -1 kg must be from",
        ),
        (with_(TAKE, shape={}), r"moves\[2\]: attach 'part': shape must have exactly one of box, "),
        (
            with_(TAKE, shape={"sphere": 1, "scale": 2.0}),
            r"moves\[2\]: attach 'part': shape: scale belongs to a mesh alone",
        ),
        (without(LET_GO), "closed: 'part' is still attached where the cycle ends"),
        (with_(TO_PICK, pass_through=True), "move 'to_pick': pass_through: nothing comes before i"),
        (with_(BACK, goal={"joints": [3.0, 0.0]}), "move 'back': goal: the tool is at"),
        (with_(BACK, goal={}), "move 'back': goal takes either joints or seed"),
        (with_(BACK, to="start", goal={"joints": [0, 0]}), "move 'back': goal and to are given"),
        (with_(BACK, to="up"), "move 'back': goal.group_state 'up' is one of an SRDF"),
        (
            with_(TO_PICK, to="start") | {"start": {"seed": HOME.tolist()}},
            "move 'to_pick': to: start: the start is a seed or a pose",
        ),
        (
            with_(None, moves=[with_(0)["moves"][0], {"to": "start", "pass_through": True}]),
            "move 'start': pass_through: move 'start' has no tube, and so begins and ends at rest",
        ),
        (with_(BACK, tube={"points": [FAR] * 2, "radius": -1}), "move 'back': tube"),
        (
            with_(BACK, limits={"scale": {"velocity": 2}}),
            "move 'back': robot.limits.scale: velocit",
        ),
        (
            with_(BACK, contacts=[{"links": ["part", "tabel"], "within": 0.1}]),
            "move 'back': contacts: unknown link with collision geometry or obstacle 'tabel'",
        ),
        (
            with_(BACK, collision={"ignore": [["part", "tabel"]]}),
            "move 'back': collision.ignore: unknown link or obstacle 'tabel'",
        ),
        (with_(None, start={"joints": [9.0, 0.0]}), "move 'to_pick': start: "),
        (with_(None, start={"group_state": "home"}), "move 'to_pick': start.group_state 'home'"),
    ],
)
def test_what_is_wrong_is_told_by_its_step(fields, message):
    kind = (
        RobotError if "mass" in message or "scale:" in message else ProblemError
    )  # an error keeps its kind
    with pytest.raises(kind, match=f"^my cycle: {message}"):
        parse_cycle(fields, name="my cycle")


def test_a_cycle_is_the_same_from_python():
    """A cycle read from a file equals a cycle made of its steps."""
    read = parse_cycle(cycle_fields())
    built = Cycle(HOME, read.steps, read.obstacles, closed=True)
    for mine, its in zip(built.problems(SEAMS), read.problems(SEAMS), strict=True):
        assert mine.contacts == its.contacts
        np.testing.assert_array_equal(mine.tube.points, its.tube.points)


# The bundled cycles: cells that could be built, and moves that go easier on what is carried.


CYCLES = sorted(bundled_cycles())
TOUCHING = 1e-6  # [m]


def box_around(obstacle):
    """Return the corners of the box around an upright box or cylinder [m]."""
    assert not {"rpy", "quaternion"} & set(obstacle)
    radius, length = obstacle.get("cylinder", (0, 0))
    half = np.array(obstacle.get("box", [2 * radius, 2 * radius, length])) / 2
    return obstacle["position"] - half, obstacle["position"] + half


def standing(obstacles):
    """Return the names of the obstacles that stand on the floor or touch one that does."""
    boxes = {each["name"]: box_around(each) for each in obstacles}
    names, fresh = set(), {"floor"}
    while fresh:
        names |= fresh
        fresh = {
            name
            for name, (low, high) in boxes.items()
            for below, above in (boxes[other] for other in fresh)
            if (low - above <= TOUCHING).all() and (below - high <= TOUCHING).all()
        } - names
    return names


@pytest.mark.parametrize("name", CYCLES)
def test_nothing_in_a_cell_floats_and_what_is_taken_is_there(name):
    fields = parse_yaml(bundled_cycles()[name].read_text())
    names = {each["name"] for each in fields["obstacles"]}
    assert standing(fields["obstacles"]) == names
    assert {step["attach"] for step in fields["moves"] if "attach" in step} <= names


def test_what_floats_is_found():
    floor = {"name": "floor", "box": [1, 1, 0.1], "position": [0, 0, 0]}
    part = {"name": "part", "cylinder": [0.1, 0.1], "position": [0, 0, 0.101]}
    assert standing([floor, part]) == {"floor"}


@pytest.mark.dear("loads arms with all that they carry")
@pytest.mark.parametrize("name", CYCLES)
def test_the_arm_of_a_closed_cycle_is_slower_with_what_it_carries(name):
    cycle = load_cycle(f"example:{name}")
    assert (cycle.closed, cycle.name) == (True, name)
    robots = [leg.robot for leg in cycle.legs]
    masses = np.array([robot.payload.mass if robot.payload else 0.0 for robot in robots])
    peaks = np.array([robot.limits.acceleration.max() for robot in robots])
    assert peaks[masses > masses.min()].max() < peaks[masses == masses.min()].min()


# Files that are problems or cycles.


PROBLEM = "example:two_link/around_a_post"


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "c.yaml"
    path.write_text(SMALL)
    return path


def test_each_file_becomes_what_it_is_and_fields_are_changed_in_both(path):
    cycle = load_problem_or_cycle(path.name, path.parent, changes={"moves.back.tube.radius": 0.2})
    assert isinstance(cycle, Cycle)
    assert cycle.legs[-1].joined.tube.radius.tolist() == [0.2]
    problem = load_problem_or_cycle(PROBLEM, changes={"clearance": 0.01})
    assert isinstance(problem, PlanningProblem)
    assert problem.clearance == 0.01
    assert is_cycle_file(path)
    assert not is_cycle_file(PROBLEM)


def test_moves_without_the_format_and_no_file_are_refused(path):
    path.write_text(SMALL.replace("format: tubeplanner/cycle\n", ""))
    with pytest.raises(ProblemError, match="format is required"):
        load_problem_or_cycle(path)
    with pytest.raises(ProblemError, match="does not exist"):
        load_problem_or_cycle("nowhere.yaml")


def test_moves_stand_by_legs_with_what_is_carried(path):
    info = cycle_info(path)
    fields = info.as_dict()["cycle"]
    assert info.refused is None
    assert fields["closed"]
    legs = fields["legs"]
    names = [[move["name"] for move in leg["moves"]] for leg in legs]
    assert names == [["over"], ["down", "beside"], ["back"]]
    assert [leg["attached"] for leg in legs] == [[], ["part"], []]
    assert [leg["payload"] and leg["payload"]["mass"] for leg in legs] == [None, 0.5, None]
    assert legs[1]["moves"][1]["length"] == pytest.approx(0.35)
    assert fields["after"] == ["pause (0.1 s)"]


def test_a_cycle_that_does_not_load_is_described_with_the_reason(path):
    info = cycle_info(path, {"moves.back.tube.radius": -1})
    assert info.task is None
    assert "move 'back': tube.radius" in info.refused
    assert info.as_dict()["cycle"] is None
    assert info.robot.tool_frame == "hand"


def test_a_file_that_breaks_its_format_is_bad_input(path):
    path.write_text(SMALL.replace("dwell: 0.1", "dwel: 0.1"))
    with pytest.raises(ProblemError, match="dwel"):
        cycle_info(path)
