"""The least time of the tool alone through a tube at its speed limits, proved.

In a tube visited in order, the tool passes points p_0 (start), p_1, ... p_m (goal). Segment k
begins at p_k, which lies in the regions of segments k-1 and k. From p_k to p_k+1 the tool takes
at least w_k |p_k+1 - p_k|, where 1/w_k is the speed limit of segment k. The least sum over k is a
convex problem. With any u_k no longer than w_k, and any n_kj whose sum over the regions R_j of
point k is u_k - u_k-1,

  sum w_k |p_k+1 - p_k| >= sum u_k (p_k+1 - p_k) = - sum n_kj p_k >= - sum max {n_kj p: p in R_j}.

However far u and n are from the best, the last sum is a bound. They are sought by the alternating
direction method of multipliers (Boyd et al. 2011, section 3.1).

The ball about a point that must be passed replaces the regions of p_k. The point is passed in
segment k-1 or k: on both sides the faster of both limits counts. Of two such points in a row,
which may be passed in any order, the first counts.
"""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.tube.points import MIN_LENGTH, passing_radius
from tubeplanner.geometry.tube.regions import Capsules, SegmentRegions
from tubeplanner.limits.rates import ToolSpeed
from tubeplanner.task.problem import PlanningProblem

# In 350 tubes of 1 to 190 segments, with one or with random limits, the bound is then within 1 % of
# the best in all but nine: within 14 %.
_ITERATIONS = 400
_CHECKED = 25  # iterations from one bound to the next
_SMALL_GAIN = 1e-4  # of the bound, from one to the next: the last one
_RELAXATION = 1.7  # from 1.5 to 1.8 as a rule (Boyd et al. 2011, section 3.4.3)
_TINY = np.finfo(float).tiny

# Some regions, the point that lies in each, and the region's index: (R,) each.
_Held = tuple[SegmentRegions, IntArray, IntArray]


def tool_travel(problem: PlanningProblem, known: float = 0.0) -> tuple[float, int | None]:
    """Return the least time of the tool through the tube at its speed limits [s]; 0 without any.

    And the index of the segment in which the tool takes longest; None: the tool may be anywhere.

    Args:
        problem: With equal, collinear segments joined.
        known: Another lower bound [s]; where the time along the reference points is no longer, the
            least time is not sought, and 0 is returned.
    """
    tube, count = problem.tube, problem.tube.segment_count
    weight = 1 / ToolSpeed(problem).limit  # [s/m]
    centres, radii = map(list, zip(*[end_ball(problem, index) for index in (0, -1)], strict=True))
    path = np.vstack([centres[:1], tube.points[1:-1], centres[1:]])
    if weight @ np.linalg.norm(np.diff(path, axis=0), axis=1) <= known:
        return 0.0, None
    if tube.visit == "any":
        return _least_time(weight.min(keepdims=True), [_balls(centres, radii, [0, 1])])[0], None
    numbers = [0, count]
    passing, beside = passing_radius(tube.effective_radius), weight.copy()
    for k in tube.compulsory_points.tolist():
        if numbers[-1] != k - 1:
            numbers.append(k)
            centres.append(tube.points[k])
            radii.append(passing[k - 1])
            weight[k - 1 : k + 1] = beside[k - 1 : k + 1].min()
    every = np.arange(count)
    points, segments = np.concatenate([every, every + 1]), np.concatenate([every, every])
    is_free = ~np.isin(points, numbers[2:])
    held = tube.regions, points[is_free], segments[is_free]
    return _least_time(weight, [_balls(centres, radii, numbers), held])


def end_ball(problem: PlanningProblem, index: int) -> tuple[FloatArray, float]:
    """Return the ball of the tool at start (0) or goal (-1): centre (3,) [m] and radius [m]."""
    end, radius = problem.endpoints[index], float(problem.end_radii[index])
    if end.joints is not None:
        return problem.robot.tool_position(end.joints), 0.0
    centre = problem.tube.points[index] if end.position is None else end.position
    return centre, radius if end.region is None else max(radius, end.region.tolerance)


