from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cases import PROBLEMS, SHORTEST
from tubeplanner import (
    GoalRegion,
    LimitOverrides,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    Seed,
    Tube,
    load_robot,
    plan,
)
from tubeplanner.branches.joint_lines import joint_lines
from tubeplanner.branches.reference_branch import RedundancyRule, redundancy_rules, reference_branch
from tubeplanner.outcome import Infeasible


def branch_of(problem):
    """Return the branch by the first rule for redundant joints."""
    return reference_branch(problem, redundancy_rules(problem)[0])


def two_link_problem(two_link, points, radius=0.03, signs=None, start=(0.0, -1.0), goal=None):
    points = [[x, y, 0.0] for x, y in points]
    tube = Tube(points, radius, joint_signs=signs or {})
    return PlanningProblem(two_link, tube, Seed(np.array(start)), goal)


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_branch_follows_the_reference_path_in_small_steps(name, bundled):
    problem = bundled(name)
    branch = branch_of(problem)
    for k, q in enumerate(branch.segments):
        tool = problem.robot.tool_position(q)
        assert problem.tube.distance(tool)[:, k].max() < 1e-3
        assert abs(np.diff(q, axis=0)).max() <= 0.1
        assert (q >= problem.joint_lower[k] - 1e-12).all()
        assert (q <= problem.joint_upper[k] + 1e-12).all()
        if k:
            np.testing.assert_array_equal(q[0], branch.segments[k - 1][-1])


@pytest.mark.parametrize("sign", ["+", "-"])
def test_the_sign_chooses_the_branch(sign, two_link):
    """Closed form: cos(q2) = (x^2 + y^2 - 2 l^2) / (2 l^2), its sign as asked."""
    elbow = 1.0 if sign == "+" else -1.0
    problem = two_link_problem(
        two_link, [(0.3, -0.3), (0.3, 0.3)], signs={"joint2": sign}, start=(0.0, elbow)
    )
    q = branch_of(problem).segments[0]
    x, y, _ = two_link.tool_position(q).T
    expected = elbow * np.arccos((x**2 + y**2 - 2 * 0.09) / (2 * 0.09))
    np.testing.assert_allclose(q[:, 1], expected, atol=1e-6)
    np.testing.assert_allclose(x, 0.3, atol=1e-8)


def test_a_fully_stretched_goal_is_reached(two_link):
    problem = two_link_problem(two_link, [(0.3, 0.0), (0.6, 0.0)], signs={"joint2": "-"})
    branch = branch_of(problem)
    np.testing.assert_allclose(branch.goal, 0, atol=5e-3)
    assert plan(problem, SHORTEST).succeeded


def test_a_given_goal_is_met_exactly_with_redundant_joints_blended(bundled):
    problem = bundled("panda/between_shelves")
    branch = branch_of(problem)
    np.testing.assert_array_equal(branch.start, problem.start)
    np.testing.assert_array_equal(branch.goal, problem.goal)


def test_a_goal_on_another_branch_is_named(two_link):
    q = np.array([-0.5, 1.0])
    tool = two_link.tool_position(q[None])[0]
    tube = Tube([[0.3, -0.3, 0], tool], 0.03)
    problem = PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])), q)
    with pytest.raises(Infeasible, match="the goal lies on another branch") as caught:
        branch_of(problem)
    assert caught.value.status is PlanStatus.UNREACHABLE
    assert caught.value.place.segment == 0


def test_a_point_out_of_reach_is_named_with_segment_place_and_shortfall(two_link):
    problem = two_link_problem(two_link, [(0.3, -0.3), (0.5, 0.0), (0.7, 0.0)])
    with pytest.raises(Infeasible, match=r"along segment 1, .* joints without limits") as caught:
        branch_of(problem)
    assert caught.value.place.segment == 1
    assert caught.value.place.position[0] == pytest.approx(0.613, abs=3e-3)


def test_a_point_slightly_out_of_reach_is_passed_within_the_radius(two_link):
    """The middle of the line is 5 mm beyond the arm's 0.6 m; the tube is 30 mm wide."""
    problem = two_link_problem(two_link, [(0.55, -0.15), (0.605, 0.0), (0.55, 0.15)])
    branch = branch_of(problem)
    tool = two_link.tool_position(branch.segments[0][-1:])
    assert problem.tube.distance(tool)[0].max() == pytest.approx(0.005, abs=1e-3)


