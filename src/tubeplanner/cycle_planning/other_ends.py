"""Other configurations in which a move could end, where the next has no answer from its own."""

from collections.abc import Iterator

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.branches.configured_ends import is_continued
from tubeplanner.branches.inverse_kinematics import solve_position
from tubeplanner.branches.pose_configurations import is_free, spread_seeds
from tubeplanner.branches.reference_turn import wanted_at
from tubeplanner.cycle.cycle import Cycle
from tubeplanner.errors import ProblemError
from tubeplanner.outcome import MARGIN_TOLERANCE
from tubeplanner.problem.problem import PlanningProblem

_SAME = 0.1  # [rad or m] of every joint


def other_ends(cycle: Cycle, k: int, seams: list[FloatArray]) -> Iterator[FloatArray]:
    """Yield configurations (n,) in which leg k could begin, from which a branch leads along it.

    Those nearest to where the leg before begins come first.

    Args:
        cycle: The cycle; the leg before ends openly.
        k: The leg.
        seams: Configurations (n,) of the seams up to where it begins, the last one as it is now.
    """
    before = cycle.problem_from_anywhere(k - 1)
    after = cycle.problem_from_anywhere(k)
    lower = np.maximum(before.joint_lower[-1], after.joint_lower[0])
    upper = np.minimum(before.joint_upper[-1], after.joint_upper[0])
    if (lower > upper).any():
        return
    found = [seams[k]]
    for q in _reaching(before, seams[k], lower, upper):
        if all(abs(q - other).max() > _SAME for other in found):
            found.append(q)
    others = sorted(found[1:], key=lambda q: float(abs(q - seams[k - 1]).max()))
    yield from (q for q in others if _leads_on(cycle, k, [*seams[:k], q]))


def _reaching(
    problem: PlanningProblem, near: FloatArray, lower: FloatArray, upper: FloatArray
) -> Iterator[FloatArray]:
    """Yield configurations (n,) within bounds that have the tool where a leg ends openly."""
    goal = problem.open_goal
    assert goal is not None
    last = problem.tube.segment_count - 1
    for seed in [near, *spread_seeds(lower, upper)]:
        wanted = wanted_at(problem, goal.position, last, seed)
        solution = solve_position(problem.robot, goal.position, seed, lower, upper, rotation=wanted)
        if solution.error <= MARGIN_TOLERANCE / 2 and _is_turned(problem, solution.q, last):
            yield solution.q


def _is_turned(problem: PlanningProblem, q: FloatArray, segment: int) -> bool:
    """Return whether the tool is turned as a segment asks."""
    if problem.tube.rotation is None:
        return True
    rotation, tool = problem.robot.tool_pose(q[None])
    return bool(problem.tube.rotation.margin(rotation, tool, segment)[0] >= 0)


def _leads_on(cycle: Cycle, k: int, seams: list[FloatArray]) -> bool:
    """Return whether a leg can begin there, and a branch leads along it."""
    try:
        problem = cycle.problem(k, seams).joined
    except ProblemError:
        return False
    return is_free(problem, "start", seams[k]) and is_continued(problem)