def _balls(centres: list[FloatArray], radii: list[float], points: list[int]) -> _Held:
    balls = Capsules(np.array(centres), np.array(centres), np.array(radii))
    return balls, np.array(points), np.arange(len(points))


def _least_time(weight: FloatArray, held: list[_Held]) -> tuple[float, int]:
    """Return a lower bound on sum w_k |p_k+1 - p_k| of m+1 points in regions, for weights (m,).

    And the index of the largest term.

    With D for the differences of points and S for the point of every region, the method's terms are
    |D p - z + u|^2 + |S p - y + n|^2. The multipliers u and n are lengths.
    """
    if not weight.any():  # no limit
        return 0.0, 0
    from scipy.linalg import cho_solve_banded, cholesky_banded

    at = np.concatenate([points for _, points, _ in held])
    splits = np.cumsum([len(points) for _, points, _ in held])[:-1]
    narrowest = np.argsort(np.concatenate([region.radius[k] for region, _, k in held]))
    narrowest = narrowest[np.unique(at[narrowest], return_index=True)[1]]  # of each point
    ones, per_point = np.ones(len(weight)), np.bincount(at).astype(float)
    diagonal = np.append(ones, 0) + np.append(0, ones) + per_point  # of D^T D + S^T S
    factors = cholesky_banded(np.stack([diagonal, np.append(-ones, 0)]), lower=True), True

    def summed(rows: FloatArray) -> FloatArray:
        """Return S^T times rows (R, 3), shape (m+1, 3)."""
        return np.stack([np.bincount(at, column, len(per_point)) for column in rows.T], axis=1)

    def difference(rows: FloatArray) -> FloatArray:
        """Return -D^T times rows (m, 3), shape (m+1, 3)."""
        return np.diff(rows, axis=0, prepend=0, append=0)

    y = np.concatenate([(region.begin[k] + region.end[k]) / 2 for region, _, k in held])
    z = np.diff(summed(y) / per_point[:, None], axis=0)
    u, n, best = np.zeros_like(z), np.zeros_like(y), 0.0
    # Multipliers of the least time are no longer than the weights: as lengths, than the tube.
    per_weight = max(float(np.linalg.norm(z, axis=1).sum()), MIN_LENGTH) / weight.max()
    for iteration in range(1, _ITERATIONS + 1):
        p = cho_solve_banded(factors, summed(y - n) - difference(z - u))
        ahead = u + z + _RELAXATION * (np.diff(p, axis=0) - z)
        inside = n + y + _RELAXATION * (p[at] - y)
        longest = per_weight * weight / np.maximum(np.linalg.norm(ahead, axis=1), _TINY)
        u = ahead * np.minimum(longest, 1.0)[:, None]
        z = ahead - u
        parts = zip(held, np.split(inside, splits), strict=True)
        y = np.concatenate([region.nearest(part, k) for (region, _, k), part in parts])
        n = inside - y
        if iteration % _CHECKED == 0:
            normals = n.copy()
            normals[narrowest] += difference(u) - summed(n)
            most = sum(map(_most, held, np.split(normals, splits)))
            before, best = best, max(best, -float(most) / per_weight)
            if 0 < best <= (1 + _SMALL_GAIN) * before:
                break
    return float(best), int((weight * np.linalg.norm(z, axis=1)).argmax())


def _most(held: _Held, normal: FloatArray) -> float:
    """Return the sum of the largest products of regions' points with normals (R, 3)."""
    regions, _, k = held
    size = np.linalg.norm(normal, axis=1)
    ends = [np.einsum("ri,ri->r", normal, end[k]) for end in (regions.begin, regions.end)]
    extent = size * regions.extent(normal / np.maximum(size, _TINY)[:, None], k)
    return float((np.maximum(*ends) + extent).sum())