def test_a_stretched_start_is_left(two_link):
    tube = Tube([[0.6, 0, 0], [0.3, 0, 0]], 0.03, joint_signs={"joint2": "-"})
    problem = PlanningProblem(two_link, tube, np.zeros(2))
    assert branch_of(problem).goal[1] < -1
    assert plan(problem, SHORTEST).succeeded


def test_signs_in_the_way_are_named(two_link):
    """The elbow must stay nearly straight, so the tool cannot come near the base."""
    problem = two_link_problem(
        two_link, [(0.55, 0.0), (0.3, 0.0)], signs={"joint2": [-1.0, 0]}, start=(0.3, -0.5)
    )
    with pytest.raises(Infeasible, match=r"joint signs of segment 0 \(at their bounds: joint2\)"):
        branch_of(problem)


def test_position_limits_in_the_way_are_named():
    limits = LimitOverrides(
        velocity={"joint1": np.inf, "joint2": np.inf}, position={"joint2": (-1.0, 0.0)}
    )
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    problem = two_link_problem(robot, [(0.55, 0.0), (0.3, 0.0)], start=(0.3, -0.5))
    with pytest.raises(Infeasible, match=r"position limits are in the way \(.*joint2\)"):
        branch_of(problem)


def test_a_seed_that_reaches_nothing_is_named(two_link):
    problem = two_link_problem(two_link, [(0.8, 0.0), (0.3, 0.0)])
    with pytest.raises(Infeasible, match=r"start from its seed: .* no nearer than 0\.2 m"):
        branch_of(problem)


def test_a_sign_may_change_where_the_joint_is_zero(ur5):
    """The wrist goes from its negative to its positive range; at the corner it must be at 0."""
    q = np.array([0.2, -1.2, 1.6, -1.8, -1.5, -0.3])
    tool = ur5.tool_position(q[None])[0]
    points = tool + np.array([[0, 0, 0], [0, 0.15, 0], [0, 0.15, 0.15]])
    signs = [{"wrist_3_joint": "-"}, {"wrist_3_joint": "+"}]
    problem = PlanningProblem(ur5, Tube(points, 0.05, joint_signs=signs), q)
    branch = branch_of(problem)
    assert branch.segments[0][-1][5] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("rule", RedundancyRule)
def test_redundant_joints_follow_their_rule(rule, bundled):
    """The Panda's last joint turns by 1 rad from start to goal, and the tool does not need it."""
    problem = bundled("panda/between_shelves")
    goal = problem.goal + np.array([0, 0, 0, 0, 0, 0, 1.0])
    problem = PlanningProblem(problem.robot, problem.tube, problem.start, goal)
    branch = reference_branch(problem, rule)
    np.testing.assert_array_equal(branch.goal, goal)
    turned = [float(q[0, 6] - problem.start[6]) for q in branch.segments]
    to_middle = -problem.start[6]  # the joint's range is symmetric
    expected = {
        RedundancyRule.PROPORTIONAL: [0, 0.26, 0.74],
        RedundancyRule.CENTRED: [0, to_middle, to_middle],
    }
    np.testing.assert_allclose(turned, expected.get(rule, [0, 0, 0]), atol=0.02)


DOWN = Rotation.from_quat([0.7071068, -0.7071068, 0, 0])


def tray_problem(bundled, tolerance, turns=((0, 0, 0),) * 4, first=DOWN, **changes):
    """The level tray's tube, its orientations turned from one point to the next, its rules new."""
    problem = bundled("ur5/level_tray")
    quaternions = [(first * Rotation.from_rotvec(turn)).as_quat() for turn in turns]
    fields = {"start": problem.start, **changes}
    tube = Tube(
        fields.pop("points", problem.tube.points),
        problem.tube.radius,
        joint_signs=problem.tube.joint_ranges,
        orientations=quaternions,
        rotation_tolerance=tolerance,
    )
    return PlanningProblem(problem.robot, tube, **fields)


