"""What a plan's result says of its grounds, and how what blocks an end may be moved."""

from dataclasses import replace

import numpy as np
import pytest
from cases import pose_at

from tubeplanner import (
    Obstacle,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    Seed,
    Tube,
    placement_of,
    plan,
)
from tubeplanner.first_guess.branches import KnownBranches
from tubeplanner.outcome import Infeasible, Location, PlanningClock
from tubeplanner.planning.diagnosis import require_possible
from tubeplanner.planning.result import refused_result, with_diagnosis

IN_THE_WAY = "in the start configuration"


def reason(**fields):
    return Infeasible(PlanStatus.NO_TRAJECTORY, "none", Location(), **fields)


@pytest.mark.parametrize(
    ("fields", "message", "starts"),
    [
        ({"proved": True}, "none; proved: there is no motion", None),
        ({"starts": 1}, "none; not found, 1 start tried", 1),
        ({"starts": 42}, "none; not found, 42 starts tried", 42),
        ({}, "none; not found", 0),
    ],
)
def test_a_refusal_says_how_sure_it_is(fields, message, starts):
    result = with_diagnosis(refused_result(reason(**fields), "refinement"))
    assert result.message == message
    assert result.proved is fields.get("proved", False)
    assert result.starts_tried == starts


START, GOAL = [0.2, -1.0], [0.9, -1.2]


def between(two_link, *obstacles, **more):
    """Return a problem with both ends given."""
    tube = Tube(two_link.tool_position(np.array([START, GOAL])), 0.3)
    ends = np.array(START), np.array(GOAL)
    return PlanningProblem(two_link, tube, *ends, obstacles=obstacles, **more)


def block_at(location):
    return Obstacle.box("block", [0.05, 0.05, 0.05], placement_of(location))


def refusal_of(problem):
    """Return what is in the way before anything is planned, or nothing."""
    try:
        require_possible(problem, KnownBranches(problem, PlanningClock(None, None)))
    except Infeasible as reason:
        return str(reason)
    return ""


@pytest.mark.parametrize("at", [START, GOAL])
def test_a_given_end_in_collision_is_proved(two_link, at):
    result = plan(between(two_link, block_at(two_link.tool_position(np.array(at)))))
    assert (result.status, result.proved) == (PlanStatus.TUBE_BLOCKED, True)
    assert result.as_dict()["proved"] is True
    assert result.message.endswith("; proved: there is no motion")


def test_moved_as_the_message_says_it_no_longer_blocks(two_link):
    tool = two_link.tool_position(np.array(START))

    def refusal_at(moved):
        return refusal_of(between(two_link, block_at(tool + moved)))

    words = plan(between(two_link, block_at(tool))).message.split("move 'block' by ")[1].split()
    size, way = float(words[0]) / 1000, words[3].rstrip(",;")
    axis = np.eye(3)["xyz".index(way[1])] * (1 if way[0] == "+" else -1)
    assert IN_THE_WAY not in refusal_at(1.001 * size * axis)
    assert IN_THE_WAY in refusal_at(0.98 * size * axis)


def test_clearance_that_a_given_end_leaves_is_in_the_message(two_link):
    above = two_link.tool_position(np.array(START)) + np.array([0, 0, 0.2])
    problem = between(two_link, block_at(above), clearance=0.18)
    message = plan(problem).message
    assert IN_THE_WAY in message
    named = message.split("clearance 180 -> ")[1].split()[0]
    freed = replace(problem, clearance=float(named) / 1000)
    assert IN_THE_WAY not in refusal_of(freed)


def test_what_a_seed_or_a_pose_leads_to_in_collision_is_not_proved(two_link):
    problem = between(two_link, block_at(two_link.tool_position(np.array(START))))
    starts = {", 1 start tried": Seed(np.array(START)), ", 2 starts tried": pose_at(problem, START)}
    for diagnosis, start in starts.items():
        result = plan(replace(problem, start=start))
        assert (result.status, result.proved) == (PlanStatus.TUBE_BLOCKED, False)
        assert result.message.endswith(diagnosis)
    assert (
        "of 2 configurations found for its pose 2 were tried, none has an answer" in result.message
    )


def test_an_answer_has_no_grounds(two_link):
    result = plan(between(two_link), PlanOptions(quality="fast"))
    assert result.succeeded
    assert result.proved is result.starts_tried is None
