"""Start and goal as configurations, where a problem gives poses of the tool."""

from dataclasses import replace

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.pose_configurations import is_free, pose_configurations, reaching
from tubeplanner.branches.reference_branch import redundancy_rules, reference_branch
from tubeplanner.outcome import Infeasible
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.problem.tool_pose import ToolPose

_MOST_TRIED = 8  # configurations of the goal


def configured_ends(problem: PlanningProblem) -> tuple[PlanningProblem, tuple[str, ...]]:
    """Return a problem whose start and goal are configurations where they were poses, and notes.

    Of several for the goal, the first one that continues the branch from the start is taken. The
    notes say which was taken where there was a choice.

    Raises:
        Infeasible: Status unreachable: a pose has none.
    """
    notes = []
    if isinstance(problem.start, ToolPose):
        found = pose_configurations(problem, problem.start, 0)
        notes += _choice(problem, "start", found, found[0], "")
        problem = replace(problem, start=found[0])
    if isinstance(problem.goal, ToolPose):
        found = pose_configurations(problem, problem.goal, -1)
        goal = _continuing(problem, problem.goal, found)
        why = "" if goal is None else "it continues the branch from the start and is "
        taken = found[0] if goal is None else goal
        notes += _choice(problem, "goal", found, taken, why)
        problem = replace(problem, goal=taken)
    return problem, tuple(notes)


def _continuing(problem: PlanningProblem, pose: ToolPose, found: FloatArray) -> FloatArray | None:
    """Return a configuration (n,) for the goal that a branch from the start leads to, if any.

    A free one, if any is free; one that is reached from where the branch ends by itself first.
    """
    if pose.seed is not None:
        return None
    candidates = np.vstack([_from_open_goal(problem, pose), found])
    free = [q for q in candidates if is_free(problem, "goal", q)]
    for q in (free or list(candidates))[:_MOST_TRIED]:
        if is_continued(replace(problem, goal=q)):
            return q
    return None


def _from_open_goal(problem: PlanningProblem, pose: ToolPose) -> FloatArray:
    """Return configurations (c, n) for a pose near where branches with an open goal end."""
    alone = replace(problem, goal=None)
    last = problem.tube.segment_count - 1
    bounds = problem.joint_lower[last], problem.joint_upper[last]
    for rule in redundancy_rules(alone):
        try:
            near = reference_branch(alone, rule).goal
        except Infeasible:
            continue
        return reaching(problem.robot, pose, near[None], *bounds)
    return np.empty((0, problem.robot.joint_count))


def is_continued(problem: PlanningProblem) -> bool:
    """Return whether a branch leads from a problem's start along its tube to its goal."""
    for rule in redundancy_rules(problem):
        try:
            reference_branch(problem, rule)
        except Infeasible:
            continue
        return True
    return False


def _choice(
    problem: PlanningProblem, end: str, found: FloatArray, taken: FloatArray, why: str
) -> list[str]:
    """Return the note on which of several configurations was taken; none if there is one."""
    if len(found) < 2:
        return []
    joints = ", ".join(f"{value:.6g}" for value in np.round(taken, 6) + 0.0)  # no minus zero
    free = "free of collision" if is_free(problem, end, taken) else "not free of collision"
    near = "" if why else " and, of such, nearest the middle of its joint ranges"
    return [
        f"{end}: of {len(found)} configurations found for its pose [{joints}] is taken: {why}{free}"
        f"{near}; a seed or joint signs ask for another"
    ]
