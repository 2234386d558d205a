"""The first answer: the reference branch with a stop at each corner.

Every segment is a rest-to-rest trajectory along the branch, as a quintic B-spline whose first and
last three control points coincide, so that velocity and acceleration vanish exactly at its ends.
Later planners start from it and must beat it.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.branches import ReferenceBranch
from tubeplanner.geometry.tube.points import arc_lengths, densified
from tubeplanner.limits.speed_limits import estimated_durations, scaled_to_limits
from tubeplanner.outcome import MARGIN_TOLERANCE, Infeasible, Location, PlanStatus
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory, concatenate, from_splines
from tubeplanner.trajectory.polynomials import (
    REST_POINTS,
    BSpline,
    fitted_control_points,
    times_between,
)

_DEGREE = 5
# Configurations nearer to their neighbour than this fraction of the largest step have no direction.
_MIN_STEP_FRACTION = 1e-4
_STEP = 0.05  # [rad or m] of the joint that moves most, along a line of a route
_MIN_INTERVALS = 16
_MAX_INTERVALS = 128
_FIT_POINTS_PER_INTERVAL = 8
# The fit may use this fraction of radius and rotation bound; the rest is left for later refinement.
_FIT_FRACTION = 0.1
_ON_THE_WALL = MARGIN_TOLERANCE / 2
# Fractions of the time for speeding up, and the same for slowing down: the fastest counts.
_RAMP_FRACTIONS = (0.5, 0.4, 0.3, 0.2, 0.15, 0.1)


def stop_at_corners(
    problem: PlanningProblem, branch: ReferenceBranch, checkpoint: Callable[[], None] = lambda: None
) -> JointTrajectory:
    """Return the fastest of a family of trajectories with a stop at every reference point.

    The checkpoint is called before every segment.

    Raises:
        Infeasible: Gravity exceeds a motor's effort, or no spline follows the branch in the tube.
    """
    paths = [(branch.segments[k], k) for k in branch.moving_segments]
    return _in_turn(problem, paths, checkpoint)


def stop_along(
    problem: PlanningProblem, route: FloatArray, checkpoint: Callable[[], None] = lambda: None
) -> JointTrajectory:
    """Return a trajectory along joint lines that stops at every corner (P, n) of a route.

    The tube has one segment. The checkpoint is called before every line.

    Raises:
        Infeasible: Gravity exceeds a motor's effort.
    """
    lines = [np.array(ends) for ends in pairwise(route) if not np.array_equal(*ends)]
    return _in_turn(problem, [(densified(line, _STEP), 0) for line in lines], checkpoint)


def _in_turn(
    problem: PlanningProblem, paths: list[tuple[FloatArray, int]], checkpoint: Callable[[], None]
) -> JointTrajectory:
    """Return the fastest of a family of trajectories along each path (P, n) in its segment."""
    if not paths:
        message = "the start is the goal: there is nothing to move"
        raise Infeasible(PlanStatus.NO_TRAJECTORY, message, Location())
    trajectories = []
    for q, segment in paths:
        checkpoint()
        shapes = _ramped_fits(problem, q, segment)
        fastest = shapes[int(estimated_durations(problem, shapes).argmin())]
        trajectories.append(scaled_to_limits(problem, fastest))
    return concatenate(trajectories)


def _ramped_fits(problem: PlanningProblem, q: FloatArray, segment: int) -> list[JointTrajectory]:
    """Return fits of a segment's configurations (P, n) in a second, for all ramps.

    Each has as few knots as follow the configurations closely. All ramps are fitted at once: one by
    one, most of the time would go into calls.
    """
    available = _least_margins(problem, q, segment)
    close = available - _FIT_FRACTION * _bounds(problem, segment)
    # Where the branch itself touches the wall, or leaves it by a rounding error, so may the fit.
    inside = np.minimum(available, 0.0) - _ON_THE_WALL
    shapes: dict[float, JointTrajectory] = {}
    margins: dict[float, FloatArray] = {}
    ramps, intervals = list(_RAMP_FRACTIONS), _MIN_INTERVALS
    while ramps and intervals <= _MAX_INTERVALS:
        for ramp, shape in zip(ramps, _fits(problem, q, segment, ramps, intervals), strict=True):
            samples = shape.per_piece(_FIT_POINTS_PER_INTERVAL).position
            shapes[ramp], margins[ramp] = shape, _least_margins(problem, samples, segment)
        ramps = [ramp for ramp in ramps if (margins[ramp] <= np.maximum(close, inside)).any()]
        intervals *= 2
    for ramp in ramps:  # not close to the branch, which has a sharp bend; it may be in the tube
        margin = margins[ramp]
        if (margin > inside).all():
            continue
        worst = int((inside - margin).argmax())
        unit, remedy = (("m", "the radius"), ("rad", "the rotation tolerance"))[worst]
        number = problem.tube.segment_number(segment)
        raise Infeasible(
            PlanStatus.NO_TRAJECTORY,
            f"segment {number}: a spline of {_MAX_INTERVALS} pieces that follows the inverse "
            f"kinematics leaves the tube by {-margin[worst]:.3g} {unit}; widen {remedy}",
            Location(segment=number),
        )
    return [shapes[ramp] for ramp in _RAMP_FRACTIONS]


def _least_margins(problem: PlanningProblem, q: FloatArray, segment: int) -> FloatArray:
    """Return the least margins of the tool [m] and, if bounded, of its rotation [rad]."""
    rotation, tool = problem.robot.tool_pose(q)
    only = slice(segment, segment + 1)
    margins = [problem.tube.margin(tool, only).min()]
    if len(_bounds(problem, segment)) > 1:
        margins.append(problem.tube.rotation_margin(rotation, tool, only).min())
    return np.array(margins)


def _bounds(problem: PlanningProblem, segment: int) -> FloatArray:
    """Return the radius [m] and the tightest bound on the rotation [rad], if any."""
    tube = problem.tube
    tightest = np.inf if tube.rotation is None else tube.rotation.bounds[segment].min()
    bounds = np.array([tube.effective_radius[segment], tightest])
    return bounds[np.isfinite(bounds)]


def _fits(
    problem: PlanningProblem, q: FloatArray, segment: int, ramps: list[float], intervals: int
) -> list[JointTrajectory]:
    """Return the least-squares splines of a second along configurations (P, n) for all ramps.

    Control points are moved into the segment's joint bounds, which then hold for all t: a spline
    lies in the hull of its control points.
    """
    from scipy.interpolate import CubicSpline

    breakpoints = (1 - np.cos(np.pi * np.arange(intervals + 1) / intervals)) / 2
    knots = np.concatenate([np.zeros(_DEGREE), breakpoints, np.ones(_DEGREE)])
    times = times_between(breakpoints, _FIT_POINTS_PER_INTERVAL)
    # Over the joint-space length. The tool's would not do: where the arm is stretched, joints move
    # while the tool hardly does.
    lengths = np.linalg.norm(np.diff(q, axis=0), axis=1)
    apart = lengths > _MIN_STEP_FRACTION * lengths.max()
    rows = np.concatenate([[True], apart[:-1], [True]])
    rows[-2] &= apart[-1] or len(q) == 2
    arc_length = arc_lengths(q[rows])
    along = CubicSpline(arc_length / arc_length[-1], q[rows])
    samples = np.hstack([along(_ramped(times, ramp)) for ramp in ramps])
    start, goal = (np.tile(end, len(ramps)) for end in (q[0], q[-1]))
    points = fitted_control_points(knots, _DEGREE, times, samples, (start, goal))
    lower, upper = problem.joint_lower[segment], problem.joint_upper[segment]
    inner = slice(REST_POINTS, -REST_POINTS)
    of_ramps = points.reshape(len(points), len(ramps), -1)
    of_ramps[inner] = np.clip(of_ramps[inner], lower, upper)
    return from_splines(problem.robot.joint_names, BSpline(knots, of_ramps, _DEGREE))


def _ramped(u: FloatArray, ramp: float) -> FloatArray:
    """Return the arc length at times u in [0, 1]: speed up, cruise, slow down.

    While speeding up for a fraction `ramp` of the time, speed follows the smoothstep 3x^2 - 2x^3,
    so acceleration starts and ends at zero.
    """
    top_speed = 1 / (1 - ramp)
    x = np.clip(np.minimum(u, 1 - u) / ramp, 0.0, 1.0)
    ramped = top_speed * ramp * (x**3 - x**4 / 2)  # arc length within one ramp
    cruised = top_speed * np.maximum(np.minimum(u, 1 - u) - ramp, 0.0)
    return np.where(u <= 0.5, ramped + cruised, 1 - ramped - cruised)
