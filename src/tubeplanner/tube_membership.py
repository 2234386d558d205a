"""Whether configurations, and whole motions, keep to the tube: hand in it, joints in their ranges.

Segments are visited in order, and at a hand-over both sides must hold; with `visit: any` some
segment must hold at every instant.
"""

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.hand_overs import best_hand_overs, best_margins
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


def current_segments(problem: PlanningProblem, q: FloatArray) -> IntArray:
    """Return the segment that each of N configurations of a motion, in order, is counted to: (N,).

    Hand-overs are where they leave the largest margin.
    """
    margin = membership_margin(problem, q)
    if problem.tube.visit == "any":
        return margin.argmax(axis=1)
    return np.searchsorted(best_hand_overs(margin), np.arange(len(q)), side="left")


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


def first_departure(
    problem: PlanningProblem, trajectory: JointTrajectory, tolerance: float
) -> int | None:
    """Return the first polynomial piece in which a motion leaves the tube; None if none does.

    Margins are taken at 65 samples per piece; valleys between samples are estimated by parabolas.

    Args:
        problem: What is asked.
        trajectory: Of the problem's joints.
        tolerance: How far below zero margins may lie [m or rad].
    """
    q = trajectory.per_piece(_SAMPLES_PER_PIECE).position
    margin = _with_valleys(membership_margin(problem, q))
    if problem.tube.visit == "any":
        outside = margin.max(axis=1) < -tolerance
    else:
        best = best_margins(margin)
        outside = best.max(axis=1) < -tolerance
        outside[-1] |= best[-1, -1] < -tolerance  # not arrived in the last segment
    if not outside.any():
        return None
    return int(outside.argmax()) // _SAMPLES_PER_PIECE


def _with_valleys(values: FloatArray) -> FloatArray:
    """Return samples of smooth functions, (N, m), the lowest lowered to the valley beside them."""
    before, at, after = values[:-2], values[1:-1], values[2:]
    slope, bend = (after - before) / 2, before - 2 * at + after
    is_valley = (at <= before) & (at <= after) & (bend > 0)
    depth = np.divide(slope**2, 2 * bend, out=np.zeros_like(at), where=is_valley)
    lowered = values.copy()
    lowered[1:-1] -= depth
    return lowered
