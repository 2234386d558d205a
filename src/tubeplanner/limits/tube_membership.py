"""Membership of configurations and trajectories in the tube: position, rotation, joint ranges.

Segments are visited in order, and at a switching time both sides must hold; with `visit: any` some
segment must hold at every instant.
"""

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.certificate.segment_margins import best_switching_samples
from tubeplanner.certificate.verification import judged_visits
from tubeplanner.geometry.tube.points import passing_radius
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, TrajectorySamples

_SAMPLES_PER_PIECE = 65
_MAX_STEP = 0.25  # of the reference path, from one sample to the next


def membership_margin(problem: PlanningProblem, q: FloatArray) -> FloatArray:
    """Return the margins of configurations (N, n) in each segment's conditions.

    Returns:
        Shape (N, m): the least of the tool's distance from the capsule's wall [m], of its
        rotation's from the bound [rad] and of the joints' distances from the ends of their ranges
        [rad or m]; negative outside.
    """
    rotation, position = problem.tube.tool_pose(problem.robot, q)
    tool = problem.tube.margin(position)
    if problem.tube.rotation is not None:
        tool = np.minimum(tool, problem.tube.rotation_margin(rotation, position))
    # Most segments share the joints' bounds: hundreds of segments have a few distinct bounds.
    lower, upper, bounds_of = problem.distinct_joint_bounds
    joint_margin = np.minimum(q[:, None] - lower, upper - q[:, None]).min(axis=2)
    return np.minimum(tool, joint_margin[:, bounds_of])


def current_segments(
    problem: PlanningProblem, trajectory: JointTrajectory, samples: TrajectorySamples
) -> IntArray:
    """Return the segments that count at samples of a trajectory, shape (N,).

    The switching times are the judge's. The samples could not tell: between two of them the tool
    may pass whole segments.
    """
    joined = problem.joined
    segment = judged_segments(problem, trajectory, samples.time)
    if joined is problem:
        return segment
    # Of the parts of a joined segment, the problem's own segments, the nearest to the tool counts.
    ends = joined.tube.part_points
    distance = problem.tube.distance(
        problem.tube.tool_pose(problem.robot, samples.position, samples.time)[1]
    )
    part = np.arange(problem.tube.segment_count)
    is_other = (part < ends[segment, None]) | (part >= ends[segment + 1, None])
    nearest: IntArray = np.where(is_other, np.inf, distance).argmin(axis=1)
    return nearest


def judged_segments(
    problem: PlanningProblem, trajectory: JointTrajectory, time: FloatArray
) -> IntArray:
    """Return the segments of `problem.joined` that count at times (K,) [s], shape (K,)."""
    visits = judged_visits(problem.joined, trajectory)
    ended = np.searchsorted([visit.end for visit in visits[:-1]], time)
    segment: IntArray = np.array([visit.segment for visit in visits])[ended]
    return segment


def nearest_segments(problem: PlanningProblem, tool: FloatArray) -> IntArray:
    """Return the capsules in which tools (N, 3) are deepest, in any order, shape (N,)."""
    nearest: IntArray = problem.tube.margin(tool).argmax(axis=1)
    return nearest


def tube_use(problem: PlanningProblem, tool: FloatArray, segment: IntArray) -> FloatArray:
    """Return the used fractions of the tube by tools (N, 3) in their segments (N,), shape (N,).

    Distance from the segment in radii: 0 on the segment, 1 on the capsule's wall.
    """
    return problem.tube.regions.fraction(tool, segment)


def passable_segments(tube: Tube) -> BoolArray:
    """Return True for segments that a tool may pass whole between two samples: bool, shape (m,).

    Between the switching times at its ends it travels at least the segment's length less twice the
    radius, or the larger half side of a box; samples are far less than a quarter of the reference
    path apart.
    """
    length = np.linalg.norm(np.diff(tube.points, axis=0), axis=1)
    return length <= 2 * tube.reach + _MAX_STEP * length.sum()


def segments_reached(
    inside: BoolArray, segments: BoolArray, passable: BoolArray, *, ordered: bool
) -> BoolArray:
    """Return the segments in which a trajectory may be at each of S samples.

    Samples miss a switching time between them: a switch counts as possible wherever neighbouring
    samples lie in neighbouring segments, or have passable segments between them.

    Args:
        inside: Whether each sample of N trajectories is inside each segment: bool, shape (N, S, m).
        segments: The segments in which each trajectory may begin: bool, shape (N, m).
        passable: The segments that may be passed between two samples: bool, shape (m,).
        ordered: Whether segments are visited in order.

    Returns:
        Bool, shape (N, S, m); all False from the first sample on that is in no reachable segment.
    """
    reached = inside.copy()
    if not ordered:
        reached &= np.logical_and.accumulate(np.any(inside, axis=2), axis=1)[:, :, None]
        return reached
    for s in range(inside.shape[1]):
        # Segments that may have been reached before this sample, and left again.
        passed = _carried(segments, np.broadcast_to(passable, segments.shape))
        entered = inside[:, s] & segments
        entered[:, 1:] |= inside[:, s, 1:] & passed[:, :-1]
        segments = reached[:, s] = _carried(entered, inside[:, s])
    return reached


