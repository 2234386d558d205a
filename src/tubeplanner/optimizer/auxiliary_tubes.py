"""Substitute tubes: narrower about a smoother path, wider for coarse knots."""

from dataclasses import replace

import numpy as np
from scipy import sparse

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.errors import ProblemError
from tubeplanner.geometry.tube.tube import Tube
from tubeplanner.optimizer.phased_spline import KnotGrid
from tubeplanner.optimizer.segment_runs import sharpest_bend, smoothed_angles
from tubeplanner.task.problem import PlanningProblem

# ---- A narrower tube inside a tube, about a smoother path, where a path bends within its radius.
#
# A scan's points scatter about the intended path, some behind their predecessors, and a drawing may
# bend more sharply than its tube is wide. Fast motions need not follow every such bend: a smoother
# path fits in the tube. Where every point moves by at most d, points within r - d of a new segment
# are within r of the old one: between two segments, distances lie between those at their ends. So
# segments keep their order, their numbers and their conditions.

# Shares of the radius by which points may move; the first that leaves no bends sharper than this
# [rad over the length of a radius], or the last that reduces the sharpest by a tenth at least.
_SLACKS, _GENTLE, _SMOOTHER = (0.5, 0.8), 1.0, 0.9
# Largest distance of a given start or goal from its reference point, in radii.
_MAX_AT_ENDS = 0.9
# A larger turn of a path over some radii is no noise, and the tool must go there [rad].
_BACKWARDS = np.radians(150)
# Of the splitting method; distances settle to a thousandth of the room.
_STEPS, _COUPLING, _OVERSHOOT = 200, 0.1, 1.6
_MIN_STEP = 0.3  # of the usual one


def smoother_problem(problem: PlanningProblem) -> PlanningProblem | None:
    """Return a problem whose tube lies inside a problem's and bends less; None if there is none.

    It has the same segments, and a motion inside its tube is inside the problem's: but for points
    that count as turning back by noise alone, which it need not pass, and rotations, which are
    compared at other points of the segments. Boxes have none: about another path, they would have
    another orientation.
    """
    if problem.tube.is_box.any():
        return None
    best, least = None, _SMOOTHER * sharpest_bend(problem.tube)
    for slack in _SLACKS:
        candidate = _with_slack(problem, slack)
        bend = np.inf if candidate is None else sharpest_bend(candidate.tube)
        if bend < least:
            best, least = candidate, _SMOOTHER * bend
        if bend <= _GENTLE:
            break
    return best


def _with_slack(problem: PlanningProblem, fraction: float) -> PlanningProblem | None:
    """Return a problem about a path whose points may move by a fraction of the radius, if any."""
    tube, radius = problem.tube, problem.tube.effective_radius
    ends = tube.points[[0, -1]].copy()
    for row, end in enumerate(problem.endpoints):
        if end.joints is not None:
            ends[row] = problem.robot.tool_position(end.joints[None])[0]
        elif end.region is not None:
            ends[row] = end.region.position
    at_ends = np.linalg.norm(ends - tube.points[[0, -1]], axis=1)
    if (at_ends > _MAX_AT_ENDS * radius[[0, -1]]).any():
        return None
    slack = fraction * np.minimum(np.append(radius, np.inf), np.append(np.inf, radius))
    # Compulsory points where the path turns back over some radii.
    is_fixed = np.zeros(tube.segment_count + 1, dtype=bool)
    compulsory = tube.compulsory_points
    is_fixed[compulsory] = smoothed_angles(tube)[compulsory - 1] > _BACKWARDS
    slack[is_fixed] = 0.0
    slack[[0, -1]] = 0.0
    old = tube.points.copy()
    old[[0, -1]] = ends
    points = smoothed(old, slack, is_fixed)
    shift = np.linalg.norm(points - tube.points, axis=1)
    narrower = tube.radius - np.maximum(shift[:-1], shift[1:])
    try:
        smoother = replace(tube, points=points, radius=narrower)
        if smoother.segment_count != tube.segment_count:
            return None
        object.__setattr__(smoother, "parts", tube.parts)
        return replace(problem, tube=smoother)
    except ProblemError:  # points that meet, or an end on the edge of its rotation tolerance
        return None


