"""Steps of a cycle: Move, Event, Attach, Detach; contradictions between steps."""

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
    ToolPose,
    load_robot,
)

# Steps alone: what each refuses.


@pytest.mark.parametrize("dwell", [-0.1, np.nan, 1e6, "1", True])
def test_an_event_takes_a_time(dwell):
    with pytest.raises(ProblemError, match=r"event 'gripper': dwell is .*; 0 to 100000 s are acc"):
        Event("gripper", "open", dwell)
    assert (Event("gripper").dwell, Event("gripper").setting) == (0.0, None)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Event, "the name of an event is 'a.nb', with the character"),
        (Attach, "what is attached is 'a.nb', with the character"),
        (lambda name: move(planar_arm(), name, HOME, PICK), "the name of a move is 'a.nb'"),
    ],
)
def test_names_can_be_shown(make, message):
    with pytest.raises(ProblemError, match=message):
        make("a\nb")


def test_what_is_attached_has_one_name():
    shapes = ball(planar_arm()).shapes
    with pytest.raises(ProblemError, match="attach 'part': its solid is called 'tool'; give both"):
        Attach("part", weight(1.0), AttachedSolid("tool", shapes))
    assert Attach("part", None, AttachedSolid("part", shapes)).solid.name == "part"


@pytest.mark.parametrize(
    ("goal", "is_open"),
    [
        (None, True),
        (GoalRegion([0.2, 0.4, 0.0], 0.01), True),
        (PICK, False),
        (Seed(PICK), False),
        (ToolPose(np.eye(4)), False),
    ],
)
def test_a_move_that_gives_the_position_alone_ends_openly(goal, is_open):
    assert move(planar_arm(), "a", HOME, PICK, goal=goal).ends_openly == is_open


# Steps that contradict each other: the message names the step.


ARM = planar_arm()
GO, BACK = move(ARM, "go", HOME, PICK), move(ARM, "back", PICK, HOME)
TAKE, LET_GO = Attach("part"), Detach("part")
SOLID = AttachedSolid("part", ball(ARM).shapes)
OTHER_ARM = load_robot("example:two_link", "link2")


def cycle(*steps, obstacles=True, attached=(), **more):
    return Cycle(HOME, steps, [ball(ARM)] * obstacles, attached, **more)


def test_what_is_consistent_is_taken():
    built = cycle(GO, Event("gripper"), TAKE, BACK, LET_GO, closed=True)
    assert [leg.name for leg in built.legs] == ["go", "back"]
    assert [type(step) for step in built.after.steps] == [Detach]


def test_a_name_may_be_attached_again_once_it_was_let_go():
    gone = Detach("part", leaves_obstacle=False)
    cycle(GO, TAKE, BACK)
    cycle(TAKE, GO, LET_GO, TAKE, BACK, LET_GO)
    cycle(TAKE, GO, gone, Attach("part", None, SOLID), BACK)
    cycle(Attach("mass", weight(0.1)), GO, Detach("mass"), Attach("mass", weight(0.2)), BACK)


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        ([], "a cycle has at least one move; give one with a name and a tube"),
        ([GO, "stop"], r"steps\[1\] is 'stop'; give Move, Event, Attach or Detach"),
        ([GO, replace(BACK, name="go")], "move 'go': 2 moves have this name"),
        ([GO, TAKE, TAKE, BACK], "attach 'part': it is attached already; detach it before"),
        ([GO, LET_GO, BACK], "detach 'part': unknown attached name 'part'; there is: none"),
        ([TAKE, GO, Detach("prat")], r"detach 'prat': .*did you mean 'part'\?\); there is: part"),
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
        ([GO, move(OTHER_ARM, "back", PICK, HOME)], "move 'back': its robot's tool_frame differs"),
    ],
)
def test_steps_that_are_not_possible_are_refused(steps, message):
    with pytest.raises(ProblemError, match=message):
        cycle(*steps)


CARRIED = {"obstacles": False, "attached": [SOLID]}
MASS = Attach("mass", weight(1.0))


@pytest.mark.parametrize(
    ("step", "more", "message"),
    [
        (Attach("part", weight(1.0)), CARRIED, "attach 'part': the robot carries it all along; ch"),
        (LET_GO, CARRIED, "detach 'part': the robot carries it all along; attach"),
        (TAKE, {"closed": True}, "closed: 'part' is still attached where the cycle ends"),
        (MASS, {"closed": True}, "closed: 'mass' is still attached"),
    ],
)
def test_hands_are_empty_at_the_end_of_a_closed_cycle_and_keep_what_is_carried_along(
    step, more, message
):
    with pytest.raises(ProblemError, match=message):
        cycle(GO, step, BACK, **more)


def outside(goal, by):
    """Return two moves, the end of the first a distance [m] outside the tube of the second."""
    end = ARM.tool_position(PICK)
    away = (end - ARM.tool_position(HOME)) / np.linalg.norm(end - ARM.tool_position(HOME))
    begin = end + (0.1 + by) * away
    tube = type(GO.tube)([begin, begin + away * 0.1], 0.1)
    return replace(GO, goal=goal(end)), replace(BACK, tube=tube)


@pytest.mark.parametrize(
    ("goal", "within", "beyond"),
    [
        (lambda _: None, -1e-4, 1e-3),
        (lambda _: PICK, -1e-4, 1e-3),
        (GoalRegion, -1e-4, 1e-3),
        (lambda _: Seed(PICK), -1e-4, 1e-3),
        (lambda end: GoalRegion(end, 0.01), 1e-3, 0.02),  # anywhere in a ball
    ],
)
def test_a_move_begins_where_the_one_before_ends(goal, within, beyond):
    """The tube of the next move contains the end, up to its radius."""
    Cycle(HOME, outside(goal, within))
    message = rf"move 'back': tube.points\[0\] is .* m, but move 'go' .* {beyond:g} m outside the "
    with pytest.raises(ProblemError, match=message + "first segment; begin where it ends"):
        Cycle(HOME, outside(goal, beyond))


# Dwells of cycles whose controller has a period.


def test_a_dwell_is_a_multiple_of_the_period_in_spite_of_rounding():
    assert cycle(GO, Event("gripper", None, 0.3), BACK, period=0.001).period == 0.001
    message = (
        "event 'gripper': dwell is 0.05 s, no multiple of the period, 0.004 s; give 0.048 or 0.052"
    )
    with pytest.raises(ProblemError, match=message):
        cycle(GO, Event("gripper", None, 0.05), BACK, period=0.004)
    with pytest.raises(ProblemError, match="period is"):
        cycle(GO, BACK, period=0.0)
