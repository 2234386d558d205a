"""Cycles from files: what a move takes from its cycle, and what messages say of it."""

import copy
import json

import numpy as np
import pytest

from cycles import DWELL, HOME, PART, PICK, PLACE, cycle_fields, planar_arm
from tubeplanner import (
    Attach,
    Cycle,
    Detach,
    Event,
    GoalRegion,
    ProblemError,
    RobotError,
    Seed,
    ToolPose,
    TubePlannerError,
    load_cycle,
    parse_cycle,
)

TO_PICK, CLOSE, TAKE, TO_PLACE, OPEN, LET_GO, BACK = range(7)


def with_(k, **changes):
    """Return the fields of the cycle of which step k, or the header, has others; None: without."""
    fields = copy.deepcopy(cycle_fields())
    holder = fields if k is None else fields["moves"][k]
    holder.update(changes)
    for name in [name for name, value in changes.items() if value is None]:
        del holder[name]
    return fields


def without(*steps):
    fields = cycle_fields()
    fields["moves"] = [step for k, step in enumerate(fields["moves"]) if k not in steps]
    return fields


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
        ({"position": planar_arm().tool_position(PICK).tolist()}, GoalRegion),
        (
            {
                "pose": {
                    "position": planar_arm().tool_position(PICK).tolist(),
                    "rpy": [0, 0, float(PICK.sum())],
                }
            },
            ToolPose,
        ),
        (None, type(None)),
    ],
)
def test_a_move_ends_as_a_problem_does(goal, kind):
    fields = cycle_fields()
    fields["moves"][TO_PICK]["goal"] = goal
    assert type(parse_cycle(fields).legs[0].joined.goal) is kind


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
    alone = parse_cycle(with_(TO_PLACE, clearance=0.02)).legs
    assert [leg.joined.clearance for leg in alone] == [0.0, 0.02, 0.0]


def test_a_segment_has_its_own_clearance():
    fields = with_(TO_PLACE, clearance={"default": 0.01, "segments": [0.04]})
    assert parse_cycle(fields).legs[1].joined.tube.clearance.tolist() == [0.04]


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


FAR = planar_arm().tool_position(PLACE).tolist()
HEAVY = {"mass": -1.0}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (with_(None, moves=[]), "moves has no move; give one with a name and a tube"),
        (with_(None, moves=[{"event": "a"}]), "moves has no move"),
        (with_(CLOSE, dwell=-1), r"moves\[1\]: event 'gripper': dwell is -1 s; 0 to 100000 s are"),
        (with_(CLOSE, event=""), r"moves\[1\]: the name of an event is ''"),
        (with_(TO_PLACE, name="a\nb"), r"moves\[3\].name is 'a.nb', with the character"),
        (with_(TO_PLACE, name="to_pick"), "move 'to_pick': 2 moves have this name"),
        (
            with_(TAKE, payload=HEAVY),
            r"moves\[2\]: attach 'part': payload: mass -1 kg must be from",
        ),
        (with_(TAKE, attach="prat"), "attach 'prat': unknown obstacle 'prat' .*; or give shape, p"),
        (with_(TAKE, shape={}), r"moves\[2\]: attach 'part': shape must have exactly one of box, "),
        (with_(TAKE, shape={"sphere": 1}), "attach 'part': shape is given, and there is an obsta"),
        (
            with_(TAKE, shape={"sphere": 1, "scale": 2.0}),
            r"moves\[2\]: attach 'part': shape: scale belongs to a mesh alone",
        ),
        (with_(LET_GO, detach="prat"), r"detach 'prat': unknown attached name 'prat' \(did you me"),
        (without(LET_GO), "closed: 'part' is still attached where the cycle ends"),
        (with_(TO_PLACE, pass_through=True), "move 'to_place': pass_through: attach, at rest, com"),
        (with_(TO_PICK, pass_through=True), "move 'to_pick': pass_through: nothing comes before i"),
        (with_(BACK, goal={"joints": [3.0, 0.0]}), "move 'back': goal: the tool is at"),
        (with_(BACK, goal={}), "move 'back': goal takes either joints or seed"),
        (with_(BACK, tube={"points": [FAR] * 2, "radius": -1}), "move 'back': tube"),
        (
            with_(BACK, limits={"scale": {"velocity": 2}}),
            "move 'back': robot.limits.scale: velocit",
        ),
        (with_(TO_PICK, clearance=-1), "move 'to_pick': clearance is -1 m"),
        (
            with_(BACK, contacts=[{"links": ["part", "tabel"], "within": 0.1}]),
            "move 'back': contacts: unknown link with collision geometry or obstacle 'tabel'",
        ),
        (
            with_(BACK, collision={"ignore": [["part", "tabel"]]}),
            "move 'back': collision.ignore: unknown link or obstacle 'tabel'",
        ),
        (
            with_(None, collision={"ignore": [["part", "tabel"]]}),
            "move 'to_pick': collision.ignore: unknown link or obstacle 'tabel'",
        ),
        (with_(None, start={"joints": [9.0, 0.0]}), "move 'to_pick': start: "),
        (with_(None, start={"group_state": "home"}), "move 'to_pick': start.group_state 'home'"),
    ],
)
def test_what_is_wrong_is_told_by_its_step(fields, message):
    with pytest.raises(TubePlannerError, match=f"^my cycle: {message}"):
        parse_cycle(fields, name="my cycle")


def test_an_error_keeps_its_kind():
    with pytest.raises(RobotError):
        parse_cycle(with_(TAKE, payload=HEAVY))
    with pytest.raises(ProblemError):
        parse_cycle(with_(CLOSE, dwell=-1))


def test_a_cycle_is_the_same_from_python():
    """What the reader makes of a file is what its steps make."""
    read = parse_cycle(cycle_fields())
    made = Cycle(HOME, read.steps, read.obstacles, closed=True)
    for mine, its in zip(made.problems(SEAMS), read.problems(SEAMS), strict=True):
        assert mine.contacts == its.contacts
        np.testing.assert_array_equal(mine.tube.points, its.tube.points)


SEAMS = [HOME, PICK, PLACE, HOME]