def _carried(begun: BoolArray, open_: BoolArray) -> BoolArray:
    """Return True for columns from a beginning on, as long as columns are open.

    The recursion `carried[k] = begun[k] | (open_[k] & carried[k-1])` along the rows of (N, m): the
    last beginning is not before the last column that is not open.
    """
    column = np.arange(begun.shape[1])
    last_begun = np.maximum.accumulate(np.where(begun, column, -1), axis=1)
    last_shut = np.maximum.accumulate(np.where(open_, -1, column), axis=1)
    carried: BoolArray = (last_begun >= 0) & (last_begun >= last_shut)
    return carried


def first_departure(
    problem: PlanningProblem, trajectory: JointTrajectory, tolerance: float
) -> int | None:
    """Return the first polynomial piece in which a trajectory leaves the tube; None if none does.

    Margins are taken at 65 samples per piece; valleys between samples are estimated by parabolas.
    Too lenient, never too strict: events at switching times between samples are missed.

    Args:
        problem: The planning problem.
        trajectory: Of the problem's joints.
        tolerance: Accepted violation of the margins [m or rad].
    """
    q = trajectory.per_piece(_SAMPLES_PER_PIECE).position
    inside = (_with_valleys(membership_margin(problem, q)) >= -tolerance)[None]
    ordered = problem.tube.visit == "ordered"
    begin = np.arange(inside.shape[2])[None] == 0 if ordered else np.ones_like(inside[:, 0])
    reached = segments_reached(inside, begin, passable_segments(problem.tube), ordered=ordered)[0]
    outside = ~reached.any(axis=1)
    outside[-1] |= ordered and not reached[-1, -1]  # not arrived in the last segment
    if not outside.any():
        return None
    return int(outside.argmax()) // _SAMPLES_PER_PIECE


def may_pass_points(problem: PlanningProblem, trajectory: JointTrajectory) -> bool:
    """Return True if a trajectory may pass every compulsory point, at any time.

    Judged at 65 samples per piece, nearer by the steps beside them: too lenient, never too strict.
    """
    tube = problem.tube
    if len(tube.compulsory_points) == 0:
        return True
    samples = trajectory.per_piece(_SAMPLES_PER_PIECE)
    _, tool = tube.tool_pose(problem.robot, samples.position, samples.time)
    step = np.linalg.norm(np.diff(tool, axis=0), axis=1)
    reach = np.maximum(np.append(step, 0.0), np.append(0.0, step))
    radius = passing_radius(tube.effective_radius)
    return all(
        (np.linalg.norm(tool - tube.points[k], axis=1) - reach).min() <= radius[k - 1]
        for k in tube.compulsory_points
    )


def worst_membership(problem: PlanningProblem, trajectory: JointTrajectory) -> float:
    """Return a trajectory's least margin in the tube [m or rad].

    Margins are taken as for `first_departure`, and where the tool passes from nearer to one segment
    to nearer to the next; a switching time needs one of these samples inside both. Too strict by
    less than a micrometre, as a rule.
    """
    samples = trajectory.per_piece(_SAMPLES_PER_PIECE)
    margin = membership_margin(problem, samples.position)
    lowered = _with_valleys(margin)
    if problem.tube.visit == "any" or problem.tube.segment_count == 1:
        return float(lowered.max(axis=1).min())
    # Times between samples at which neighbouring segments fit equally well.
    nearer, time = np.diff(margin, axis=1), samples.time
    before = np.flatnonzero((nearer[:-1] * nearer[1:] < 0).any(axis=1))
    column = (nearer[before] * nearer[before + 1]).argmin(axis=1)
    begin, end = nearer[before, column], nearer[before + 1, column]
    change = time[before] + (time[before + 1] - time[before]) * begin / (begin - end)
    between = membership_margin(problem, trajectory.position(change))
    margin = np.insert(lowered, before + 1, between, axis=0)
    ends = [0, *best_switching_samples(margin), len(margin) - 1]
    visits = zip(ends, ends[1:], margin.T, strict=False)
    return min(float(inside[begin : end + 1].min()) for begin, end, inside in visits)


def _with_valleys(values: FloatArray) -> FloatArray:
    """Return samples of smooth functions, (N, m), each lowest lowered to the valley beside."""
    before, at, after = values[:-2], values[1:-1], values[2:]
    slope, bend = (after - before) / 2, before - 2 * at + after
    is_valley = (at <= before) & (at <= after) & (bend > 0)
    depth = np.divide(slope**2, 2 * bend, out=np.zeros_like(at), where=is_valley)
    lowered = values.copy()
    lowered[1:-1] -= depth
    return lowered
