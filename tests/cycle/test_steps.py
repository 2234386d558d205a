"""Steps alone: what each refuses."""

import numpy as np
import pytest

from cycles import HOME, PICK, ball, move, planar_arm, weight
from tubeplanner import Attach, AttachedSolid, Event, GoalRegion, ProblemError, Seed, ToolPose


@pytest.mark.parametrize("dwell", [-0.1, np.nan, np.inf, 1e6, "1", True, None])
def test_an_event_takes_a_time(dwell):
    with pytest.raises(ProblemError, match=r"event 'gripper': dwell is .*; 0 to 100000 s are acc"):
        Event("gripper", "open", dwell)


def test_an_event_may_take_no_time():
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
