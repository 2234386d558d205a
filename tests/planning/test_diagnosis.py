"""Necessary conditions before planning: reach, held and free ends."""

import numpy as np
import pytest
from cases import PROBLEMS
from gantry import URDF

from tubeplanner import (
    Obstacle,
    Payload,
    PlanningProblem,
    PlanStatus,
    Seed,
    Tube,
    load_robot,
    placement_of,
    plan,
)
from tubeplanner.first_guess.branches import KnownBranches
from tubeplanner.outcome import Infeasible, PlanningClock
from tubeplanner.planning.diagnosis import (
    reach_bound,
    require_possible,
    require_within_bound,
)


@pytest.mark.parametrize("name", ["two_link/around_a_post", "panda/between_shelves"])
def test_no_configuration_has_the_tool_outside(name, bundled):
    robot = bundled(name).robot
    low = np.maximum(robot.limits.lower_position, -np.pi)
    high = np.minimum(robot.limits.upper_position, np.pi)
    q = np.random.default_rng(0).uniform(low, high, (2000, robot.joint_count))
    assert reach_bound(robot).beyond(robot.tool_position(q)).max() <= 1e-9


def test_stretched_out_the_tool_is_on_its_edge(two_link):
    bound = reach_bound(two_link)
    assert bound.radius == pytest.approx(0.6)
    assert bound.beyond(two_link.tool_position(np.zeros((1, 2))))[0] == pytest.approx(0.0)


def test_a_sliding_joint_reaches_as_far_as_its_range(tmp_path):
    (tmp_path / "gantry.urdf").write_text(URDF)
    gantry = load_robot(tmp_path / "gantry.urdf", "head")
    corners = np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]])
    bound = reach_bound(gantry)
    assert np.isfinite(bound.radius)
    assert bound.beyond(gantry.tool_position(corners)).max() <= 1e-9


LINE = [[0.3, -0.3, 0], [0.3, 0.3, 0]]
SEED = Seed(np.array([0.0, -1.0]))  # of an arm that reaches 0.6 m


def problem_of(two_link, points, radius=0.03, *obstacles):
    return PlanningProblem(two_link, Tube(points, radius), SEED, obstacles=obstacles)


@pytest.mark.parametrize(
    ("points", "radius", "message"),
    [
        ([[0.3, -0.3, 0], [0.599, 0, 0]], 0.03, None),
        ([[0.3, -0.3, 0], [0.61, 0, 0]], 0.03, None),  # the tool may end beside it
        (
            [[0.3, -0.3, 0], [0.64, 0, 0]],
            0.03,
            r"reaches 0\.6 m from .*; the goal is 0\.01 m too far: move",
        ),
        ([[0.368, -0.2, 0], [0.868, 0, 0], [0.368, 0.2, 0]], 0.1, None),
        (
            [[0.38, -0.2, 0], [0.88, 0, 0], [0.38, 0.2, 0]],
            0.1,
            r"sum of its links and 0\.2693 m of tolerance; ",
        ),
    ],
)
def test_a_point_beyond_all_links_is_proved(two_link, points, radius, message):
    """A goal, and a corner that may be cut as far as the tube is wide.

    Capsules of 0.1 m about legs of slope 2 to 5 meet up to 0.269 m from their corner.
    """
    problem = problem_of(two_link, points, radius)
    if message is None:
        require_within_bound(problem)
        return
    with pytest.raises(Infeasible, match=message) as caught:
        require_within_bound(problem)
    assert (caught.value.proved, caught.value.location.point) == (True, 1)
    result = plan(problem)
    assert (result.status, result.proved) == (PlanStatus.UNREACHABLE, True)
    assert (result.certificate, result.duration) == (None, None)
    assert "out of reach" in result.message
    assert result.message.endswith("; proved: there is no motion")


def test_where_it_starts_may_be_left_aside(two_link):
    problem = problem_of(two_link, [[0.7, 0, 0], [0.3, 0, 0]])
    with pytest.raises(Infeasible, match=r"the start is 0\.07 m too far: move it nearer"):
        require_within_bound(problem)
    require_within_bound(problem, start_is_known=False)


def test_millimetres_are_asked_about(two_link):
    with pytest.raises(Infeasible, match=r"the goal is 299 m too far \(millimetres\?\): move"):
        require_within_bound(problem_of(two_link, [[0.3, -0.3, 0], [300, 0, 0]]))


def required(problem):
    require_possible(problem, KnownBranches(problem, PlanningClock(None, None)))


def refused(problem):
    with pytest.raises(Infeasible) as caught:
        required(problem)
    return caught.value


@pytest.mark.parametrize("name", PROBLEMS)
def test_what_has_an_answer_is_not_refused(name, bundled):
    required(bundled(name))


def test_nothing_is_planned_first(two_link):
    block = Obstacle.box("block", [0.1, 0.1, 0.1], placement_of(LINE[0]))
    stages = []
    result = plan(problem_of(two_link, LINE, 0.03, block), None, stages.append)
    assert result.status is PlanStatus.TUBE_BLOCKED
    assert [str(stage) for stage in stages] == ["start and goal"]


def test_an_open_goal_may_move(two_link):
    block = Obstacle.box("block", [0.01, 0.01, 0.1], placement_of(LINE[1]))
    required(problem_of(two_link, LINE, 0.03, block))


def test_a_goal_that_the_motors_cannot_hold_is_named():
    robot = load_robot("example:ur5", "tool0", payload=Payload(mass=20.0))
    start = np.array([0.0, -np.pi / 2, 0.0, 0.0, 0.0, 0.0])  # upright
    goal = np.zeros(6)  # stretched out
    points = robot.tool_position(np.array([start, goal]))
    reason = refused(PlanningProblem(robot, Tube(points, 0.05), start, goal))
    assert reason.status is PlanStatus.GRAVITY_EXCEEDS_EFFORT
    assert reason.location.joint == "shoulder_lift_joint"
    assert reason.location.position == pytest.approx(points[1])


def test_a_middle_point_may_be_cut_off_as_far_as_the_tube_is_wide(two_link):
    """Capsules of 0.1 m meet up to 0.22 and 0.27 m from the corner; the arm has 0.6 m."""
    inside, outside = (
        problem_of(two_link, [[0.4, -0.2, 0], [x, 0, 0], [0.4, 0.2, 0]], 0.1) for x in (0.8, 0.9)
    )
    required(inside)
    reason = refused(outside)
    assert (reason.status, reason.location.point) == (PlanStatus.UNREACHABLE, 1)
    assert "stops 0.3 m short even without joint limits (0.2693 m is allowed)" in str(reason)
