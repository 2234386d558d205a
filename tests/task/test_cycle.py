"""Cycle: legs and rests in a changing cell; one PlanningProblem per leg."""

from dataclasses import replace

import numpy as np
import pytest

from cycles import HOME, PART, PICK, PLACE, ball, move, pick_and_place, planar_arm, weight
from tubeplanner import (
    Attach,
    AttachedSolid,
    Contact,
    Cycle,
    Detach,
    Event,
    Obstacle,
    ProblemError,
    Seed,
    ToolOffset,
    load_robot,
    placement_of,
)
from tubeplanner.geometry.collision_checker import CollisionChecker
from tubeplanner.task.cycle import Cell

# The cell as it changes: where what was taken stands, against the tool's own placement.

TAKE, LET_GO = Attach("part"), Detach("part")


def middle(solid):
    return np.mean([shape.center for shape in solid.shapes], axis=0)


@pytest.fixture(scope="module")
def arm():
    return planar_arm()


def test_what_is_taken_is_no_obstacle_until_it_stands_where_it_is_let_go(arm):
    """The solid keeps its pose in the tool frame from attaching to detaching."""
    full = Cell((ball(arm), ball(arm, HOME, "other")), ())
    carrying = full.after(TAKE, arm, PICK)
    assert [each.name for each in carrying.obstacles] == ["other"]
    assert [each.name for each in carrying.attached] == ["part"]
    released = carrying.after(LET_GO, arm, PLACE)
    assert [each.name for each in released.obstacles] == ["other", "part"]
    expected = arm.tool_position(PLACE) + np.array([0, 0, PART[1]])
    np.testing.assert_allclose(middle(released.obstacles[1]), expected, atol=1e-12)
    assert released.attached == ()
    assert released.handed_over == ("part", "part")
    assert full.after(Event("gripper"), arm, PICK) is full


def test_a_box_turns_with_the_hand(arm):
    """The rotation of the tool of a planar arm is the sum of its joints."""
    reach = 0.15
    start, end = np.array([0.3, 0.4]), np.array([-0.2, 1.5])
    ahead = np.array([np.cos(0.7), np.sin(0.7), 0.0])
    where = arm.tool_position(start) + reach * ahead + np.array([0, 0, 0.1])
    box = Obstacle.box("part", [0.1, 0.02, 0.02], placement_of(where, rpy=[0, 0, 0.7]))
    released = Cell((box,), ()).after(TAKE, arm, start).after(LET_GO, arm, end)
    axis = np.array([np.cos(1.3), np.sin(1.3), 0.0])
    expected = arm.tool_position(end) + reach * axis + np.array([0, 0, 0.1])
    np.testing.assert_allclose(middle(released.obstacles[0]), expected, atol=1e-12)
    corners = released.obstacles[0].shapes[0].vertices - expected
    np.testing.assert_allclose(abs(corners @ axis), 0.05, atol=1e-12)


def test_a_tool_centre_point_moves_nothing_that_is_carried(arm):
    """Attached solids are placed in the tool frame, not at the tool centre point."""
    start, q = ball(arm), np.array([0.4, -0.2])
    shifted = planar_arm(tool_offset=ToolOffset((0.1, 0.0, 0.05)))
    plain = Cell((start,), ()).after(TAKE, arm, PICK).after(LET_GO, arm, q).obstacles[0]
    other = Cell((start,), ()).after(TAKE, shifted, PICK).after(LET_GO, shifted, q).obstacles[0]
    np.testing.assert_allclose(middle(other), middle(plain), atol=1e-12)


def test_what_does_not_stay_is_gone_and_a_mass_alone_changes_nothing(arm):
    cell = Cell((ball(arm),), ())
    gone = cell.after(TAKE, arm, PICK).after(Detach("part", leaves_obstacle=False), arm, PLACE)
    assert (gone.obstacles, gone.attached) == ((), ())
    heavy = cell.after(Attach("weight"), arm, PICK)
    assert heavy is cell
    assert heavy.after(Detach("weight"), arm, PLACE).obstacles == cell.obstacles


