"""B-splines fitted to configurations, at rest at both ends."""

import numpy as np
from scipy.interpolate import BSpline
from scipy.linalg import solveh_banded

from tubeplanner.arrays import FloatArray

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
    design = BSpline.design_matrix(times, knots, degree)
    inner = slice(REST_POINTS, count - REST_POINTS)
    line = ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0])
    points = np.zeros_like(line)
    points[:REST_POINTS], points[-REST_POINTS:] = ends
    # Normal equations, as a band: well conditioned, and nothing for threads to wait for.
    squared = (design.T @ design).tocsr()[inner, inner]
    bands = np.zeros((degree + 1, count - 2 * REST_POINTS))
    for k in range(min(degree + 1, bands.shape[1])):
        bands[k, : bands.shape[1] - k] = squared.diagonal(-k)
    bands[0] += draw
    wanted = (design.T @ (path - design @ points))[inner] + draw * line[inner]
    points[inner] = solveh_banded(bands, wanted, lower=True)
    return points


def times_between(breakpoints: FloatArray, count: int) -> FloatArray:
    """Return `count` times in each of P intervals between breakpoints (P+1,), none on its ends."""
    local = (np.arange(count) + 0.5) / count
    times: FloatArray = breakpoints[:-1, None] + local * np.diff(breakpoints)[:, None]
    return times.ravel()
