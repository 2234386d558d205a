"""KnownBranches: branches of the arm along the reference path, joint lines, configured ends."""

from dataclasses import replace

import numpy as np
import pytest
from cases import SHORTEST, changed, pose_at
from scipy.spatial.transform import Rotation

from tubeplanner import (
    GoalRegion,
    LimitOverrides,
    Obstacle,
    PlanningProblem,
    PlanOptions,
    PlanStatus,
    Seed,
    ToolPose,
    Tube,
    load_robot,
    placement_of,
    plan,
    verify,
)
from tubeplanner.branches.configured_ends import configured_ends
from tubeplanner.branches.joint_lines import joint_lines
from tubeplanner.branches.pose_configurations import pose_configurations
from tubeplanner.branches.reference_branch import RedundancyRule, redundancy_rules, reference_branch
from tubeplanner.outcome import Infeasible


def branch_of(problem):
    """Return the branch by the first rule for redundant joints."""
    return reference_branch(problem, redundancy_rules(problem)[0])


def two_link_problem(two_link, points, radius=0.03, signs=None, start=(0.0, -1.0), goal=None):
    points = [[x, y, 0.0] for x, y in points]
    tube = Tube(points, radius, joint_signs=signs or {})
    return PlanningProblem(two_link, tube, Seed(np.array(start)), goal)


@pytest.mark.parametrize(
    "name", ["two_link/around_a_post", "ur5/level_tray", "panda/between_shelves"]
)
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


@pytest.mark.parametrize("rule", [RedundancyRule.AS_NEEDED, RedundancyRule.CENTRED])
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


def test_the_branch_ends_turned_as_a_goal_asks_that_alone_bounds_it(bundled):
    """Where the tube's own orientation is not yet the last."""
    position = [0.45, 0.3, 0.3]
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


# Starts of refinement that no continuous branch of the inverse kinematics gives.


@pytest.mark.parametrize("name", ["ur5/level_tray", "panda/between_shelves"])
def test_they_join_configurations_at_the_reference_points(name, bundled):
    problem = bundled(name)
    lines = joint_lines(problem)
    corners = np.array([lines.start, *(segment[-1] for segment in lines.segments)])
    tool = problem.robot.tool_position(corners)
    np.testing.assert_allclose(tool[1:-1], problem.tube.points[1:-1], atol=1e-6)
    for k, segment in enumerate(lines.segments):
        np.testing.assert_allclose(segment[0], corners[k])
        np.testing.assert_allclose(np.diff(segment, n=2, axis=0), 0, atol=1e-12)
        assert (segment >= problem.joint_lower[k] - 1e-12).all()
        assert (segment <= problem.joint_upper[k] + 1e-12).all()
    if problem.goal is not None:
        np.testing.assert_array_equal(lines.goal, problem.goal)
    if problem.tube.rotation is not None:
        margin = problem.tube.rotation.margin(*problem.robot.tool_pose(corners[1:]), 0)
        assert (margin > 0).all()


def other_elbow(two_link):
    """From one side of the stretched arm to the other: no branch goes on through it."""
    start, goal = np.array([0.0, -0.6]), np.array([-0.5, 0.6])
    tool = two_link.tool_position(np.array([start, goal]))
    return PlanningProblem(two_link, Tube(tool, 0.06), start, goal)


def test_a_goal_on_another_branch_is_reached_through_the_stretched_arm(two_link):
    problem = other_elbow(two_link)
    for rule in redundancy_rules(problem):
        with pytest.raises(Infeasible, match="the goal lies on another branch"):
            reference_branch(problem, rule)
    result = plan(problem, SHORTEST)
    assert result.succeeded
    assert result.method == "refinement"
    elbow = result.trajectory.position(np.linspace(0, result.duration, 50))[:, 1]
    assert elbow.min() < -0.5 < 0.5 < elbow.max()