def test_a_shape_in_the_tool_frame_is_carried_from_then_on(arm):
    solid = AttachedSolid("tray", Obstacle.sphere("tray", 0.02, placement_of([0, 0, 0.3])).shapes)
    carrying = Cell((), ()).after(Attach("tray", solid=solid), arm, PICK)
    np.testing.assert_allclose(middle(carrying.attached[0]), [0, 0, 0.3])
    released = carrying.after(Detach("tray"), arm, HOME)
    expected = arm.tool_position(HOME) + np.array([0, 0, 0.3])
    np.testing.assert_allclose(middle(released.obstacles[0]), expected, atol=1e-12)


@pytest.mark.parametrize(("gap", "touches"), [(0.0005, True), (0.002, False)])
def test_links_that_touch_what_is_taken_may(gap, touches):
    """A ball beside the forearm of a UR5, far from the tool that it is attached to."""
    arm, q = load_robot("example:ur5", "tool0"), np.array([0.0, -1.2, 1.5, -0.3, 1.57, 0.0])
    rotation, position = (each[arm.link_body["forearm_link"]] for each in arm.body_poses(q))
    corners = [
        (part.shape.vertices @ rotation.T + position, part.shape.radius)
        for part in CollisionChecker(arm).shapes
        if part.owner == "forearm_link"
    ]
    tops = [placed[placed[:, 2].argmax()] + [0, 0, radius] for placed, radius in corners]
    highest = max(tops, key=lambda top: top[2])
    at = highest + np.array([0, 0, 0.02 + gap])
    carrying = Cell((Obstacle.sphere("part", 0.02, placement_of(at)),), ()).after(TAKE, arm, q)
    assert ("forearm_link" in carrying.attached[0].touch_links) == touches


def test_what_changed_hands_before_the_leg_before_did_so_long_ago():
    cycle = pick_and_place()
    steps = [step for step in cycle.steps if not isinstance(step, Detach)]
    cells = replace(cycle, steps=steps, closed=False).cells([HOME, PICK, PLACE])
    assert [cell.handed_over for cell in cells] == [(), ("part",), ()]


# Cycles: the problem of each leg, the cell as it is then.

CYCLE = pick_and_place(payload=weight(1.0))
SEAMS = [HOME, PICK, PLACE, HOME]


def test_each_leg_has_the_cell_and_the_arm_of_then():
    problems = CYCLE.problems(SEAMS)
    assert [len(problem.obstacles) for problem in problems] == [1, 0, 1]
    assert [[each.name for each in problem.attached] for problem in problems] == [[], ["part"], []]
    masses = [problem.robot.payload and problem.robot.payload.mass for problem in problems]
    assert masses == [None, 1.0, None]
    np.testing.assert_array_equal([problem.start for problem in problems], SEAMS[:3])
    np.testing.assert_array_equal([problem.given_goal for problem in problems], SEAMS[1:])
    assert [problem.name for problem in problems] == [f"cycle, {leg.name}" for leg in CYCLE.legs]


def test_a_leg_begins_and_ends_where_it_is_said_to():
    assert CYCLE.problem(1, SEAMS).given_goal is None
    np.testing.assert_array_equal(CYCLE.problem(1, SEAMS, PLACE).given_goal, PLACE)
    seeded = replace(CYCLE, start=Seed(HOME))
    assert isinstance(seeded.problem_from_anywhere(0).start, Seed)
    assert isinstance(CYCLE.problem_from_anywhere(1).start, Seed)
    np.testing.assert_array_equal(CYCLE.problem_from_anywhere(0).start, HOME)


