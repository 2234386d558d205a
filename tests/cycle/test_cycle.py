"""Cycles: the problem of each leg, the cell as it is then."""

from dataclasses import replace

import numpy as np
import pytest

from cycles import HOME, PICK, PLACE, ball, move, pick_and_place, planar_arm, weight
from tubeplanner import (
    Attach,
    AttachedSolid,
    Contact,
    Cycle,
    Detach,
    Event,
    Obstacle,
    ProblemError,
    RobotError,
    Seed,
    placement_of,
)

CYCLE = pick_and_place(payload=weight(1.0))
SEAMS = [HOME, PICK, PLACE, HOME]


def test_a_cell_knows_what_was_handed_over_just_before():
    """Not what was before an earlier leg."""
    robot = CYCLE.robot
    steps = [
        move(robot, "to_pick", HOME, PICK),
        Attach("part"),
        move(robot, "to_place", PICK, PLACE),
        Event("gripper", "look"),
        move(robot, "back", PLACE, HOME),
    ]
    cells = Cycle(HOME, steps, [ball(robot)]).cells(SEAMS[:3])
    assert [cell.handed_over for cell in cells] == [(), ("part",), ()]


def test_each_leg_has_the_cell_and_the_arm_of_then():
    problems = CYCLE.problems(SEAMS)
    assert [len(problem.obstacles) for problem in problems] == [1, 0, 1]
    assert [[each.name for each in problem.attached] for problem in problems] == [[], ["part"], []]
    masses = [problem.robot.payload and problem.robot.payload.mass for problem in problems]
    assert masses == [None, 1.0, None]
    np.testing.assert_array_equal([problem.start for problem in problems], SEAMS[:3])
    np.testing.assert_array_equal([problem.given_goal for problem in problems], SEAMS[1:])
    assert [problem.name for problem in problems] == [f"cycle, {leg.name}" for leg in CYCLE.legs]


def test_what_was_put_down_is_in_the_way_where_it_was_put():
    """A hand of no size would go through the ball: the distance to it is told by hand."""
    problem = CYCLE.problem(2, SEAMS)
    there = CYCLE.robot.tool_position(PLACE) + np.array([0, 0, 0.1])
    np.testing.assert_allclose(problem.obstacles[0].shapes[0].center, there, atol=1e-12)


def test_a_leg_ends_where_it_is_said_to_or_where_its_move_does():
    assert CYCLE.problem(1, SEAMS).given_goal is None
    np.testing.assert_array_equal(CYCLE.problem(1, SEAMS, PLACE).given_goal, PLACE)


def test_a_cycle_begins_as_it_is_said_to():
    seeded = replace(CYCLE, start=Seed(HOME))
    assert isinstance(seeded.problem_from_anywhere(0).start, Seed)
    assert isinstance(CYCLE.problem_from_anywhere(1).start, Seed)
    np.testing.assert_array_equal(CYCLE.problem_from_anywhere(0).start, HOME)


def test_what_is_given_for_something_that_is_not_there_waits_for_it():
    """Pairs with what comes and goes count only in moves where it is there."""
    robot = planar_arm()
    solid = AttachedSolid("tray", Obstacle.sphere("tray", 0.02, placement_of([0, 0, 0.2])).shapes)
    wall = Obstacle.box("wall", [0.1, 0.1, 0.1], placement_of([-1, 0, 0]))
    pairs = {
        "contacts": [Contact(("tray", "wall"), 0.1)],
        "pair_clearances": {("tray", "wall"): 0.05},
        "ignore_collisions": [("wall", "tray")],
    }
    for name, value in pairs.items():
        given = {name: value}
        go, back = (move(robot, k, *e, **given) for k, e in (("go", (HOME, PICK)), ("back", HOME_)))
        made = Cycle(HOME, [go, Attach("tray", None, solid), back], [wall])
        first, second = made.problems([HOME, PICK, HOME])
        assert len(getattr(first, name)) == 0
        assert len(getattr(second, name)) == 1


HOME_ = (PICK, HOME)


@pytest.mark.parametrize("name", ["contacts", "pair_clearances", "ignore_collisions"])
def test_a_pair_with_something_unknown_is_refused(name):
    pair = ("wall", "link1")
    value = {"contacts": [Contact(pair, 0.1)], "pair_clearances": {pair: 0.1}}.get(name, [pair])
    go = move(planar_arm(), "go", HOME, PICK, **{name: value})
    with pytest.raises(ProblemError, match=r"^move 'go': .*unknown link.* or obstacle 'wall'"):
        Cycle(HOME, [go])


def test_what_is_wrong_with_a_move_names_it():
    robot = planar_arm()
    go = move(robot, "go", HOME, PICK)
    far = move(robot, "back", PICK, HOME, goal=np.array([3.0, 0.0]))
    with pytest.raises(ProblemError, match=r"^move 'back': goal: the tool is at"):
        Cycle(HOME, [go, far])
    with pytest.raises(ProblemError, match=r"^move 'go': start: the tool is at"):
        Cycle(PLACE + 2.0, [go])
    with pytest.raises(ProblemError, match=r"^move 'go': obstacles: the name 'part' is given 2"):
        Cycle(HOME, [go], [ball(robot), ball(robot)])


def test_a_solid_that_is_called_as_a_link_is_refused():
    solid = AttachedSolid("link1", ball(planar_arm()).shapes)
    steps = [Attach("link1", None, solid), move(planar_arm(), "go", HOME, PICK)]
    with pytest.raises((ProblemError, RobotError), match="'link1' is also the name of a link"):
        Cycle(HOME, steps)


def test_two_solids_may_be_carried_at_once_and_let_go_one_by_one():
    robot = planar_arm()
    other = ball(robot, PLACE, "other")
    steps = [
        Attach("part"),
        move(robot, "go", PICK, PLACE),
        Attach("other"),
        move(robot, "on", PLACE, HOME),
        Detach("part"),
        move(robot, "back", HOME, PICK),
    ]
    made = Cycle(PICK, steps, [ball(robot), other])
    cells = made.cells([PICK, PLACE, HOME])
    held = [[each.name for each in cell.attached] for cell in cells]
    assert held == [["part"], ["part", "other"], ["other"]]
    standing = [[each.name for each in cell.obstacles] for cell in cells]
    assert standing == [["other"], [], ["part"]]
    problems = made.problems([PICK, PLACE, HOME, PICK])
    assert [len(problem.attached) for problem in problems] == [1, 2, 1]


def test_what_is_carried_all_along_is_in_every_problem():
    solid = AttachedSolid("grip", Obstacle.sphere("grip", 0.01, placement_of([0, 0, 0.2])).shapes)
    problems = replace(CYCLE, attached=[solid]).problems(SEAMS)
    held = [{each.name for each in problem.attached} for problem in problems]
    assert held == [{"grip"}, {"grip", "part"}, {"grip"}]


def test_what_happens_at_a_seam():
    assert [len(CYCLE.rest_at(k).steps) for k in range(4)] == [0, 2, 2, 0]
    after = replace(CYCLE, steps=[*CYCLE.steps, Event("done")])
    assert [step.name for step in after.rest_at(3).steps] == ["done"]


def test_a_cycle_says_what_it_is():
    assert repr(CYCLE) == "<Cycle cycle: 3 moves of two_link to hand in 3 legs, closed>"
    assert repr(replace(CYCLE, closed=False)).endswith("3 legs, open>")
    with pytest.raises(ProblemError, match="the cycle is 'a'; give a Cycle, as load_cycle returns"):
        Cycle.require("a")
