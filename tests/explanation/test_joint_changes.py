"""Changes of limits, payload, start, goal, duration."""

import numpy as np
import pytest
from asked_problems import POINTS, asked, made, the
from gantry import gantry

from tubeplanner import PosedProblem
from tubeplanner.explanation.end_changes import end_changes
from tubeplanner.explanation.limit_changes import effort_changes, limit_changes, payload_changes
from tubeplanner.explanation.question import Question

EFFORT, POSITION = "robot.limits.effort", "robot.limits.position"
TABLE = {"position": [-1.0, 1.0], "effort": [20.0, 30.0]}
PAYLOAD = {"mass": 5.0, "com": [0.0, 0.0, 0.0], "inertia": [0.01, 0.01, 0.01, 0, 0, 0]}


def sides(robot, joint=1, q=0.5):
    """Return what a joint's motor has each way at a position."""
    for each in robot.limits.effort_ranges:
        if each.joint == joint:
            return [each.allowed(np.array([q]), way)[0] for way in (-1, 1)]
    return [robot.limits.effort[joint]] * 2


@pytest.mark.parametrize(
    ("given", "before", "value", "scale"),
    [
        ({}, 27.0, 36.0, 1.0),
        ({"joint2": 20.0}, 20.0, 29.0, 0.5),
        ({"joint1": 80.0}, 27.0, 36.0, 0.5),
        (30.0, 30.0, {"joint1": 30.0, "joint2": 39.0}, 1.0),
        ([80.0, 20.0], 20.0, {"joint1": 80.0, "joint2": 29.0}, 0.5),
        ({"joint2": [20.0, 30.0]}, 30.0, [26.0, 39.0], 0.5),
        ({"joint2": TABLE}, 30.0, TABLE | {"effort": [26.0, 39.0]}, 0.5),
    ],
)
def test_one_joint_has_more_effort(given, before, value, scale):
    question = asked({EFFORT: given, "robot.limits.scale": {"effort": scale}})
    change = the(effort_changes(question, 1), f"{EFFORT}.joint2")
    assert (change.before, change.unit, change.about) == (before, "N m", {"joint2"})
    proposal = change.propose(9.0)
    assert list(proposal.changes.values()) == [value]
    assert proposal.after == before + 9
    assert proposal.text == f"joint2: 9 N m more ({before:g} -> {before + 9:g} N m)"
    less, more = question.robot, made(question, change, 9.0).robot
    np.testing.assert_allclose(sides(more), np.multiply(sides(less), (before + 9) / before))
    assert more.limits.effort[0] == less.limits.effort[0]
    np.testing.assert_array_equal(more.limits.velocity, less.limits.velocity)


def test_one_joint_has_less_effort():
    question = asked()
    change = the(effort_changes(question, -1), f"{EFFORT}.joint1")
    assert made(question, change, 12.3).robot.limits.effort.tolist() == [82.7, 27]
    assert change.propose(12.3).text == "joint1: 95 -> 82.7 N m"
    assert 0 < change.propose(change.most).after < 1


def test_a_motor_without_limit_needs_no_more():
    given = {EFFORT: [float("inf"), 20.0], "robot.limits.velocity": 5.0}
    question = asked(given)
    change = the(effort_changes(question, 1), f"{EFFORT}.joint2")
    assert [each.field for each in effort_changes(question, 1)] == [change.field]
    assert made(question, change, 1.0).robot.limits.effort.tolist() == [np.inf, 21]


def test_a_sliding_joint_has_newtons_and_metres(tmp_path):
    question = Question.of(PosedProblem.read(gantry(tmp_path)).changed({EFFORT: {}}))
    effort = the(limit_changes(question), f"{EFFORT}.along")
    assert effort.propose(5).text == "along: 5 N more (100 -> 105 N)"
    upper = the(limit_changes(question), f"{POSITION}.along", "upper")
    assert upper.propose(0.1).text == "along: upper limit 1 -> 1.1 m"


@pytest.mark.parametrize("given", [{}, {"joint2": [-3.0, 0.5]}, [[-6.0, 6.0], [-3.0, 0.5]]])
def test_one_end_of_a_range_is_moved_outwards(given):
    question = asked({POSITION: given})
    limits = question.robot.limits
    for end, sign in (("lower", -1), ("upper", 1)):
        change = the(limit_changes(question), f"{POSITION}.joint2", end)
        both = [limits.lower_position[1], limits.upper_position[1]]
        assert (change.before, change.unit, change.about) == (both, "rad", {"joint2"})
        wider = made(question, change, 0.25).robot.limits
        expected = [both[0] - 0.25 * (sign < 0), both[1] + 0.25 * (sign > 0)]
        np.testing.assert_allclose([wider.lower_position[1], wider.upper_position[1]], expected)
        assert wider.lower_position[0] == limits.lower_position[0]
        assert wider.upper_position[0] == limits.upper_position[0]
    text = the(limit_changes(asked({POSITION: {"joint2": [-3.0, 0.5]}})), change.field, "upper")
    assert text.propose(0.25).text == "joint2: upper limit 0.5 -> 0.75 rad"


def test_the_payload_is_lighter_or_heavier():
    question = asked({"robot.payload": PAYLOAD, "robot.gravity": [0, -9.81, 0]})
    q = np.array([[0.3, 0.2]])
    efforts = {}
    for way, size, mass in ((-1, 1.2, 3.8), (1, 1.2, 6.2)):
        (change,) = payload_changes(question, way)
        proposal = change.propose(size)
        assert (proposal.after, proposal.text) == (mass, f"payload at most {mass} kg")
        efforts[mass] = made(question, change, size).robot.gravity_effort(q)
        assert change.propose(change.most).after > 0
    efforts[5.0] = question.robot.gravity_effort(q)
    rates = [(efforts[6.2] - efforts[5.0]) / 1.2, (efforts[5.0] - efforts[3.8]) / 1.2]
    np.testing.assert_allclose(rates[0], rates[1])
    assert abs(rates[0]).min() > 1
    assert list(payload_changes(asked(), -1)) == []


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
    """Seeds, and joints that are not there, have no changes."""
    question = around(HERE, goal={"joints": [0.5, -1.0]})
    start, goal = (the(end_changes(question), end) for end in ("start", "goal"))
    assert start.is_switch and goal.is_switch
    assert start.propose(1).changes == {"start": {"seed": HERE}}
    assert made(question, goal, 1).goal is None
    beyond = asked({"start": {"joints": [0.1, 5.0]}})
    assert the(end_changes(beyond), "start").propose(1).after["seed"][1] == pytest.approx(np.pi)
    for others in ({}, {"start": {"joints": {"joint1": 0, "jiont2": 0}}}):
        assert list(end_changes(asked(others))) == []


def test_the_goal_is_turned_as_the_start_is():
    joints = [2.0, -1.7]
    tool = asked().robot.tool_position([joints])[0].tolist()
    question = asked({"goal": {"joints": joints}, "tube.points.3": tool})
    change = the(end_changes(question), "goal.joints", "goal: 0.05 rad on joint1")
    assert made(question, change, 0.02).goal.tolist() == [2.02, -1.7]
    assert change.about == {"goal", "joint1"}


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
