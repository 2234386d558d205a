"""Plans of moves without a tube: routes from start and goal alone, in a cycle and in a problem."""

from copy import deepcopy

import numpy as np
import pytest

from tubeplanner import PlanOptions, load_problem, parse_cycle, plan, plan_cycle, verify_cycle
from tubeplanner.errors import OptionError
from tubeplanner.orientation import quaternion_of_matrix
from tubeplanner.outcome import PlanStatus
from tubeplanner.planning import free_plans

HERE = [-0.791217, -1.311999, 1.900383, -2.159181, -1.570796, 0.0]
THERE = [0.4, -1.311999, 1.900383, -2.159181, -1.570796, 0.0]
CYCLE = {
    "format": "tubeplanner/cycle",
    "robot": {"urdf": "example:ur5", "tool_frame": "tool0", "limits": {"acceleration": 15}},
    "start": {"joints": HERE},
    "obstacles": [{"name": "wall", "box": [0.6, 0.05, 0.35], "position": [0.6, 0, 0.175]}],
    "clearance": 0.01,
    "closed": True,
    "moves": [
        {
            "attach": "tray",
            "payload": {"mass": 2.0},
            "shape": {"box": [0.1, 0.1, 0.04], "position": [0, 0, 0.03]},
        },
        {"name": "over", "goal": {"joints": THERE}},
        {"detach": "tray"},
        {"to": "start"},
    ],
}
SHORTEST = PlanOptions(quality="fast", slack=0.0)


def with_(**changes):
    return deepcopy(CYCLE) | changes


@pytest.fixture(scope="module")
def result():
    return plan_cycle(parse_cycle(CYCLE), SHORTEST)


def test_moves_without_a_tube_lead_round_an_obstacle_with_what_is_carried(result):
    assert result.succeeded, result.message
    motion, arm = result.motion, result.motion.cycle.robot
    np.testing.assert_allclose(motion.junctions, [HERE, THERE, HERE], atol=1e-6)
    assert verify_cycle(motion.cycle, motion).passed
    assert result.duration < 1.01 * result.bound.duration
    over, back = motion.sections
    assert [solid.name for solid in over.problem.attached] == ["tray"]
    assert over.problem.robot.payload.mass == 2.0
    assert [each.name for each in back.problem.obstacles] == ["wall", "tray"]
    # The straight line in joint space leads through the wall.
    assert arm.tool_position(np.linspace(HERE, THERE))[:, 2].max() < 0.21
    for each in (over, back):
        q = each.trajectory.position(np.linspace(0, each.trajectory.duration))
        assert arm.tool_position(q)[:, 2].max() > 0.35
    assert [*motion.move_times] == ["over", "start"]


def test_the_same_cycle_has_the_same_answer(result):
    again = plan_cycle(parse_cycle(CYCLE), SHORTEST).motion.trajectory
    np.testing.assert_array_equal(again.coefficients, result.motion.trajectory.coefficients)


@pytest.mark.parametrize("kind", ["position", "pose"])
def test_of_an_open_goal_a_free_configuration_is_chosen_and_the_next_move_begins_there(kind):
    arm = parse_cycle(CYCLE).robot
    rotation, tool = (each[0] for each in arm.tool_pose(np.array([THERE])))
    goal = {"position": tool.tolist()}
    if kind == "pose":
        goal = {"pose": {**goal, "quaternion": quaternion_of_matrix(rotation).tolist()}}
    beside = [tool.tolist(), np.add(tool, [0, 0.1, 0.1]).tolist()]
    moves = [
        {"name": "over", "goal": goal},
        {"name": "on", "tube": {"points": beside, "radius": 0.1}},
    ]
    result = plan_cycle(parse_cycle(with_(moves=[*moves, {"to": "start"}])), SHORTEST)
    assert result.succeeded, result.message
    np.testing.assert_allclose(arm.tool_position(result.motion.junctions[1]), tool, atol=1e-6)
    np.testing.assert_allclose(result.motion.junctions[-1], HERE, atol=1e-6)


def test_a_refusal_names_the_move_and_where_the_search_ended(monkeypatch):
    monkeypatch.setattr(free_plans, "EDGES", 20)
    walls = [
        {"name": "left", "box": [3.0, 0.02, 4.0], "position": [1.76, 0, 0]},
        {"name": "right", "box": [3.0, 0.02, 4.0], "position": [-1.76, 0, 0]},
        {"name": "ceiling", "box": [3.0, 3.0, 0.02], "position": [0, 0, 0.59]},
    ]
    result = plan_cycle(parse_cycle(with_(obstacles=walls)), SHORTEST)
    assert (result.status, result.location.move) == (PlanStatus.NO_TRAJECTORY, "over")
    assert "move 1 of 2, 'over': no route was found by 2" in result.message
    x, y, z = result.location.position
    assert f"the tool to [{x:.3f}, {y:.3f}, {z:.3f}] m" in result.message


def test_a_problem_whose_tool_may_be_anywhere_is_planned_alike():
    problem = load_problem("example:two_link/through_the_gap", reads_tube=False)
    stopping = plan(problem, PlanOptions(method="stop-at-corners"))
    result = plan(problem, SHORTEST)
    assert stopping.succeeded and result.succeeded
    assert result.duration < 0.4 * stopping.duration
    with pytest.raises(OptionError, match="and there are none: the tool may be anywhere"):
        plan(problem, PlanOptions(method="branch-and-bound"))
