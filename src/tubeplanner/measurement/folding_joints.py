"""The joints whose signs distinguish an arm's configurations: elbows, and joints like them.

Where such a joint is at zero, the arm is nearer to a singularity than elsewhere: there two
configurations with the same tool position meet.
"""

from functools import lru_cache

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.problem.problem import PlanningProblem
from tubeplanner.robot.robot_model import RobotModel

_SAMPLES = 300
_SEED = 0
# A joint folds if at its zero the arm's least gain is below this share of what it is elsewhere.
_FOLDED_SHARE = 0.7
_NO_GAIN = 1e-6


def is_determined(robot: RobotModel) -> bool:
    """Return whether an arm has as many joints as the tool's position needs."""
    return _rank(robot) == robot.joint_count


@lru_cache(maxsize=16)
def folding_joints(robot: RobotModel) -> tuple[int, ...]:
    """Return the joints whose signs distinguish configurations, as indices of the group.

    Of a two-link arm the elbow, of a UR5 elbow and second wrist joint, of a Panda the second,
    fourth and sixth joint.
    """
    q = _random(robot)
    usual, found = _min_gain(robot, q), []
    for joint in np.flatnonzero((q.min(axis=0) < 0) & (q.max(axis=0) > 0)):
        folded = q.copy()
        folded[:, joint] = 0.0
        if _min_gain(robot, folded) < _FOLDED_SHARE * usual:
            found.append(int(joint))
    return tuple(found)


def sign_bounds(
    problem: PlanningProblem, segment: int, branch: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return joint bounds, (n,) each, with the signs that folding joints have along a branch."""
    lower, upper = problem.joint_lower[segment].copy(), problem.joint_upper[segment].copy()
    for joint in folding_joints(problem.robot):
        if branch[:, joint].min() >= 0:
            lower[joint] = max(lower[joint], 0.0)
        if branch[:, joint].max() <= 0:
            upper[joint] = min(upper[joint], 0.0)
    turns = problem.robot.revolute & (upper - lower > 2 * np.pi)
    middle = np.clip(branch.mean(axis=0), lower + np.pi, upper - np.pi)
    return np.where(turns, middle - np.pi, lower), np.where(turns, middle + np.pi, upper)


def _random(robot: RobotModel) -> FloatArray:
    limits = robot.limits
    lower = np.maximum(limits.lower_position, -np.pi)
    upper = np.minimum(limits.upper_position, np.pi)
    lower, upper = np.minimum(lower, upper), np.maximum(lower, upper)
    return np.random.default_rng(_SEED).uniform(lower, upper, (_SAMPLES, robot.joint_count))


def _rank(robot: RobotModel) -> int:
    """Return in how many directions the joints move the tool's position."""
    jacobian = robot.tool_jacobian(_random(robot))[1][:, :3]
    return int(np.median((np.linalg.svd(jacobian, compute_uv=False) > _NO_GAIN).sum(axis=1)))


def _min_gain(robot: RobotModel, q: FloatArray) -> float:
    """Return how little joints move the tool in the worst direction: a share, typical of (N, n).

    Only its position counts if the joints suffice for no more, otherwise its rotation too.
    """
    jacobian = robot.tool_jacobian(q)[1]
    if is_determined(robot):
        jacobian = jacobian[:, :3]
    gain = np.linalg.svd(jacobian, compute_uv=False)
    least = min(robot.joint_count, gain.shape[1]) - 1
    return float(np.median(gain[:, least] / np.maximum(gain[:, 0], _NO_GAIN)))
