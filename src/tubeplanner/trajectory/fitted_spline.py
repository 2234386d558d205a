"""B-splines fitted to configurations, at rest at both ends."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.trajectory.b_spline import basis_functions, knot_intervals

REST_POINTS = 3  # equal control points at an end put velocity and acceleration there to zero


def fitted_control_points(
    knots: FloatArray,
    degree: int,
    times: FloatArray,
    path: FloatArray,
    ends: tuple[FloatArray, FloatArray],
    draw: float = 0.0,
) -> FloatArray:
    """Return the control points of the least-squares spline that rests at its ends, (K, n).

    Args:
        knots: Clamped, shape (K+degree+1,) [s].
        degree: Of the spline, at least 3.
        times: Shape (N,) [s].
        path: Configurations at these times, shape (N, n).
        ends: Start and goal, each (n,): the first and the last three control points.
        draw: Weight by which control points are drawn to the joint line from start to goal, for
            those that the times leave open; 0 if there are none.
    """
    count = len(knots) - degree - 1
    span = knot_intervals(knots, degree, times)
    near = span[:, None] + np.arange(-degree, 1)
    weights = basis_functions(knots, degree, span, times)[0]
    inner = slice(REST_POINTS, count - REST_POINTS)
    line = ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0])
    points = np.zeros_like(line)
    points[:REST_POINTS], points[-REST_POINTS:] = ends
    # Normal equations, gathered from the few weights that count at each time: well conditioned.
    squared, wanted = draw * np.eye(count), draw * line
    np.add.at(squared, (near[:, :, None], near[:, None]), weights[:, :, None] * weights[:, None])
    rest = path - np.einsum("nk,nkj->nj", weights, points[near])
    np.add.at(wanted, near, weights[:, :, None] * rest[:, None])
    points[inner] = np.linalg.solve(squared[inner, inner], wanted[inner])
    return points


def times_between(breakpoints: FloatArray, count: int) -> FloatArray:
    """Return `count` times in each of P intervals between breakpoints (P+1,), none on its ends."""
    local = (np.arange(count) + 0.5) / count
    times: FloatArray = breakpoints[:-1, None] + local * np.diff(breakpoints)[:, None]
    return times.ravel()
