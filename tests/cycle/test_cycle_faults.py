"""Steps that contradict each other: the message names the step."""

from dataclasses import replace

import numpy as np
import pytest

from cycles import HOME, PICK, ball, move, planar_arm, weight
from tubeplanner import (
    Attach,
    AttachedSolid,
    Cycle,
    Detach,
    Event,
    GoalRegion,
    ProblemError,
    Seed,
    load_robot,
)

ARM = planar_arm()
GO, BACK = move(ARM, "go", HOME, PICK), move(ARM, "back", PICK, HOME)
TAKE, LET_GO = Attach("part"), Detach("part")
SOLID = AttachedSolid("part", ball(ARM).shapes)
OTHER_ARM = load_robot("example:two_link", "link2")


def cycle(*steps, obstacles=True, attached=(), **more):
    return Cycle(HOME, steps, [ball(ARM)] * obstacles, attached, **more)


def test_what_is_consistent_is_taken():
    made = cycle(GO, Event("gripper"), TAKE, BACK, LET_GO, closed=True)
    assert [leg.name for leg in made.legs] == ["go", "back"]
    assert [type(step) for step in made.after.steps] == [Detach]


def test_a_name_may_be_attached_again_once_it_was_let_go():
    gone = Detach("part", leaves_obstacle=False)
    cycle(TAKE, GO, LET_GO, TAKE, BACK, LET_GO)
    cycle(TAKE, GO, gone, Attach("part", None, SOLID), BACK)
    cycle(Attach("mass", weight(0.1)), GO, Detach("mass"), Attach("mass", weight(0.2)), BACK)


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ([], "a cycle has at least one move; give one with a name and a tube"),
        ([Event("gripper")], "a cycle has at least one move"),
        ([GO, "stop"], r"steps\[1\] is 'stop'; give Move, Event, Attach or Detach"),
        ([GO, replace(BACK, name="go")], "move 'go': 2 moves have this name"),
        ([GO, TAKE, TAKE, BACK], "attach 'part': it is attached already; detach it before"),
        ([GO, LET_GO, BACK], "detach 'part': unknown attached name 'part'; there is: none"),
        ([TAKE, GO, Detach("prat")], r"detach 'prat': .*did you mean 'part'\?\); there is: part"),
        ([TAKE, GO, LET_GO, LET_GO], "detach 'part': unknown attached name 'part'; there is: none"),
        (
            [GO, Attach("prat"), BACK],
            "attach 'prat': unknown obstacle 'prat' .*; or give shape, pa",
        ),
        ([GO, Attach("part", None, SOLID)], "attach 'part': shape is given, and there is an obst"),
        (
            [TAKE, GO, Detach("part", leaves_obstacle=False), TAKE, BACK],
            "attach 'part': unknown obstacle 'part'; there is: none; or give shape, payload",
        ),
        (
            [Attach("mass", weight(1)), GO, Detach("mass"), Attach("mass"), BACK],
            "attach 'mass': unknown obstacle 'mass'",
        ),
    ],
)
def test_steps_that_are_not_possible_are_refused(steps, message):
    with pytest.raises(ProblemError, match=message):
        cycle(*steps)


def test_what_is_carried_all_along_is_neither_taken_nor_let_go():
    carried = {"obstacles": False, "attached": [SOLID]}
    with pytest.raises(ProblemError, match="attach 'part': the robot carries it all along; choose"):
        cycle(GO, Attach("part", weight(1.0)), BACK, **carried)
    with pytest.raises(ProblemError, match="detach 'part': the robot carries it all along; attach"):
        cycle(GO, LET_GO, BACK, **carried)


def test_a_closed_cycle_ends_with_empty_hands():
    cycle(GO, TAKE, BACK)
    with pytest.raises(ProblemError, match="closed: 'part' is still attached where the cycle ends"):
        cycle(GO, TAKE, BACK, closed=True)
    with pytest.raises(ProblemError, match="closed: 'mass' is still attached"):
        cycle(GO, Attach("mass", weight(1.0)), BACK, closed=True)


def test_a_cycle_has_one_arm():
    other = move(OTHER_ARM, "back", PICK, HOME)
    with pytest.raises(ProblemError, match="move 'back': its robot's tool_frame differs from"):
        cycle(GO, other)


def outside(goal, by):
    """Return steps of which the second begins so far beyond where the first one ends."""
    end = ARM.tool_position(PICK)
    away = (end - ARM.tool_position(HOME)) / np.linalg.norm(end - ARM.tool_position(HOME))
    begin = end + (0.1 + by) * away
    tube = type(GO.tube)([begin, begin + away * 0.1], 0.1)
    return replace(GO, goal=goal(end)), replace(BACK, tube=tube)


@pytest.mark.parametrize(
    "goal", [lambda _: None, lambda _: PICK, lambda end: GoalRegion(end), lambda _: Seed(PICK)]
)
def test_a_move_begins_where_the_one_before_ends(goal):
    """Its tube holds that place, up to its radius."""
    Cycle(HOME, outside(goal, -1e-4))
    with pytest.raises(
        ProblemError, match=r"move 'back': tube.points\[0\] is .* m, but move 'go' "
    ):
        Cycle(HOME, outside(goal, 1e-3))


def test_where_a_move_may_end_anywhere_in_a_ball_the_next_may_begin_there():
    steps = outside(lambda end: GoalRegion(end, 0.01), 1e-3)
    Cycle(HOME, steps)
    with pytest.raises(
        ProblemError, match=r"0.02 m outside the first segment; begin where it ends"
    ):
        Cycle(HOME, outside(lambda end: GoalRegion(end, 0.01), 0.02))
