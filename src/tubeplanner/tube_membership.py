"""Whether configurations, and whole motions, keep to the tube: hand in it, joints in their ranges.

Segments are visited in order, and at a hand-over both sides must hold; with `visit: any` some
segment must hold at every instant.
"""

from itertools import pairwise

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.hand_overs import best_hand_overs
from tubeplanner.problem import PlanningProblem
from tubeplanner.trajectory import JointTrajectory

_SAMPLES_PER_PIECE = 65


def membership_margin(problem: PlanningProblem, q: FloatArray) -> FloatArray:
    """Return how well configurations (N, n) keep each segment's conditions.

    Returns:
        Shape (N, m): the least of the hand's distance from the capsule's wall [m] and of the
        joints' distances from the ends of their ranges [rad or m]; negative outside.
    """
    hand = problem.tube.margin(problem.robot.tool_position(q))
    room = np.minimum(q[:, None] - problem.joint_lower, problem.joint_upper - q[:, None])
    return np.minimum(hand, room.min(axis=2))


def segments_reached(inside: BoolArray, segments: BoolArray, *, ordered: bool) -> BoolArray:
    """Return the segments in which S samples may end.

    Samples see no hand-over that happens between them, so that one is taken to be possible
    wherever the neighbouring samples lie in neighbouring segments.

    Args:
        inside: Whether each sample of N motions is inside each segment: bool, shape (N, S, m).
        segments: In which segments each motion may begin: bool, shape (N, m).
        ordered: Whether segments are visited in order.

    Returns:
        Bool, shape (N, m); all False where some sample is in no segment that can be reached.
    """
    if not ordered:
        somewhere: BoolArray = np.all(np.any(inside, axis=2), axis=1)
        return inside[:, -1] & somewhere[:, None]
    for now in inside.transpose(1, 0, 2):
        following = segments & now
        for k in range(1, now.shape[1]):
            following[:, k] |= now[:, k] & (segments[:, k - 1] | following[:, k - 1])
        segments = following
    return segments


def trajectory_margin(problem: PlanningProblem, trajectory: JointTrajectory) -> float:
    """Return the least margin of a whole motion, [m] or [rad].

    At 65 samples per polynomial piece; a valley between samples is estimated by a parabola.
    """
    margin = membership_margin(problem, trajectory.per_piece(_SAMPLES_PER_PIECE).position)
    if problem.tube.visit == "any":
        return _least(margin.max(axis=1))
    bounds = [0, *best_hand_overs(margin), len(margin) - 1]
    return min(
        _least(margin[begin : end + 1, k]) for k, (begin, end) in enumerate(pairwise(bounds))
    )


def _least(values: FloatArray) -> float:
    """Return the least value of a smooth function from its samples, shape (N,)."""
    least = float(values.min())
    before, at, after = values[:-2], values[1:-1], values[2:]
    valley = (at < before) & (at < after)
    slope, bend = (after - before)[valley] / 2, (before - 2 * at + after)[valley]
    return min(least, float((at[valley] - slope**2 / (2 * bend)).min(initial=np.inf)))
