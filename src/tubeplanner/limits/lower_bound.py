"""A proved lower bound on the duration of all motions of a problem.

No motion that keeps the conditions is shorter. The bound is the largest of several, each of which
takes a part of the conditions alone: one joint from start to goal, or the tool through the tube. A
certificate's tolerance of 1e-6 is not part of it.
"""

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.geometry.tube.points import MIN_LENGTH, passing_radius
from tubeplanner.geometry.tube.regions import Capsules, SegmentRegions
from tubeplanner.limits.rates import ToolSpeed
from tubeplanner.task.problem import PlanningProblem


def least_duration(problem: PlanningProblem) -> float:
    """Return a lower bound on the duration of all motions of a problem [s]; 0: nothing is known."""
    return max(slowest_joint(problem), tool_travel(problem))


# ---- One joint alone: every motion moves it from rest to rest under its limits.


def slowest_joint(problem: PlanningProblem) -> float:
    """Return the least time of the slowest joint from start to goal [s]; 0 if an end is open."""
    start, goal = (end.joints for end in problem.endpoints)
    if start is None or goal is None:
        return 0.0
    limits = problem.robot.limits
    columns = abs(goal - start), limits.velocity, limits.acceleration, limits.jerk
    return max(rest_to_rest(*row) for row in np.column_stack(columns).tolist())


def rest_to_rest(distance: float, velocity: float, acceleration: float, jerk: float) -> float:
    """Return the least time of a joint from rest to rest over a distance [s].

    With the peak velocity v it takes d/v + T, where T is the time of either change of velocity: v/A
    + A/J, or 2 sqrt(v/J) if v is below A^2/J. That falls with v as long as there is time between
    both changes, v T <= d. (Double S: Biagiotti & Melchiorri, "Trajectory Planning for Automatic
    Machines and Robots", 2008, section 3.4.)

    Args:
        distance: [rad or m].
        velocity: Limit [rad/s or m/s]; inf: none, as of the others.
        acceleration: Limit [rad/s^2 or m/s^2].
        jerk: Limit [rad/s^3 or m/s^3].
    """
    if distance == 0 or (np.isinf(acceleration) and np.isinf(jerk)):
        return distance / velocity
    rise = acceleration / jerk  # [s]
    peak = min(velocity, float(np.cbrt(distance**2 * jerk / 4)))
    if peak <= rise * acceleration:
        return distance / peak + 2 * float(np.sqrt(peak / jerk))
    root = float(np.hypot(rise / 2, np.sqrt(distance / acceleration)))
    peak = min(velocity, distance / (rise / 2 + root))
    return distance / peak + peak / acceleration + rise


# ---- The tool alone: it goes through the tube no faster than its speed limits.
#
# In a tube visited in order, the tool passes points p_0 (start), p_1, ... p_m (goal). Segment k
# begins at p_k, which lies in the regions of segments k-1 and k. From p_k to p_k+1 the tool takes
# at least w_k |p_k+1 - p_k|, where 1/w_k is the speed limit of segment k. The least sum over k is a
# convex problem. With any u_k no longer than w_k, and any n_kj whose sum over the regions R_j of
# point k is u_k - u_k-1,
#
#   sum w_k |p_k+1 - p_k| >= sum u_k (p_k+1 - p_k) = - sum n_kj p_k >= - sum max {n_kj p: p in R_j}.
#
# However far u and n are from the best, the last sum is a bound. They are sought by the alternating
# direction method of multipliers (Boyd et al. 2011, section 3.1).
#
# The ball about a point that must be passed replaces the regions of p_k. The point is passed in
# segment k-1 or k: on both sides the faster of both limits counts. Of two such points in a row,
# which may be passed in any order, the first counts.

# In 350 tubes of 1 to 190 segments, with one or with random limits, the bound is then within 1 % of
# the best in all but nine: within 14 %.
_ITERATIONS = 400
_CHECKED = 50  # iterations from one bound to the next
_RELAXATION = 1.7  # from 1.5 to 1.8 as a rule (Boyd et al. 2011, section 3.4.3)
_TINY = np.finfo(float).tiny

# Some regions, the point that lies in each, and the region's index: (R,) each.
_Held = tuple[SegmentRegions, IntArray, IntArray]


def tool_travel(problem: PlanningProblem) -> float:
    """Return the least time of the tool through the tube at its speed limits [s]; 0 without any."""
    problem = problem.joined
    tube, count = problem.tube, problem.tube.segment_count
    weight = 1 / ToolSpeed(problem).limit  # [s/m]
    centres, radii = map(list, zip(*[_end_ball(problem, index) for index in (0, -1)], strict=True))
    if tube.visit == "any":
        return _least_time(weight.min(keepdims=True), [_balls(centres, radii, [0, 1])])
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


def _end_ball(problem: PlanningProblem, index: int) -> tuple[FloatArray, float]:
    """Return the ball of the tool at start (0) or goal (-1): centre (3,) [m] and radius [m]."""
    end, radius = problem.endpoints[index], float(problem.end_radii[index])
    if end.joints is not None:
        return problem.robot.tool_position(end.joints), 0.0
    centre = problem.tube.points[index] if end.position is None else end.position
    return centre, radius if end.region is None else max(radius, end.region.tolerance)


def _balls(centres: list[FloatArray], radii: list[float], points: list[int]) -> _Held:
    balls = Capsules(np.array(centres), np.array(centres), np.array(radii))
    return balls, np.array(points), np.arange(len(points))


def _least_time(weight: FloatArray, held: list[_Held]) -> float:
    """Return a lower bound on sum w_k |p_k+1 - p_k| of m+1 points in regions, for weights (m,).

    With D for the differences of points and S for the point of every region, the method's terms are
    |D p - z + u|^2 + |S p - y + n|^2. The multipliers u and n are lengths.
    """
    if not weight.any():  # no limit
        return 0.0
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
            best = max(best, -most / per_weight)
    return best


def _most(held: _Held, normal: FloatArray) -> float:
    """Return the sum of the largest products of regions' points with normals (R, 3)."""
    regions, _, k = held
    size = np.linalg.norm(normal, axis=1)
    ends = [np.einsum("ri,ri->r", normal, end[k]) for end in (regions.begin, regions.end)]
    extent = size * regions.extent(normal / np.maximum(size, _TINY)[:, None], k)
    return float((np.maximum(*ends) + extent).sum())
