import numpy as np
import pytest

from cases import PROBLEMS
from tubeplanner import (
    Obstacle,
    Payload,
    PlanningProblem,
    PlanStatus,
    Seed,
    Tube,
    load_problem,
    load_robot,
    placement_of,
    plan,
)
from tubeplanner.branches.known_branches import KnownBranches
from tubeplanner.outcome import Infeasible
from tubeplanner.planning.necessary_conditions import require_possible
from tubeplanner.progress import PlanningClock

SEED = Seed(np.array([0.0, -1.0]))  # of an arm that reaches 0.6 m


def required(problem):
    require_possible(problem, KnownBranches(problem, PlanningClock(None, None)))


def refused(problem):
    with pytest.raises(Infeasible) as caught:
        required(problem)
    return caught.value


@pytest.mark.parametrize("name", PROBLEMS)
def test_what_has_an_answer_is_not_refused(name):
    required(load_problem(f"example:{name}"))


def test_nothing_is_planned_first(two_link):
    block = Obstacle.box("block", [0.1, 0.1, 0.1], placement_of([0.3, -0.3, 0.0]))
    tube = Tube([[0.3, -0.3, 0], [0.3, 0.3, 0]], 0.03)
    stages = []
    result = plan(PlanningProblem(two_link, tube, SEED, obstacles=[block]), None, stages.append)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert [str(stage) for stage in stages] == ["start and goal"]


def test_an_open_goal_may_move(two_link):
    block = Obstacle.box("block", [0.01, 0.01, 0.1], placement_of([0.3, 0.3, 0.0]))
    tube = Tube([[0.3, -0.3, 0], [0.3, 0.3, 0]], 0.03)
    required(PlanningProblem(two_link, tube, SEED, obstacles=[block]))


def test_a_goal_that_the_motors_cannot_hold_is_named():
    robot = load_robot("example:ur5", "tool0", payload=Payload(mass=20.0))
    start = np.array([0.0, -np.pi / 2, 0.0, 0.0, 0.0, 0.0])  # upright
    goal = np.zeros(6)  # stretched out
    points = robot.tool_position(np.array([start, goal]))
    reason = refused(PlanningProblem(robot, Tube(points, 0.05), start, goal))
    assert reason.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    assert reason.place.joint == "shoulder_lift_joint"
    assert reason.place.position == pytest.approx(points[1])


@pytest.mark.parametrize(("point", "inside"), [(0.9, False), (0.8, True)])
def test_a_middle_point_may_be_cut_off_as_far_as_the_tube_is_wide(two_link, point, inside):
    """Capsules of 0.1 m meet up to 0.27 and 0.22 m from the corner; the arm has 0.6 m."""
    tube = Tube([[0.4, -0.2, 0], [point, 0, 0], [0.4, 0.2, 0]], 0.1)
    problem = PlanningProblem(two_link, tube, SEED)
    if inside:
        required(problem)
        return
    reason = refused(problem)
    assert reason.status is PlanStatus.UNREACHABLE
    assert "was brought no nearer than 0.3 m" in str(reason)
    assert reason.place.point == 1


def test_an_open_goal_must_be_reached(two_link):
    tube = Tube([[0.3, -0.3, 0], [0.3, 0.53, 0]], 0.2)
    reason = refused(PlanningProblem(two_link, tube, SEED))
    assert reason.place.point == 1
    assert reason.status is PlanStatus.UNREACHABLE
