"""Start and goal from poses: the goal continues the start, and notes say what was taken."""

from dataclasses import replace

import numpy as np
import pytest

from cases import SHORTEST, changed, pose_at
from tubeplanner import ToolPose, load_problem, placement_of, plan, verify
from tubeplanner.branches.configured_ends import configured_ends
from tubeplanner.branches.pose_configurations import pose_configurations
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.outcome import Infeasible, PlanStatus


@pytest.fixture(scope="module")
def wall():
    return load_problem("example:ur5/over_the_wall")


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


def test_a_goal_that_nothing_continues_is_the_first_of_its_pose(wall, branch):
    """The elbow cannot be folded the other way without leaving the tube."""
    signs = [{}] * (wall.tube.segment_count - 1) + [{"elbow_joint": "-"}]
    tube = replace(wall.tube, joint_signs=signs)
    problem = changed(wall, tube=tube, goal=pose_at(wall, branch.goal))
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
    result = plan(posed, replace(SHORTEST, quality="fast"))
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