def test_what_is_given_for_something_that_is_not_there_waits_for_it(arm):
    """Pairs with an attachable solid count only in moves with the solid."""
    solid = AttachedSolid("tray", Obstacle.sphere("tray", 0.02, placement_of([0, 0, 0.2])).shapes)
    wall = Obstacle.box("wall", [0.1, 0.1, 0.1], placement_of([-1, 0, 0]))
    pairs = {
        "contacts": [Contact(("tray", "wall"), 0.1)],
        "pair_clearances": {("tray", "wall"): 0.05},
        "ignore_collisions": [("wall", "tray")],
    }
    for name, value in pairs.items():
        go = move(arm, "go", HOME, PICK, **{name: value})
        back = move(arm, "back", PICK, HOME, **{name: value})
        built = Cycle(HOME, [go, Attach("tray", None, solid), back], [wall])
        first, second = built.problems([HOME, PICK, HOME])
        assert len(getattr(first, name)) == 0
        assert len(getattr(second, name)) == 1


@pytest.mark.parametrize("name", ["contacts", "pair_clearances", "ignore_collisions"])
def test_a_pair_with_something_unknown_is_refused(name, arm):
    pair = ("wall", "link1")
    value = {"contacts": [Contact(pair, 0.1)], "pair_clearances": {pair: 0.1}}.get(name, [pair])
    go = move(arm, "go", HOME, PICK, **{name: value})
    with pytest.raises(ProblemError, match=r"^move 'go': .*unknown link.* or obstacle 'wall'"):
        Cycle(HOME, [go])


def test_what_is_wrong_with_a_move_names_it(arm):
    go = move(arm, "go", HOME, PICK)
    far = move(arm, "back", PICK, HOME, goal=np.array([3.0, 0.0]))
    for arguments, message in (
        ((HOME, [go, far]), "^move 'back': goal: the tool is at"),
        ((PLACE + 2.0, [go]), "^move 'go': start: the tool is at"),
        ((HOME, [go], [ball(arm), ball(arm)]), "^move 'go': obstacles: the name 'part' is given 2"),
        (
            (HOME, [Attach("link1", None, AttachedSolid("link1", ball(arm).shapes)), go]),
            "'link1' is also the name of a link",
        ),
    ):
        with pytest.raises(ProblemError, match=message):
            Cycle(*arguments)


def test_two_solids_may_be_carried_at_once_and_let_go_one_by_one(arm):
    other = ball(arm, PLACE, "other")
    steps = [
        Attach("part"),
        move(arm, "go", PICK, PLACE),
        Attach("other"),
        move(arm, "on", PLACE, HOME),
        Detach("part"),
        move(arm, "back", HOME, PICK),
    ]
    built = Cycle(PICK, steps, [ball(arm), other])
    cells = built.cells([PICK, PLACE, HOME])
    names = [[each.name for each in cell.attached] for cell in cells]
    assert names == [["part"], ["part", "other"], ["other"]]
    standing = [[each.name for each in cell.obstacles] for cell in cells]
    assert standing == [["other"], [], ["part"]]
    problems = built.problems([PICK, PLACE, HOME, PICK])
    assert [len(problem.attached) for problem in problems] == [1, 2, 1]


def test_what_is_carried_all_along_is_in_every_problem():
    solid = AttachedSolid("grip", Obstacle.sphere("grip", 0.01, placement_of([0, 0, 0.2])).shapes)
    problems = replace(CYCLE, attached=[solid]).problems(SEAMS)
    names = [{each.name for each in problem.attached} for problem in problems]
    assert names == [{"grip"}, {"grip", "part"}, {"grip"}]


def test_a_cycle_says_what_it_is_and_what_happens_at_its_seams():
    assert [len(CYCLE.stop_at(k).steps) for k in range(4)] == [0, 2, 2, 0]
    after = replace(CYCLE, steps=[*CYCLE.steps, Event("done")])
    assert [step.name for step in after.stop_at(3).steps] == ["done"]
    assert repr(CYCLE) == "<Cycle cycle: 3 moves of two_link to hand in 3 legs, closed>"
    assert repr(replace(CYCLE, closed=False)).endswith("3 legs, open>")
    with pytest.raises(ProblemError, match="the cycle is 'a'; give a Cycle, as load_cycle returns"):
        Cycle.require("a")
