"""Configurations of a tool pose, best first; joints out of bounds."""

from dataclasses import replace

import numpy as np
import pytest
from cases import changed, pose_at

from tubeplanner import LimitOverrides, Obstacle, ToolPose, load_problem, load_robot, placement_of
from tubeplanner.branches.joint_middle import half_ranges, middle_of
from tubeplanner.branches.outside_bounds import outside_bounds
from tubeplanner.branches.pose_configurations import pose_configurations
from tubeplanner.branches.reference_branch import end_configuration
from tubeplanner.outcome import Infeasible, PlanStatus

LOWER = np.array([-1.0, 2.0, -np.inf, 1.0, -np.inf])
UPPER = np.array([3.0, 2.0, np.inf, np.inf, -2.0])


def test_open_ranges_have_a_middle_too():
    assert middle_of(LOWER, UPPER).tolist() == [1.0, 2.0, 0.0, 1.0, -2.0]
    assert half_ranges(LOWER, UPPER).tolist() == [2.0, 0.0, np.pi, np.pi, np.pi]


def test_the_joint_farthest_outside_in_the_configuration_that_is_least_outside(two_link):
    found = np.array([[0.2, 3.0], [-1.3, 1.2]])
    outside = outside_bounds(two_link, found, np.array([-1.0, -1.0]), np.array([1.0, 1.0]))
    assert outside.joint == 0
    assert not outside.is_above
    assert outside.words == "'joint1' would be at -1.3, outside [-1, 1]"


# Configurations for a pose of the tool: which there are, which comes first, why there is none.


@pytest.fixture(scope="module")
def wall(bundled):
    return bundled("ur5/over_the_wall")


def given(problem, pose, signs=None):
    signs = problem.tube.joint_signs if signs is None else signs
    return changed(problem, start=pose, tube=replace(problem.tube, joint_signs=signs))


def refusal(problem):
    with pytest.raises(Infeasible) as caught:
        pose_configurations(problem, problem.start, 0)
    assert caught.value.status is PlanStatus.UNREACHABLE
    assert str(caught.value).startswith("start: ")
    return str(caught.value)


@pytest.fixture(scope="module")
def found(wall):
    """Return all configurations for the pose of the stored start."""
    pose = pose_at(wall, wall.start)
    return pose_configurations(given(wall, pose), pose, 0)


def test_all_have_the_tool_at_the_pose_inside_the_signs(wall, found):
    pose = pose_at(wall, wall.start)
    assert len(found) > 3
    rotation, position = wall.robot.tool_pose(found)
    errors = [pose.errors(*each) for each in zip(rotation, position, strict=True)]
    assert np.max(errors) < 1e-7
    assert (found >= wall.joint_lower[0]).all()
    assert (found <= wall.joint_upper[0]).all()


def test_a_start_is_the_first_of_them(wall):
    """Of those that are free, the stored one is the nearest to the middle of all ranges."""
    pose = pose_at(wall, wall.start)
    q = end_configuration(given(wall, pose), pose, 0)
    np.testing.assert_allclose(q, wall.start, atol=1e-6)


def test_signs_choose_the_branch(wall):
    pose = pose_at(wall, wall.start)
    q = end_configuration(given(wall, pose, {"elbow_joint": "-"}), pose, 0)
    assert q[2] < 0


def test_a_seed_chooses_the_configuration(wall, found):
    (chosen,) = pose_configurations(wall, pose_at(wall, wall.start, found[3] + 0.02), 0)
    np.testing.assert_allclose(chosen, found[3], atol=1e-6)


def test_free_ones_come_before_those_in_the_middle(wall, found):
    """A ball where the elbow is in the one that came first."""
    pose = pose_at(wall, wall.start)
    free, first = given(wall, pose), found[0]
    _, position = wall.robot.body_poses(first[None])
    elbow = wall.robot.joint_names.index("elbow_joint") + 1
    ball = Obstacle.sphere("ball", 0.05, placement_of(position[0, elbow]))
    blocked = changed(free, obstacles=(ball,))
    other = pose_configurations(blocked, pose, 0)[0]
    assert abs(other - first).max() > 0.1


def test_motors_that_hold_come_before_the_middle(wall):
    """Only some of them with a joint that is weaker than the first of all needs."""
    pose = pose_at(wall, wall.start)
    free = changed(wall, start=pose, obstacles=(), self_collision=False)
    found = pose_configurations(free, pose, 0)
    needed = abs(wall.robot.gravity_effort(found))
    gaps = needed[0] - needed.min(axis=0)
    joint = int(gaps.argmax())
    assert gaps[joint] > 1
    limit, name = float(needed[0, joint] - gaps[joint] / 2), wall.robot.joint_names[joint]
    weak = load_robot("example:ur5", "tool0", limits=LimitOverrides(effort={name: limit}))
    first = pose_configurations(changed(free, robot=weak), pose, 0)[0]
    assert abs(weak.gravity_effort(first[None])[0, joint]) <= limit


def test_the_sign_in_the_way_is_named(wall):
    """With the shoulder behind and the wrist as it is, no elbow folds so."""
    pose = pose_at(wall, wall.start)
    ranges = {"elbow_joint": "-", "shoulder_lift_joint": (-1.4, -1.2)}
    message = refusal(given(wall, pose, ranges))
    assert "no configuration with the joint signs of segment 0" in message
    assert "on another branch '" in message
    assert "change tube.joint_signs or the pose" in message


def test_a_position_limit_in_the_way_is_named(wall):
    pose = pose_at(wall, wall.start)
    limits = LimitOverrides(position={"elbow_joint": (-0.5, 0.5)})
    narrow = load_robot("example:ur5", "tool0", limits=limits)
    message = refusal(changed(wall, robot=narrow, start=pose))
    assert "position limits are in the way of the pose: 'elbow_joint' would be at" in message
    assert message.endswith("outside [-0.5, 0.5]")


def test_a_pose_out_of_reach_says_how_far(wall):
    points = np.array(wall.tube.points)
    points[0] = [1.5, 0, 0.3]
    tube = replace(wall.tube, points=points)
    message = refusal(changed(wall, tube=tube, start=ToolPose(placement_of(points[0]))))
    assert "the tool was brought no nearer to the pose than 0." in message


def test_an_arm_with_few_joints_cannot_turn_its_tool():
    gap = load_problem("example:two_link/around_a_post")
    q = end_configuration(gap, gap.start, 0)
    position = gap.robot.tool_position(q[None])[0]
    message = refusal(changed(gap, start=ToolPose(placement_of(position, rpy=[1.0, 0, 0]))))
    assert "the tool gets to the pose's position, but was turned no nearer than" in message


def test_a_seed_that_misleads_is_told_from_a_pose_that_is_none(wall):
    """Folded the other way and held there by its bounds."""
    pose = pose_at(wall, wall.start, np.array([3.0, 3.0, 0.0, 3.0, 3.0, 3.0]))
    problem = given(wall, pose)
    try:
        found = pose_configurations(problem, pose, 0)
    except Infeasible as reason:
        assert "its seed does not lead to the pose, others do" in str(reason)
    else:
        assert len(found) == 1
