from dataclasses import replace

import numpy as np
import pytest

from tubeplanner import (
    Obstacle,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    Seed,
    ToolPose,
    Tube,
    placement_of,
    plan,
)
from tubeplanner.outcome import Infeasible, Place
from tubeplanner.planning.grounds import with_grounds
from tubeplanner.planning.plan_result import refused_result

PROVED = "; proved: there is no motion"


def reason(**fields):
    return Infeasible(PlanStatus.NO_TRAJECTORY, "none", Place(), **fields)


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
    result = with_grounds(refused_result(reason(**fields), "refinement"))
    assert result.message == message
    assert result.proved is fields.get("proved", False)
    assert result.starts_tried == starts


def between(two_link, start, goal, *obstacles):
    points = two_link.tool_position(np.array([start, goal]))
    return PlanningProblem(
        two_link, Tube(points, 0.3), np.array(start), np.array(goal), obstacles=obstacles
    )


def block_at(two_link, q):
    tool = two_link.tool_position(np.array([q]))[0]
    return Obstacle.box("block", [0.05, 0.05, 0.05], placement_of(tool))


START, GOAL = [0.2, -1.0], [0.9, -1.2]


@pytest.mark.parametrize("at", [START, GOAL])
def test_a_given_end_in_collision_is_proved(two_link, at):
    problem = between(two_link, START, GOAL, block_at(two_link, at))
    result = plan(problem)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert result.proved
    assert result.as_dict()["proved"] is True
    assert result.message.endswith(PROVED)


def test_moved_as_the_message_says_it_no_longer_blocks(two_link):
    problem = between(two_link, START, GOAL, block_at(two_link, START))
    message = plan(problem).message
    words = message.split("move 'block' by ")[1].split()
    size, way = float(words[0]) / 1000, words[3].rstrip(",;")
    axis = np.eye(3)["xyz".index(way[1])] * (1 if way[0] == "+" else -1)
    place = two_link.tool_position(np.array([START]))[0] + 1.001 * size * axis
    moved = Obstacle.box("block", [0.05, 0.05, 0.05], placement_of(place))
    after = plan(replace(problem, obstacles=(moved,)), PlanOptions(quality="fast"))
    assert "in the start configuration" not in after.message
    place = place - 0.02 * size * axis
    short = Obstacle.box("block", [0.05, 0.05, 0.05], placement_of(place))
    assert "in the start configuration" in plan(replace(problem, obstacles=(short,))).message


def test_what_a_seed_leads_to_in_collision_is_not_proved(two_link):
    problem = between(two_link, START, GOAL, block_at(two_link, START))
    result = plan(replace(problem, start=Seed(np.array(START))))
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert result.proved is False


def test_a_chosen_configuration_of_a_pose_proves_nothing(panda):
    q = np.array([0.1, -0.3, 0.2, -2.0, 0.1, 2.0, 0.5])
    rotation, tool = panda.tool_pose(q[None])
    points = tool + np.array([[0, 0, 0], [0.05, 0, 0]])
    block = Obstacle.box("block", [0.05, 0.05, 0.05], placement_of(tool[0]))
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = rotation[0], tool[0]
    problem = PlanningProblem(panda, Tube(points, 0.02), ToolPose(placement), obstacles=[block])
    result = plan(problem, PlanOptions(quality="fast"))
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert result.proved is False
    assert ", 1 start tried" in result.message


def test_an_answer_has_no_grounds(two_link):
    result = plan(between(two_link, START, GOAL), PlanOptions(quality="fast"))
    assert result.succeeded
    assert result.proved is None
    assert result.starts_tried is None


def test_clearance_that_a_given_end_leaves_is_in_the_message(two_link):
    tool = two_link.tool_position(np.array([START]))[0]
    above = tool + np.array([0, 0, 0.2])
    block = Obstacle.box("block", [0.05, 0.05, 0.05], placement_of(above))
    problem = replace(between(two_link, START, GOAL, block), clearance=0.18)
    message = plan(problem).message
    named = message.split("clearance 180 -> ")[1].split()[0]
    freed = replace(problem, clearance=float(named) / 1000)
    assert "in the start configuration" not in plan(freed, PlanOptions(quality="fast")).message
