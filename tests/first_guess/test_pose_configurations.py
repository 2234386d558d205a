"""Configurations of a tool pose, best first; why a pose has none; joints out of bounds."""

from dataclasses import replace

import numpy as np
import pytest
from cases import changed, pose_at

from tubeplanner import LimitOverrides, Obstacle, ToolPose, load_robot, placement_of
from tubeplanner.first_guess.branches import end_configuration
from tubeplanner.first_guess.pose_configurations import (
    half_ranges,
    middle_of,
    outside_bounds,
    pose_configurations,
)
from tubeplanner.outcome import Infeasible, PlanStatus


def test_open_ranges_have_a_middle_too():
    lower = np.array([-1.0, 2.0, -np.inf, 1.0, -np.inf])
    upper = np.array([3.0, 2.0, np.inf, np.inf, -2.0])
    assert middle_of(lower, upper).tolist() == [1.0, 2.0, 0.0, 1.0, -2.0]
    assert half_ranges(lower, upper).tolist() == [2.0, 0.0, np.pi, np.pi, np.pi]


def test_the_joint_farthest_outside_in_the_configuration_that_is_least_outside(two_link):
    configurations = np.array([[0.2, 3.0], [-1.3, 1.2]])
    outside = outside_bounds(two_link, configurations, -np.ones(2), np.ones(2))
    assert outside.joint == 0
    assert not outside.is_above
    assert outside.words == "'joint1' would be at -1.3, outside [-1, 1]"


@pytest.fixture(scope="module")
def wall(bundled):
    """The problem from the pose that the tool has at its start."""
    problem = bundled("ur5/over_the_wall")
    return changed(problem, start=pose_at(problem, problem.start))


@pytest.fixture(scope="module")
def configurations(wall):
    """All configurations of the pose."""
    return pose_configurations(wall, wall.start, 0)


def with_signs(problem, signs, **fields):
    return changed(problem, tube=replace(problem.tube, joint_signs=signs), **fields)


def test_all_have_the_tool_at_the_pose_inside_the_signs(wall, configurations):
    assert len(configurations) > 3
    rotation, position = wall.robot.tool_pose(configurations)
    errors = [wall.start.errors(*each) for each in zip(rotation, position, strict=True)]
    assert np.max(errors) < 1e-7
    assert (configurations >= wall.joint_lower[0]).all()
    assert (configurations <= wall.joint_upper[0]).all()


def test_signs_or_a_seed_choose_among_them(wall, configurations, bundled):
    """Of those that are free, the stored one is the nearest to the middle of all ranges."""
    q = end_configuration(wall, wall.endpoints[0], 0)
    np.testing.assert_allclose(q, bundled("ur5/over_the_wall").start, atol=1e-6)
    assert end_configuration(with_signs(wall, {"elbow_joint": "-"}), wall.endpoints[0], 0)[2] < 0
    seeded = pose_at(wall, configurations[3], configurations[3] + 0.02)
    (chosen,) = pose_configurations(wall, seeded, 0)
    np.testing.assert_allclose(chosen, configurations[3], atol=1e-6)


def test_free_ones_come_before_those_in_the_middle(wall, configurations):
    """A ball where the elbow is in the one that came first."""
    first = configurations[0]
    _, position = wall.robot.body_poses(first[None])
    elbow = wall.robot.joint_names.index("elbow_joint") + 1
    ball = Obstacle.sphere("ball", 0.05, placement_of(position[0, elbow]))
    other = pose_configurations(changed(wall, obstacles=(ball,)), wall.start, 0)[0]
    assert abs(other - first).max() > 0.1


def test_motors_that_hold_come_before_the_middle(wall):
    """Only some of them with a joint that is weaker than the first of all needs."""
    free = changed(wall, obstacles=(), self_collision=False)
    needed = abs(wall.robot.gravity_effort(pose_configurations(free, wall.start, 0)))
    gaps = needed[0] - needed.min(axis=0)
    joint = int(gaps.argmax())
    assert gaps[joint] > 1
    limit, name = float(needed[0, joint] - gaps[joint] / 2), wall.robot.joint_names[joint]
    weak = load_robot("example:ur5", "tool0", limits=LimitOverrides(effort={name: limit}))
    first = pose_configurations(changed(free, robot=weak), wall.start, 0)[0]
    assert abs(weak.gravity_effort(first[None])[0, joint]) <= limit


def refusal(problem):
    with pytest.raises(Infeasible) as caught:
        pose_configurations(problem, problem.start, 0)
    assert caught.value.status is PlanStatus.UNREACHABLE
    assert str(caught.value).startswith("start: ")
    return str(caught.value)


def test_the_sign_in_the_way_is_named(wall):
    """With the shoulder behind and the wrist as it is, no elbow folds so."""
    signs = {"elbow_joint": "-", "shoulder_lift_joint": (-1.4, -1.2)}
    message = refusal(with_signs(wall, signs))
    assert "no configuration with the joint signs of segment 0" in message
    assert "on another branch '" in message
    assert "change tube.joint_signs or the pose" in message


def test_a_position_limit_in_the_way_is_named(wall):
    limits = LimitOverrides(position={"elbow_joint": (-0.5, 0.5)})
    narrow = load_robot("example:ur5", "tool0", limits=limits)
    message = refusal(changed(wall, robot=narrow))
    assert "position limits are in the way of the pose: 'elbow_joint' would be at" in message
    assert message.endswith("outside [-0.5, 0.5]")


def test_a_pose_out_of_reach_says_how_far(wall):
    points = np.array(wall.tube.points)
    points[0] = [1.5, 0, 0.3]
    tube = replace(wall.tube, points=points)
    message = refusal(changed(wall, tube=tube, start=ToolPose(placement_of(points[0]))))
    assert "m short of the pose; move the pose nearer" in message


def test_an_arm_with_few_joints_cannot_turn_its_tool(bundled):
    gap = bundled("two_link/around_a_post")
    q = end_configuration(gap, gap.endpoints[0], 0)
    pose = placement_of(gap.robot.tool_position(q[None])[0], rpy=[1.0, 0, 0])
    message = refusal(changed(gap, start=ToolPose(pose)))
    assert "the tool gets to the pose's position, but stays" in message


def test_a_seed_that_misleads_is_told_from_a_pose_that_is_none(wall, bundled):
    """From the seed the solver ends at bounds; it does so from all seeds beside it, too."""
    seed = np.array([0.5, 2.3, 1.1, -2.5, -0.1, 2.7])
    pose = pose_at(wall, bundled("ur5/over_the_wall").start, seed)
    assert "its seed does not lead to the pose, others do" in refusal(changed(wall, start=pose))