@pytest.mark.dear("plans the motion of six joints from two goals")
def test_an_open_goal_is_moved_out_of_a_collision(ur5):
    """The nearest goal has the forearm in a ball; another one has not."""
    start = np.array([-0.773861, -1.294184, 1.830514, -1.925057, -1.682929, 0.0])
    tool = ur5.tool_position(start[None])[0]
    tube = Tube(tool + np.array([[0, 0, 0], [0, 0.4, 0.1]]), 0.08, joint_signs={"elbow_joint": "+"})
    open_problem = PlanningProblem(ur5, tube, start)
    goal = reference_branch(open_problem, redundancy_rules(open_problem)[0]).goal
    body = ur5.link_body["wrist_1_link"]
    wrist = ur5.body_poses(goal[None])[1][0, body]
    ball = Obstacle.sphere("ball", 0.05, placement_of(wrist + np.array([0.0, 0.0, 0.06])))
    problem = PlanningProblem(ur5, tube, start, obstacles=[ball])
    poses, checker = (part[0] for part in ur5.body_poses(goal[None])), problem.collision
    assert checker.distances(*poses, checker.obstacle_pairs).min() < 0
    result = plan(problem, replace(SHORTEST, quality="fast"))
    assert result.succeeded
    assert result.method == "refinement"


# Start and goal from poses: the goal continues the start, and notes say what was taken.


@pytest.fixture(scope="module")
def wall(bundled):
    return bundled("ur5/over_the_wall")


@pytest.fixture(scope="module")
def branch(wall):
    """Return the branch that goes on from the start by itself."""
    return reference_branch(wall, redundancy_rules(wall)[0])


def test_configurations_stay_as_they_are(wall):
    assert configured_ends(wall) == (wall, ())


def test_a_start_is_the_first_configuration_of_its_pose(wall):
    problem, notes = configured_ends(changed(wall, start=pose_at(wall, wall.start)))
    np.testing.assert_allclose(problem.start, wall.start, atol=1e-6)
    assert problem.goal is None
    assert len(notes) == 1
    assert "[-0.773861, -1.29418, 1.83051, -1.92506, -1.68293, 0] is taken" in notes[0]
    assert "free of collision and, of such, nearest the middle of its joint ranges" in notes[0]
    assert notes[0].startswith("start: of ")


def test_a_goal_continues_the_start_though_another_is_nearer_the_middle(wall, branch):
    """A turn of the wrist away from zero, where the start is a turn away too."""
    turned = np.array(wall.start)
    turned[3] += 2 * np.pi
    pose = pose_at(wall, branch.goal)
    problem = changed(wall, start=turned, goal=pose)
    first = pose_configurations(problem, pose, -1)[0]
    found, notes = configured_ends(problem)
    assert abs(first[3]) < np.pi < abs(found.goal[3])
    assert "it continues the branch from the start and is free of collision" in notes[0]
    assert any(_goes_on(found, rule) for rule in redundancy_rules(found))


def _goes_on(problem, rule):
    try:
        return reference_branch(problem, rule) is not None
    except Infeasible:
        return False


def test_a_goal_that_nothing_continues_is_the_first_of_its_pose(two_link):
    """The elbow cannot be folded the other way without leaving the tube."""
    problem = other_elbow(two_link)
    problem = changed(problem, goal=pose_at(problem, problem.goal))
    found, notes = configured_ends(problem)
    first = pose_configurations(problem, problem.goal, -1)[0]
    np.testing.assert_array_equal(found.goal, first)
    assert "continues" not in notes[0]


def test_from_a_seed_there_is_no_choice_and_no_note(wall, branch):
    seed = branch.goal + 0.05
    problem = changed(wall, goal=pose_at(wall, branch.goal, seed))
    found, notes = configured_ends(problem)
    np.testing.assert_allclose(found.goal, branch.goal, atol=1e-6)
    assert notes == ()


def test_what_is_planned_keeps_both_poses(wall, branch):
    posed = changed(
        wall, start=pose_at(wall, wall.start), goal=pose_at(wall, branch.goal, branch.goal)
    )
    result = plan(posed, PlanOptions("stop-at-corners", slack=0.0))
    assert result.succeeded
    certificate = verify(posed, result.trajectory)
    assert certificate.passed
    assert certificate.conditions["start"].coverage == "tool at its pose"
    assert any(note.startswith("start: of ") for note in result.notes)


def test_a_pose_that_cannot_be_reached_is_an_answer(wall):
    points = np.array(wall.tube.points)
    points[-1] = [1.5, 0, 0.3]
    goal = ToolPose(placement_of(points[-1]))
    result = plan(changed(wall, tube=replace(wall.tube, points=points), goal=goal))
    assert result.status is PlanStatus.UNREACHABLE
    assert "out of the arm's reach" in result.message and "move the goal" in result.message
