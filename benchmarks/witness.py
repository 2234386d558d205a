"""A planning problem with a walk that solves it, and the check that it does."""

from dataclasses import dataclass

import numpy as np

from tubeplanner import PlanningProblem
from tubeplanner.collision.collision_checker import CollisionChecker

EFFORT_SHARE = 0.95  # of the motors' efforts that holding still may need along the walk
LINK_CLEARANCE = 0.005  # [m] that links keep beyond what is asked


@dataclass(frozen=True, eq=False)
class RandomCase:
    """A problem and a walk that solves it.

    Attributes:
        arm: Which arm, of `ARMS`.
        seed: What it was drawn from.
        problem: The planning problem.
        witness: Configurations (P, n); straight joint lines between them.
        switching_rows: The rows of the witness at which the tool is at the reference points.
    """

    arm: str
    seed: int
    problem: PlanningProblem
    witness: np.ndarray
    switching_rows: tuple[int, ...]


def witness_holds(case: RandomCase, parts: int = 4) -> bool:
    """Return whether a witness keeps everything its problem asks, on a dense sampling.

    Moved along it slowly enough, the arm then solves the problem.

    Args:
        case: A problem and its witness.
        parts: Into how many parts every step of the witness is divided.
    """
    q = _divided(case.witness, parts)
    return (
        _joins_the_ends(case)
        and all(_keeps_segment(case, k, parts) for k in range(case.problem.tube.segment_count))
        and _can_be_held(case.problem, q)
        and _keeps_clear(case.problem, q)
    )


def _joins_the_ends(case: RandomCase) -> bool:
    """Return whether a witness goes from start to goal, through all segments in order."""
    problem, switching_rows = case.problem, case.switching_rows
    ends = ((problem.start, case.witness[0]), (problem.goal, case.witness[-1]))
    if any(given is not None and not np.array_equal(given, q) for given, q in ends):
        return False
    has_all = len(switching_rows) == problem.tube.segment_count + 1
    return (
        has_all
        and (switching_rows[0], switching_rows[-1]) == (0, len(case.witness) - 1)
        and min(np.diff(switching_rows)) > 0
    )


def _keeps_segment(case: RandomCase, k: int, parts: int) -> bool:
    """Return whether a witness keeps capsule, rotation and joint ranges of a segment.

    It must end at the last reference point if the goal is open.
    """
    problem, tube = case.problem, case.problem.tube
    q = _divided(case.witness[case.switching_rows[k] : case.switching_rows[k + 1] + 1], parts)
    rotation, tool = problem.robot.tool_pose(q)
    is_last = k + 1 == tube.segment_count
    if is_last and problem.goal is None and not np.allclose(tool[-1], tube.points[-1], atol=1e-9):
        return False
    inside = (q >= problem.joint_lower[k]).all() and (q <= problem.joint_upper[k]).all()
    inside = inside and tube.margin(tool)[:, k].min() >= 0
    return bool(inside and tube.rotation_margin(rotation, tool, slice(k, k + 1)).min() >= 0)


def _can_be_held(problem: PlanningProblem, q: np.ndarray) -> bool:
    """Return whether the motors can hold the arm still, something to spare, wherever it is."""
    limits = problem.robot.limits
    return bool((abs(problem.robot.gravity_effort(q)) <= EFFORT_SHARE * limits.effort).all())


def _keeps_clear(problem: PlanningProblem, q: np.ndarray) -> bool:
    checker = problem.collision
    clearance = problem.clearance + LINK_CLEARANCE
    return keeps_apart(checker, q, checker.link_pairs, LINK_CLEARANCE) and keeps_apart(
        checker, q, checker.obstacle_pairs, clearance
    )


def keeps_apart(
    checker: CollisionChecker, q: np.ndarray, pairs: np.ndarray, clearance: float
) -> bool:
    """Return whether pairs of shapes are at least so far apart [m] in configurations (N, n)."""
    if len(pairs) == 0:
        return True
    rotation, position = checker.robot.body_poses(q)
    # Bounding spheres are enough for most.
    for k, near in enumerate(checker.sphere_distances(rotation, position, pairs)):
        close = pairs[near < clearance]
        if len(close) and checker.distances(rotation[k], position[k], close).min() < clearance:
            return False
    return True


def _divided(q: np.ndarray, parts: int) -> np.ndarray:
    """Return configurations (N, n) with every step between them divided into equal parts."""
    at = np.arange((len(q) - 1) * parts + 1) / parts
    return np.array([np.interp(at, np.arange(len(q)), column) for column in q.T]).T
