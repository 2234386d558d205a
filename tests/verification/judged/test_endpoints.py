"""Start and goal: what is missed, by how much, and by which joint."""

import numpy as np
import pytest

from cases import changed, pose_at
from tubeplanner import GoalRegion, JointTrajectory, Seed, ToolPose, placement_of, verify

UR5 = "ur5/over_the_wall"


def test_another_start_or_goal_is_found(stored):
    problem, trajectory = stored("panda/between_shelves")
    for end in ("start", "goal"):
        q = getattr(problem, end) + 1e-4
        certificate = verify(changed(problem, **{end: q}), trajectory)
        assert certificate.failures() == [end]
        assert certificate.conditions[end].margin == pytest.approx(-1e-4)


@pytest.mark.parametrize("joint", [0, 2, 5])
def test_the_joint_that_is_farthest_from_the_start_is_named(joint, stored):
    problem, trajectory = stored(UR5)
    other = np.array(problem.start)
    other += 1e-4
    other[joint] -= 5e-3
    condition = verify(changed(problem, start=other), trajectory).conditions["start"]
    assert condition.margin == pytest.approx(-4.9e-3, abs=1e-9)
    assert condition.where.joint == problem.robot.joint_names[joint]


def test_two_joints_in_each_others_place_are_found_at_the_start(stored):
    problem, trajectory = stored(UR5)
    names = list(problem.robot.joint_names)
    names[0], names[1] = names[1], names[0]
    certificate = verify(
        problem, JointTrajectory(names, trajectory.breakpoints, trajectory.coefficients)
    )
    assert "start" in certificate.failures()
    assert certificate.conditions["start"].where.joint in names[:2]
    assert certificate.conditions["start"].where.time == 0.0


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_tool_that_is_not_at_the_reference_point_is_found(end, stored):
    """Where any configuration will do that has the tool there."""
    problem, trajectory = stored(UR5)
    free = changed(problem, start=Seed(problem.start), goal=None)
    times = (0.0, 0.9) if end == "goal" else (0.1, 1.0)
    part = trajectory.between(*(share * trajectory.duration for share in times))
    index, time = (-1, part.duration) if end == "goal" else (0, 0.0)
    tool = problem.robot.tool_position(part.position([time]))[0]
    away = np.linalg.norm(tool - problem.tube.points[index])
    conditions = verify(free, part).conditions
    assert away > 1e-4
    assert conditions[end].margin == pytest.approx(-away)
    assert (conditions[end].unit, conditions[end].where.time) == ("m", time)
    assert conditions["goal" if end == "start" else "start"].margin > -1e-6


@pytest.mark.parametrize("tolerance", [0.0, 0.003, 0.02])
def test_how_far_the_tool_is_inside_its_ball_is_the_goals_margin(tolerance, stored):
    problem, trajectory = stored(UR5)
    position = problem.tube.points[-1] + [0.003, -0.004, 0.0]
    ending = changed(problem, goal=GoalRegion(position, tolerance))
    certificate = verify(ending, trajectory)
    goal = certificate.conditions["goal"]
    assert goal.margin == pytest.approx(tolerance - 0.005, abs=1e-6)
    assert (goal.unit, goal.where.time) == ("m", trajectory.duration)
    assert goal.coverage == f"tool within {tolerance:g} m of the goal's position"
    assert certificate.failures() == ([] if tolerance > 0.005 else ["goal"])


@pytest.mark.parametrize("end", ["start", "goal"])
def test_a_tool_that_is_not_at_its_pose_is_found(end, stored):
    problem, trajectory = stored(UR5)
    q = trajectory.position([0.0 if end == "start" else trajectory.duration])[0]
    pose = pose_at(problem, q)
    for shift, rpy, unit, margin in (
        ([0, 0, 0], [0, 0, 0], None, 0.0),
        ([0, 0, 2e-3], [0, 0, 1e-3], "m", -2e-3),
        ([0, 1e-3, 0], [0, 2e-3, 0], "rad", -2e-3),
    ):
        off = ToolPose(pose.placement @ placement_of(shift, rpy))
        condition = verify(changed(problem, **{end: off}), trajectory).conditions[end]
        assert condition.margin == pytest.approx(margin, abs=1e-9)
        assert unit in (None, condition.unit)
        assert condition.coverage == "tool at its pose"
        assert condition.where.time == (0.0 if end == "start" else trajectory.duration)