def smoothed(points: FloatArray, slack: FloatArray, is_free: BoolArray) -> FloatArray:
    """Return points near others with about the least sum of squared curvatures.

    By the alternating direction method of multipliers (Boyd et al., "Distributed optimization and
    statistical learning", 2011, section 5), which alternates between bending and distance.

    Args:
        points: Shape (N, 3) [m].
        slack: Largest shift of each point, shape (N,) [m].
        is_free: Whether the path may bend at each point at no cost, shape (N,).
    """
    from scipy.sparse.linalg import splu

    bending = _bending(points, is_free) + _COUPLING * sparse.identity(len(points))
    solve = splu(bending.tocsc()).solve
    near, dual = points.copy(), np.zeros_like(points)
    for _ in range(_STEPS):
        target = _OVERSHOOT * solve(_COUPLING * (near - dual)) + (1 - _OVERSHOOT) * near + dual
        away = target - points
        distance = np.linalg.norm(away, axis=1)
        near = points + away * np.minimum(1.0, slack / np.maximum(distance, 1e-15))[:, None]
        dual = target - near
    return near


def _bending(points: FloatArray, is_free: BoolArray) -> sparse.csr_matrix:
    """Return the matrix (N, N) of the sum of squared curvatures over a path.

    Spacings count in medians, so that its scale is that of distances, and as no less than a part of
    one: noise makes some of them far shorter.
    """
    count = len(points)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    steps = np.maximum(steps / np.median(steps), _MIN_STEP)
    direction = sparse.diags([-1 / steps, 1 / steps], [0, 1], shape=(count - 1, count))
    bending = sparse.diags([-1.0, 1.0], [0, 1], shape=(count - 2, count - 1)) @ direction
    weight = ~is_free[1:-1] * 2 / (steps[1:] + steps[:-1])
    return (bending.T @ sparse.diags(weight) @ bending).tocsr()


# ---- A tube as wide as knots are coarse: a few cubics cannot follow a narrow one.

# The radius is at least this fraction of a knot interval's part of the segment.
_INTERVAL_FRACTION = 0.2
# At a corner it is at most this fraction of the radius of the circle that touches both legs at the
# end of the shorter one.
_CORNER_FRACTION = 0.1


def widened_radius(tube: Tube, grid: KnotGrid) -> FloatArray:
    """Return radii (m,) [m] of a tube that splines on a knot grid can follow.

    Near sharp corners the tube is hardly widened: else the spline would leave out the corner.
    """
    axis = np.diff(tube.points, axis=0)
    length = np.linalg.norm(axis, axis=1)
    interval = [
        length[run.start : run.stop].sum() / (len(fractions) - 1)
        for run, fractions in zip(grid.runs, grid.fractions, strict=True)
    ]
    interval_of = np.repeat(interval, [len(run) for run in grid.runs])
    # A circle that touches both legs at a distance d from the corner has the radius d tan(phi / 2),
    # phi being the angle between the legs.
    along = axis / length[:, None]
    cosine = -np.einsum("mi,mi->m", along[:-1], along[1:])
    with np.errstate(divide="ignore"):
        tangent = np.sqrt(np.clip(1 - cosine, 0, None) / np.clip(1 + cosine, 0, None))
    at_corners = _CORNER_FRACTION * np.minimum(length[:-1], length[1:]) * tangent
    widest = np.append(np.append(np.inf, at_corners), np.inf)
    widest = np.minimum(widest[:-1], widest[1:])
    coarse = np.minimum(_INTERVAL_FRACTION * interval_of, widest)
    widened: FloatArray = np.maximum(tube.effective_radius, coarse)
    return widened
