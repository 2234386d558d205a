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
from tubeplanner.first_guess.branches import (
    RedundancyRule,
    configured_ends,
    joint_lines,
    redundancy_rules,
    reference_branch,
)
from tubeplanner.first_guess.pose_configurations import pose_configurations
from tubeplanner.outcome import Infeasible

TRAY, SHELVES = "ur5/level_tray", "panda/between_shelves"


def branch_of(problem):
    """Return the branch by the first rule for redundant joints."""
    return reference_branch(problem, redundancy_rules(problem)[0])


def planar_problem(two_link, points, angles=None, start=(0.0, -1.0), goal=None, **tube):
    """Return a problem in the arm's plane; angles are those of the reference orientations [rad]."""
    if angles is not None:
        tube["orientations"] = Rotation.from_rotvec(np.outer(angles, [0, 0, 1])).as_quat()
    tube = Tube([[x, y, 0.0] for x, y in points], 0.03, **tube)
    return PlanningProblem(two_link, tube, Seed(np.array(start)), goal)


@pytest.mark.parametrize("name", ["two_link/around_a_post", TRAY, SHELVES])
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
    if problem.goal is not None:  # its redundant joints are blended
        np.testing.assert_array_equal(branch.start, problem.start)
        np.testing.assert_array_equal(branch.goal, problem.goal)


@pytest.mark.parametrize("elbow", [1.0, -1.0])
def test_the_sign_chooses_the_branch(elbow, two_link):
    """Closed form: cos(q2) = (x^2 + y^2 - 2 l^2) / (2 l^2), its sign as asked."""
    signs = {"joint2": "+" if elbow > 0 else "-"}
    problem = planar_problem(
        two_link, [(0.3, -0.3), (0.3, 0.3)], start=(0.0, elbow), joint_signs=signs
    )
    q = branch_of(problem).segments[0]
    x, y, _ = two_link.tool_position(q).T
    expected = elbow * np.arccos((x**2 + y**2 - 2 * 0.09) / (2 * 0.09))
    np.testing.assert_allclose(q[:, 1], expected, atol=1e-6)
    np.testing.assert_allclose(x, 0.3, atol=1e-8)


def test_a_fully_stretched_arm_is_reached_and_left(two_link):
    signs = {"joint2": "-"}
    outwards = planar_problem(two_link, [(0.3, 0.0), (0.6, 0.0)], joint_signs=signs)
    np.testing.assert_allclose(branch_of(outwards).goal, 0, atol=5e-3)
    inwards = planar_problem(two_link, [(0.6, 0.0), (0.3, 0.0)], joint_signs=signs)
    inwards = replace(inwards, start=np.zeros(2))
    assert branch_of(inwards).goal[1] < -1
    assert plan(outwards, SHORTEST).succeeded
    assert plan(inwards, SHORTEST).succeeded
    # The middle of this line is 5 mm beyond the arm's 0.6 m; the tube is 30 mm wide.
    beyond = planar_problem(two_link, [(0.55, -0.15), (0.605, 0.0), (0.55, 0.15)])
    tool = two_link.tool_position(branch_of(beyond).segments[0][-1:])
    assert beyond.tube.distance(tool)[0].max() == pytest.approx(0.005, abs=1e-3)


# Angles of the planar arm's tool at both ends of this line; in its middle it is at -0.72 rad.
UPRIGHT, ENDS = [(0.45, -0.3), (0.45, 0.3)], (-1.035835, 0.140170)
INWARDS = {"points": [(0.55, 0.0), (0.3, 0.0)], "start": (0.3, -0.5)}