def errors_of(problem, branch):
    """Return the rotation vectors along every segment of a branch."""
    poses = [problem.robot.tool_pose(q) for q in branch.segments]
    return [problem.tube.rotation.error(*pose, k) for k, pose in enumerate(poses)]


@pytest.mark.parametrize(
    "rule", [RedundancyRule.AS_NEEDED, RedundancyRule.HELD, RedundancyRule.CENTRED]
)
def test_the_tool_is_turned_as_the_reference_is(rule, bundled):
    """In all components, or in two of them, while the reference turns by up to 1.6 rad a leg."""
    robot = bundled("ur5/level_tray").robot
    start = bundled("ur5/level_tray").start
    first = Rotation.from_matrix(robot.tool_pose(start[None])[0][0])
    turns = [(0, 0, 0), (0, 0.5, 0), (0.5, 0, 1.5), (0, 0, 3.0)]
    for tolerance in (0.05, [[0.05, 0.05, np.inf]] * 3):
        problem = tray_problem(bundled, tolerance, turns, first)
        branch = reference_branch(problem, rule)
        for k, error in enumerate(errors_of(problem, branch)):
            bounded = np.isfinite(problem.tube.rotation.bounds[k, :3])
            counted = error[:, bounded] if bounded.any() else error
            assert abs(counted).max() < 1e-6
            assert abs(np.diff(branch.segments[k], axis=0)).max() <= 0.1


def test_a_start_off_the_reference_comes_back_to_it_in_proportion_to_the_way(bundled):
    """At its bound at first; a component that is free there, but not in the next leg, comes in."""
    problem = bundled("ur5/level_tray")
    rotation = Rotation.from_matrix(problem.robot.tool_pose(problem.start[None])[0][0])
    off = np.array([0.05, -0.03, 0.6])
    first = rotation * Rotation.from_rotvec(-off)
    tolerance = [[0.05, 0.05, np.inf], 0.1, 0.1]
    asked = tray_problem(bundled, tolerance, first=first)
    branch = branch_of(asked)
    errors = errors_of(asked, branch)
    np.testing.assert_allclose(errors[0][0], off, atol=1e-9)
    share = np.linspace(0, 1, len(errors[0]))[:, None]
    np.testing.assert_allclose(errors[0], (1 - share) * off, atol=1e-6)
    assert abs(np.concatenate(errors[1:])).max() < 1e-6
    assert plan(asked, PlanOptions("stop-at-corners")).succeeded


def test_a_goal_off_the_reference_is_met(bundled, stored):
    _, trajectory = stored("ur5/level_tray")
    q = trajectory.position(trajectory.duration) + np.array([0, 0, 0, 0.02, 0.0, 0.8])
    asked = tray_problem(bundled, [[0.05, 0.05, np.inf]] * 3, goal=q)
    branch = branch_of(asked)
    np.testing.assert_array_equal(branch.goal, q)
    assert asked.tube.rotation_margin(*asked.robot.tool_pose(branch.segments[2]))[:, 2].min() > 0
    assert plan(asked, PlanOptions("stop-at-corners")).succeeded


def test_seeds_are_turned_as_the_reference_is(bundled):
    problem = bundled("ur5/level_tray")
    seed = Seed(problem.start + np.array([0.05, -0.1, 0.1, 0.1, 0.1, 0.3]))
    asked = tray_problem(bundled, 0.02, start=seed)
    branch = branch_of(asked)
    assert max(abs(error).max() for error in errors_of(asked, branch)) < 1e-6


def planar_problem(two_link, tolerance, angles=(0.0, 0.0)):
    """The straight line on which the planar arm's tool turns from -1.04 by way of -0.72 to 0.14."""
    return PlanningProblem(
        two_link,
        Tube(
            [[0.45, -0.3, 0], [0.45, 0.3, 0]],
            0.03,
            orientations=[[0, 0, np.sin(a / 2), np.cos(a / 2)] for a in angles],
            rotation_tolerance=tolerance,
        ),
        Seed(np.array([0.0, -1.0])),
    )


ENDS = (-1.035835, 0.140170)


