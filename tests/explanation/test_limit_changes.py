"""Changes of limits and payload load and do what they say, however a file gives the limits."""

import numpy as np
import pytest

from asked_problems import asked, made, the
from gantry import gantry
from tubeplanner import PosedProblem
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


@pytest.mark.parametrize("scale", [1.0, 0.5])
@pytest.mark.parametrize(
    ("given", "before", "value"),
    [
        ({}, 27.0, 36.0),
        ({"joint2": 20.0}, 20.0, 29.0),
        ({"joint1": 80.0}, 27.0, 36.0),
        (30.0, 30.0, {"joint1": 30.0, "joint2": 39.0}),
        ([80.0, 20.0], 20.0, {"joint1": 80.0, "joint2": 29.0}),
        ({"joint2": [20.0, 30.0]}, 30.0, [26.0, 39.0]),
        ({"joint2": TABLE}, 30.0, TABLE | {"effort": [26.0, 39.0]}),
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


@pytest.mark.parametrize(
    "given",
    [{}, {"joint2": [-3.0, 0.5]}, [[-6.0, 6.0], [-3.0, 0.5]]],
)
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