@pytest.mark.parametrize(
    ("fields", "message", "segment"),
    [
        (  # the elbow bends the other way at the goal
            {"points": [(0.3, -0.3), (0.6 * np.cos(0.5), 0.0)], "goal": np.array([-0.5, 1.0])},
            "the goal lies on another branch",
            0,
        ),
        (  # the elbow must stay nearly straight
            {**INWARDS, "joint_signs": {"joint2": [-1.0, 0]}},
            r"joint signs of segment 0 \(at their bounds: joint2\)",
            0,
        ),
        (
            {"points": [(0.3, -0.3), (0.5, 0.0), (0.7, 0.0)]},
            r"along segment 1, .* short even without joint limits",
            1,
        ),
        (
            {"points": [(0.8, 0.0), (0.3, 0.0)]},
            r"start from its seed: the tool stops 0\.2 m short",
            0,
        ),
        (  # the position leaves the arm no choice of its angle
            {"points": UPRIGHT, "angles": ENDS, "rotation_tolerance": [[0.1, 0.1, 0.1]]},
            r"% along segment 0, .*: the rotation tolerance of segment 0, \[0.1, 0.1, 0.1\] rad, "
            r"is in the way: the tool stays 0\.09.* rad or more from its reference "
            r"orientation; planning keeps a tenth of the tolerance in reserve; widen "
            r"tube\.rotation_tolerance\[0\], change tube\.orientations or move",
            0,
        ),
        (
            {"points": UPRIGHT, "angles": (0.0, 0.0), "rotation_tolerance": 0.9},
            r"start from its seed: the rotation tolerance of segment 0, 0.9 rad, is in the way: "
            r"the tool stays 1\.04 rad or more",
            0,
        ),
        (  # the next segment's tolerance holds at the switching time too
            {
                "points": [(0.45, -0.3), (0.45, 0.0), (0.45, 0.3)],
                "angles": np.zeros(3),
                "rotation_tolerance": [2.0, 0.1],
            },
            r"100.0 % along segment 0, .*the rotation tolerance of segment 1, 0.1 rad, is in",
            0,
        ),
        (  # a position out of reach is not blamed on the rotation
            {
                "points": [(0.3, -0.3), (0.7, 0.0)],
                "angles": (0.0, 0.0),
                "rotation_tolerance": 3.0,
            },
            "even without joint limits",
            0,
        ),
    ],
)
def test_what_is_in_the_way_is_named(fields, message, segment, two_link):
    problem = planar_problem(two_link, **fields)
    with pytest.raises(Infeasible, match=message) as caught:
        branch_of(problem)
    assert caught.value.status is PlanStatus.UNREACHABLE
    assert caught.value.location.segment == segment
    if fields.get("angles") is ENDS:  # 0.28 rad off in the middle
        wider = planar_problem(two_link, **fields | {"rotation_tolerance": 0.35})
        assert plan(wider, PlanOptions("stop-at-corners")).succeeded
    if segment == 1:
        assert caught.value.location.position[0] == pytest.approx(0.613, abs=3e-3)


def test_position_limits_in_the_way_are_named():
    limits = LimitOverrides(position={"joint2": (-1.0, 0.0)})
    robot = load_robot("example:two_link", "hand", gravity=(0, 0, 0), limits=limits)
    with pytest.raises(Infeasible, match=r"position limits are in the way \(.*joint2\)"):
        branch_of(planar_problem(robot, **INWARDS))


def test_a_sign_may_change_where_the_joint_is_zero(ur5):
    """The wrist goes from its negative to its positive range; at the corner it must be at 0."""
    q = np.array([0.2, -1.2, 1.6, -1.8, -1.5, -0.3])
    points = ur5.tool_position(q[None])[0] + np.array([[0, 0, 0], [0, 0.15, 0], [0, 0.15, 0.15]])
    signs = [{"wrist_3_joint": "-"}, {"wrist_3_joint": "+"}]
    branch = branch_of(PlanningProblem(ur5, Tube(points, 0.05, joint_signs=signs), q))
    assert branch.segments[0][-1][5] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("rule", RedundancyRule)
def test_redundant_joints_follow_their_rule(rule, bundled):
    """The Panda's last joint turns by 1 rad from start to goal, and the tool does not need it."""
    problem = bundled(SHELVES)
    goal = problem.goal + np.array([0, 0, 0, 0, 0, 0, 1.0])
    branch = reference_branch(replace(problem, goal=goal, obstacles=()), rule)
    np.testing.assert_array_equal(branch.goal, goal)
    turned = [float(q[0, 6] - problem.start[6]) for q in branch.segments]
    to_middle = -problem.start[6]  # the joint's range is symmetric
    expected = {
        RedundancyRule.PROPORTIONAL: [0, 0.26, 0.74],
        RedundancyRule.CENTRED: [0, to_middle, to_middle],
    }
    np.testing.assert_allclose(turned, expected.get(rule, [0, 0, 0]), atol=0.02)


# Where the tool's rotation is bounded.

UP = Rotation.identity()
FREE_ABOUT_Z = [[0.05, 0.05, np.inf]] * 3


