"""What segments ask at any instant: at all of them, at one each, and nothing left out."""

import numpy as np
import pytest

from cases import SHORTEST
from tubeplanner import load_problem, plan
from tubeplanner.verification.enclosed_pose import enclosed_pose, enclosed_tool
from tubeplanner.verification.segment_margins import segment_margins


@pytest.fixture(scope="module")
def tray(stored):
    """A problem with joint signs and rotation tolerances, a trajectory, and its margins."""
    problem, trajectory = stored("ur5/level_tray")
    pose = enclosed_pose(problem.robot, trajectory, 1e-8, 1e-9)
    return problem, trajectory, segment_margins(problem, trajectory, pose.tool, pose.rotation, ())


@pytest.fixture(scope="module")
def times(tray):
    return np.random.default_rng(0).uniform(0, tray[1].duration, 200)


def test_they_are_those_of_tube_joints_and_rotation(tray, times):
    problem, trajectory, margins = tray
    q = trajectory.position(times)
    rotation, tool = problem.robot.tool_pose(q)
    lower, upper = problem.tube.ranges_of(problem.robot.joint_names)
    in_range = np.minimum(q[:, None] - lower, upper - q[:, None]).min(axis=2)
    expected = (
        problem.tube.margin(tool),
        in_range,
        problem.tube.rotation_margin(rotation, tool),
    )
    assert len(margins) == len(expected)
    for margin, wanted in zip(margins, expected, strict=True):
        np.testing.assert_allclose(margin.at(times), wanted, atol=1e-6)


def test_within_one_segment_each_they_are_the_same(tray, times):
    problem, _, margins = tray
    segment = np.random.default_rng(1).integers(0, problem.tube.segment_count, len(times))
    for margin in margins:
        every = margin.at(times)[np.arange(len(times)), segment]
        np.testing.assert_allclose(margin.within(segment, times), every, atol=1e-12)


def test_a_further_condition_is_asked_where_it_applies():
    problem = load_problem("example:two_link/around_a_post")
    trajectory = plan(problem, SHORTEST).trajectory
    tool = enclosed_tool(problem.robot, trajectory, 1e-7)
    further = (lambda *_: None, lambda *known: known)
    *_, last = segment_margins(problem, trajectory, tool, None, further)
    assert last == (problem, trajectory)
    assert len(segment_margins(problem, trajectory, tool, None, further)) == 3