@pytest.mark.parametrize(
    ("tolerance", "angles", "message"),
    [
        (0.35, ENDS, None),
        (
            [[0.1, 0.1, 0.1]],
            ENDS,
            r"% along segment 0, .*: the rotation tolerance of segment 0, \[0.1, 0.1, 0.1\] rad, "
            r"is in the way: the tool can be turned no nearer than 0\.09.* rad to its reference "
            r"orientation, and planning keeps a tenth of the tolerance in reserve; widen "
            r"tube\.rotation_tolerance\[0\], change tube\.orientations or move",
        ),
        (
            0.9,
            (0.0, 0.0),
            r"start from its seed: the rotation tolerance of segment 0, 0.9 rad, is in the way: "
            r"the tool can be turned no nearer than 1\.04 rad",
        ),
    ],
)
def test_a_rotation_out_of_reach_is_named(tolerance, angles, message, two_link):
    """The planar arm's position leaves it no choice of its angle, 0.28 rad off in the middle."""
    problem = planar_problem(two_link, tolerance, angles)
    if message is None:
        assert plan(problem, PlanOptions("stop-at-corners")).succeeded
        return
    with pytest.raises(Infeasible, match=message) as caught:
        branch_of(problem)
    assert caught.value.status is PlanStatus.UNREACHABLE
    assert caught.value.place.segment == 0


def test_a_position_out_of_reach_is_not_blamed_on_the_rotation(two_link):
    tube = Tube(
        [[0.3, -0.3, 0], [0.7, 0.0, 0]],
        0.03,
        orientations=[[0, 0, 0, 1]] * 2,
        rotation_tolerance=3.0,
    )
    problem = PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])))
    with pytest.raises(Infeasible, match=r"the joints without limits"):
        branch_of(problem)


def test_the_next_segments_rotation_tolerance_holds_at_the_switching_time_too(two_link):
    tube = Tube(
        [[0.45, -0.3, 0], [0.45, 0, 0], [0.45, 0.3, 0]],
        0.03,
        orientations=[[0, 0, 0, 1]] * 3,
        rotation_tolerance=[2.0, 0.1],
    )
    problem = PlanningProblem(two_link, tube, Seed(np.array([0.0, -1.0])))
    message = r"100.0 % along segment 0, .*the rotation tolerance of segment 1, 0.1 rad, is in"
    with pytest.raises(Infeasible, match=message):
        branch_of(problem)


def test_the_branch_ends_in_the_middle_of_a_goals_ball(two_link):
    points = [(0.45, -0.3), (0.45, 0.1), (0.2, 0.3)]
    goal = GoalRegion([0.22, 0.31, 0.0], 0.02)
    problem = two_link_problem(two_link, points, goal=goal)
    branch = branch_of(problem)
    np.testing.assert_allclose(
        two_link.tool_position(branch.goal[None])[0], goal.position, atol=1e-8
    )
    assert RedundancyRule.PROPORTIONAL not in redundancy_rules(problem)
    lines = joint_lines(problem)
    np.testing.assert_allclose(
        two_link.tool_position(lines.goal[None])[0], goal.position, atol=1e-8
    )


@pytest.mark.parametrize("position", [[0.45, 0.3, 0.2], [0.45, 0.3, 0.3]])
def test_the_branch_ends_turned_as_a_goal_asks_that_alone_bounds_it(position, bundled):
    """At the last point, and where the tube's own orientation is not yet the last."""
    problem = bundled("ur5/level_tray")
    tube = problem.tube
    half = 0.1  # [rad] of the angle by which the last segment turns
    turned = [0.5**0.5 * value for value in (1.0, -1.0)]
    spun = Rotation.from_quat([*turned, 0, 0]) * Rotation.from_rotvec([0, 0, 2 * half])
    orientations = [*tube.orientations[:-1], spun.as_quat()]
    free = Tube(
        tube.points,
        tube.radius,
        joint_signs=list(tube.joint_ranges),
        orientations=orientations,
        rotation_tolerance=np.inf,
    )
    problem = replace(problem, tube=free, goal=GoalRegion(position, 0.0, 0.01))
    branch = branch_of(problem)
    for ended in (branch, joint_lines(problem)):
        rotation, _ = problem.robot.tool_pose(ended.goal[None])
        off = (spun.inv() * Rotation.from_matrix(rotation[0])).magnitude()
        assert off < (1e-6 if ended is branch else 1e-2)