def tray_problem(bundled, tolerance, turns=((0, 0, 0),) * 4, first=UP, **fields):
    """Return the level tray with orientations turned from one point to the next, without goal."""
    problem = bundled(TRAY)
    quaternions = [(first * Rotation.from_rotvec(turn)).as_quat() for turn in turns]
    tube = replace(problem.tube, orientations=quaternions, rotation_tolerance=tolerance)
    fields = {"start": problem.start, "goal": None, "obstacles": (), **fields}
    return replace(problem, tube=tube, **fields)


def errors_of(problem, branch):
    """Return the rotation vectors along every segment of a branch."""
    poses = [problem.robot.tool_pose(q) for q in branch.segments]
    return [problem.tube.rotation.error(*pose, k) for k, pose in enumerate(poses)]


def start_rotation(bundled):
    problem = bundled(TRAY)
    return Rotation.from_matrix(problem.robot.tool_pose(problem.start)[0])


@pytest.mark.parametrize("rule", [RedundancyRule.AS_NEEDED, RedundancyRule.CENTRED])
@pytest.mark.parametrize("tolerance", [0.05, FREE_ABOUT_Z])
def test_the_tool_is_turned_as_the_reference_is(tolerance, rule, bundled):
    """In all components, or in two of them, while the reference turns by up to 1.6 rad a leg."""
    turns = [(0, 0, 0), (0, 0.5, 0), (0.5, 0, 1.5), (0, 0, 3.0)]
    problem = tray_problem(bundled, tolerance, turns, start_rotation(bundled))
    branch = reference_branch(problem, rule)
    for k, error in enumerate(errors_of(problem, branch)):
        bounded = np.isfinite(problem.tube.rotation.bounds[k, :3])
        assert abs(error[:, bounded] if bounded.any() else error).max() < 1e-6
        assert abs(np.diff(branch.segments[k], axis=0)).max() <= 0.1


def test_a_start_off_the_reference_comes_back_to_it_in_proportion_to_the_way(bundled):
    """At its bound at first; a component that is free there, but not in the next leg, comes in.

    From a seed the branch begins on the reference.
    """
    off = np.array([0.05, -0.03, 0.6])
    first = start_rotation(bundled) * Rotation.from_rotvec(-off)
    problem = tray_problem(bundled, [*FREE_ABOUT_Z[:1], 0.1, 0.1], first=first)
    errors = errors_of(problem, branch_of(problem))
    np.testing.assert_allclose(errors[0][0], off, atol=1e-9)
    fraction = np.linspace(0, 1, len(errors[0]))[:, None]
    np.testing.assert_allclose(errors[0], (1 - fraction) * off, atol=1e-6)
    assert abs(np.concatenate(errors[1:])).max() < 1e-6
    seed = Seed(bundled(TRAY).start + np.array([0.05, -0.1, 0.1, 0.1, 0.1, 0.3]))
    problem = tray_problem(bundled, 0.02, start=seed)
    assert abs(np.concatenate(errors_of(problem, branch_of(problem)))).max() < 1e-6


def test_a_goal_off_the_reference_is_met(bundled, stored):
    _, trajectory = stored(TRAY)
    q = trajectory.position(trajectory.duration) + np.array([0, 0, 0, 0.02, 0.0, -0.8])
    problem = tray_problem(bundled, FREE_ABOUT_Z, goal=q)
    branch = branch_of(problem)
    np.testing.assert_array_equal(branch.goal, q)
    pose = problem.robot.tool_pose(branch.segments[2])
    assert problem.tube.rotation_margin(*pose)[:, 2].min() > 0
    assert plan(problem, PlanOptions("stop-at-corners")).succeeded


def test_the_branch_ends_in_the_middle_of_a_goals_ball(two_link):
    goal = GoalRegion([0.22, 0.31, 0.0], 0.02)
    problem = planar_problem(two_link, [(0.45, -0.3), (0.45, 0.1), (0.2, 0.3)], goal=goal)
    for path in (branch_of(problem), joint_lines(problem)):
        tool = two_link.tool_position(path.goal[None])[0]
        np.testing.assert_allclose(tool, goal.position, atol=1e-8)
    assert RedundancyRule.PROPORTIONAL not in redundancy_rules(problem)


