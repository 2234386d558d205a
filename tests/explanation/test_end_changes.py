"""Changes of start, goal and duration load and do what they say."""

import numpy as np
import pytest

from asked_problems import POINTS, asked, made, the
from tubeplanner.explanation.end_changes import end_changes

HERE = [0.1, -1.2]


def around(joints, **others):
    """Return the question with a start, about whose tool the first reference point is."""
    question = asked({"start": {"joints": joints}})
    q = [joints] if isinstance(joints, list) else [[joints["joint1"], joints["joint2"]]]
    tool = question.robot.tool_position(q)[0].tolist()
    return asked({"start": {"joints": joints}, "tube.points.0": tool, **others})


@pytest.mark.parametrize("joints", [HERE, {"joint2": HERE[1], "joint1": HERE[0]}])
def test_one_joint_of_the_start_is_turned(joints):
    question = around(joints)
    changes = list(end_changes(question))
    assert {each.kind for each in changes} == {"start"}
    change = the(changes, "start.joints", "start: -0.05 rad on joint2")
    assert (change.before, change.about) == (HERE, {"start", "joint2"})
    assert change.propose(0.0123).after == [0.1, -1.2123]
    assert change.propose(0.0123).text == "start: -0.0123 rad on joint2"
    assert made(question, change, 0.0123).start.tolist() == [0.1, -1.2123]
    assert [each.field for each in changes] == ["start.joints"] * 4 + ["start"]


def test_joints_that_are_given_may_be_left_to_inverse_kinematics():
    question = around(HERE, goal={"joints": [0.5, -1.0]})
    start, goal = (the(end_changes(question), end) for end in ("start", "goal"))
    assert start.is_switch and goal.is_switch
    assert start.propose(1).changes == {"start": {"seed": HERE}}
    assert made(question, goal, 1).goal is None
    beyond = asked({"start": {"joints": [0.1, 5.0]}})
    assert the(end_changes(beyond), "start").propose(1).after["seed"][1] == pytest.approx(np.pi)


def test_the_goal_is_turned_as_the_start_is():
    joints = [2.0, -1.7]
    tool = asked().robot.tool_position([joints])[0].tolist()
    question = asked({"goal": {"joints": joints}, "tube.points.3": tool})
    changes = list(end_changes(question))
    change = the(changes, "goal.joints", "goal: 0.05 rad on joint1")
    assert made(question, change, 0.02).goal.tolist() == [2.02, -1.7]
    assert change.about == {"goal", "joint1"}


def test_a_seed_is_no_place_to_move():
    assert list(end_changes(asked())) == []


def test_joints_that_are_not_there_have_no_changes():
    assert list(end_changes(asked({"start": {"joints": {"joint1": 0, "jiont2": 0}}}))) == []


@pytest.mark.parametrize(("given", "scale"), [(0.0, 0.1), (0.02, 0.02)])
def test_a_goal_position_may_be_missed_by_more(given, scale):
    question = asked({"goal": {"position": POINTS[3], "tolerance": given}})
    (change,) = end_changes(question)
    assert (change.field, change.before, change.scale) == ("goal.tolerance", given, scale)
    assert made(question, change, 0.0125).goal.tolerance == given + 0.0125
    after = 1000 * given + 12.5
    assert change.propose(0.0125).text == f"goal.tolerance {1000 * given:g} -> {after:g} mm"


def test_a_duration_may_be_longer():
    question = asked({"objective": {"duration": 0.5}})
    (change,) = end_changes(question)
    assert made(question, change, 0.25).objective.duration == 0.75
    assert change.propose(0.25).text == "objective.duration 500 -> 750 ms"
    assert change.propose(1.5).text == "objective.duration 0.5 -> 2 s"