def test_the_branch_ends_turned_as_a_goal_asks_that_alone_bounds_it(bundled):
    """Where the tube's own orientation is not yet the last."""
    problem = bundled(TRAY)
    spun = UP * Rotation.from_rotvec([0, 0, 0.2])
    orientations = [*problem.tube.orientations[:-1], spun.as_quat()]
    tube = replace(problem.tube, orientations=orientations, rotation_tolerance=np.inf)
    problem = replace(problem, tube=tube, goal=GoalRegion([0.45, 0.3, 0.46], 0.0, 0.01))
    for path, bound in ((branch_of(problem), 1e-6), (joint_lines(problem), 1e-2)):
        rotation, _ = problem.robot.tool_pose(path.goal[None])
        assert (spun.inv() * Rotation.from_matrix(rotation[0])).magnitude() < bound


# Starts of refinement that no continuous branch of the inverse kinematics gives.


@pytest.mark.parametrize("name", [TRAY, SHELVES])
def test_joint_lines_join_configurations_at_the_reference_points(name, bundled):
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
    problem = PlanningProblem(ur5, tube, start)
    goal = branch_of(problem).goal
    wrist = ur5.body_poses(goal[None])[1][0, ur5.link_body["wrist_1_link"]]
    ball = Obstacle.sphere("ball", 0.05, placement_of(wrist + np.array([0.0, 0.0, 0.06])))
    problem = replace(problem, obstacles=[ball])
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
    """The branch that goes on from the start by itself."""
    return branch_of(wall)


def test_a_start_is_the_first_configuration_of_its_pose(wall):
    """Configurations stay as they are."""
    assert configured_ends(wall) == (wall, ())
    problem, (note,) = configured_ends(changed(wall, start=pose_at(wall, wall.start)))
    np.testing.assert_allclose(problem.start, wall.start, atol=1e-6)
    assert problem.goal is None
    assert "[-0.773861, -1.29418, 1.83051, -1.92506, -1.68293, 0] is taken" in note
    assert "free of collision and, of such, nearest the middle of its joint ranges" in note
    assert note.startswith("start: of ")


def test_a_goal_continues_the_start_though_another_is_nearer_the_middle(wall, branch):
    """A turn of the wrist away from zero, where the start is a turn away too."""
    turned = np.array(wall.start)
    turned[3] += 2 * np.pi
    pose = pose_at(wall, branch.goal)
    problem = changed(wall, start=turned, goal=pose)
    first = pose_configurations(problem, pose, -1)[0]
    continued, notes = configured_ends(problem)
    assert abs(first[3]) < np.pi < abs(continued.goal[3])
    assert "it continues the branch from the start and is free of collision" in notes[0]
    assert branch_of(continued) is not None


def test_a_goal_that_nothing_continues_is_the_first_of_its_pose(two_link, wall, branch):
    """The elbow cannot be folded the other way without leaving the tube."""
    problem = other_elbow(two_link)
    problem = changed(problem, goal=pose_at(problem, problem.goal))
    configured, notes = configured_ends(problem)
    first = pose_configurations(problem, problem.goal, -1)[0]
    np.testing.assert_array_equal(configured.goal, first)
    assert "continues" not in notes[0]
    # From a seed there is no choice and no note.
    pose = pose_at(wall, branch.goal, branch.goal + 0.05)
    configured, notes = configured_ends(changed(wall, goal=pose))
    np.testing.assert_allclose(configured.goal, branch.goal, atol=1e-6)
    assert notes == ()


def test_what_is_planned_keeps_both_poses(wall, branch):
    ends = {"start": pose_at(wall, wall.start), "goal": pose_at(wall, branch.goal, branch.goal)}
    spec = changed(wall, **ends)
    result = plan(spec, PlanOptions("stop-at-corners", slack=0.0))
    assert result.succeeded
    certificate = verify(spec, result.trajectory)
    assert certificate.passed
    assert certificate.conditions["start"].coverage == "tool at its pose"
    assert any(note.startswith("start: of ") for note in result.notes)


def test_a_pose_that_cannot_be_reached_is_an_answer(wall):
    points = np.array(wall.tube.points)
    points[-1] = [1.5, 0, 0.3]
    goal = ToolPose(placement_of(points[-1]))
    result = plan(changed(wall, tube=replace(wall.tube, points=points), goal=goal))
    assert result.status is PlanStatus.UNREACHABLE
    assert "out of reach" in result.message and "the goal is 0.275 m too far" in result.message
