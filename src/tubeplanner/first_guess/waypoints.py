"""Candidate waypoints of phase 1; quartics through waypoints at equal times."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.first_guess.branches import ReferenceBranch
from tubeplanner.first_guess.inverse_kinematics import solve_position
from tubeplanner.first_guess.segment_walk import wanted_at
from tubeplanner.geometry.tube.points import arc_lengths
from tubeplanner.task.problem import PlanningProblem
from tubeplanner.trajectory.joint_trajectory import JointTrajectory

_STILL = 1e-9  # [m]: a tool that moves less stands still
# Inverse kinematics that goes farther from the branch than this has left it [rad or m].
_MAX_BRANCH_DISTANCE = 0.1


def candidate_waypoints(
    problem: PlanningProblem,
    branch: ReferenceBranch,
    count: int,
    checkpoint: Callable[[], None] = lambda: None,
) -> FloatArray:
    """Return M configurations with tools equally spaced along the branch.

    The checkpoint is called before each of the M >= 2.

    Returns:
        Shape (M, n) [rad or m]; the first is the start, the last the goal. Where the tool stands
        still throughout, they are equally spaced in joint space.
    """
    q = np.concatenate(branch.segments)
    segment = np.repeat(np.arange(len(branch.segments)), [len(part) for part in branch.segments])
    tool = problem.robot.tool_position(q)
    arc_length = arc_lengths(tool)
    if arc_length[-1] < _STILL:
        arc_length = arc_lengths(q)
    targets = arc_length[-1] * np.arange(1, count - 1) / (count - 1)
    before = np.searchsorted(arc_length, targets, side="right") - 1
    fraction = (targets - arc_length[before]) / (arc_length[before + 1] - arc_length[before])
    fraction = fraction[:, None]
    points = (1 - fraction) * tool[before] + fraction * tool[before + 1]
    inner = (1 - fraction) * q[before] + fraction * q[before + 1]
    for i, k in enumerate(segment[before].tolist()):
        checkpoint()
        near, bounds = inner[i], (problem.joint_lower[k], problem.joint_upper[k])
        rotation = wanted_at(problem, points[i], k, near)
        solution = solve_position(problem.robot, points[i], near, *bounds, rotation=rotation)
        if abs(solution.q - near).max() <= _MAX_BRANCH_DISTANCE:
            inner[i] = solution.q
    return np.vstack([branch.start, inner, branch.goal])


# ---- Smooth trajectories through waypoints at equal times, at rest at both ends.
#
# Two primitives. Sequential quartics are built one segment at a time, so that a search can judge
# each segment as soon as two further waypoints are known (Suh & Bishop 1988, section on trajectory
# construction; waypoints are the paper's knots). The 4-3-...-3-4 spline is the classical
# alternative, one linear system for all segments (Craig, "Introduction to Robotics", chapter on
# trajectories).
#
# Every segment lasts one second: time scaling gives the trajectory its real duration. Coefficients
# are laid out as in `scipy.interpolate.PPoly`, highest power first.

_QUARTIC_POWERS = np.arange(4, -1, -1)
# The quintic that moves by one in one second, at rest with zero acceleration at both ends.
_QUINTIC = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])


def power_basis(t: FloatArray, order: int) -> FloatArray:
    """Return the powers of time, differentiated, that multiply a quartic's coefficients, (N, 5).

    The derivative of order 0 is the value; times are local, (N,) [s].
    """
    factor = np.prod([_QUARTIC_POWERS - i for i in range(order)], axis=0)
    return factor * t[:, None] ** np.maximum(_QUARTIC_POWERS - order, 0)


def look_ahead_quartic(
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    following: FloatArray,
    after: FloatArray,
) -> FloatArray:
    """Return the quartic that continues a trajectory, passes a waypoint and aims at the next.

    It starts with the given state, passes `following` after one second and would pass `after` after
    two; only its first second is used (Suh & Bishop 1988: the look-ahead condition). All arguments
    have shape (..., n), the waypoint aimed at is `after`.

    Returns:
        Shape (5, 1, ..., n).
    """
    data = np.stack([position, velocity, acceleration, following, after])
    return np.tensordot(_LOOK_AHEAD, data, axes=1)[:, None]


def last_two_quartics(
    position: FloatArray,
    velocity: FloatArray,
    acceleration: FloatArray,
    following: FloatArray,
    goal: FloatArray,
) -> FloatArray:
    """Return two quartics that continue a trajectory, pass a waypoint and rest at the goal.

    Ten conditions: the given state, `following` passed with continuous velocity and acceleration,
    and the goal at rest with zero acceleration. All arguments have shape (..., n), the waypoint
    passed is `following`.

    Returns:
        Shape (5, 2, ..., n).
    """
    data = np.stack([position, velocity, acceleration, following, goal])
    return np.tensordot(_LAST_TWO, data, axes=1)


def sequential_quartics(joint_names: Sequence[str], waypoints: FloatArray) -> JointTrajectory:
    """Return the trajectory through K >= 2 waypoints, built segment by segment.

    Waypoints have shape (K, n) [rad or m].

    Returns:
        K-1 quartics of one second each; for K = 2 one quintic.
    """
    if len(waypoints) == 2:
        return _quintic(joint_names, waypoints)
    position, velocity, acceleration = waypoints[0], *np.zeros((2, waypoints.shape[1]))
    segments = []
    for following, after in pairwise(waypoints[1:-1]):
        quartic = look_ahead_quartic(position, velocity, acceleration, following, after)
        segments.append(quartic)
        position, velocity, acceleration = following, *_END_DERIVATIVES @ quartic[:, 0]
    segments.append(last_two_quartics(position, velocity, acceleration, *waypoints[-2:]))
    coefficients = np.concatenate(segments, axis=1)
    return JointTrajectory(joint_names, np.arange(len(waypoints)), coefficients)


def quartic_spline(joint_names: Sequence[str], waypoints: FloatArray) -> JointTrajectory:
    """Return the 4-3-...-3-4 spline through K >= 2 waypoints.

    Cubics with continuous velocity and acceleration; the first and the last segment are quartics,
    so that the trajectory also starts and ends with zero acceleration. Waypoints have shape (K, n)
    [rad or m].

    Returns:
        K-1 polynomials of one second each; for K = 2 one quintic.
    """
    if len(waypoints) == 2:
        return _quintic(joint_names, waypoints)
    step = np.diff(waypoints, axis=0)
    velocity = np.zeros_like(waypoints)
    # Velocities at inner waypoints make the acceleration continuous.
    count = len(step) - 1
    matrix = 4 * np.eye(count) + np.eye(count, k=1) + np.eye(count, k=-1)
    weighted = 3 * step
    for end in (0, -1):  # the quartics at the ends
        matrix[end, end] += 1
        weighted[end] *= 2
    velocity[1:-1] = np.linalg.solve(matrix, weighted[:-1] + weighted[1:])
    before, after = velocity[:-1], velocity[1:]
    cubics = np.array(
        [np.zeros_like(step), before + after - 2 * step, 3 * step - 2 * before - after]
    )
    # t^2 (1 - t)^2 changes neither values nor velocities at the ends, but the acceleration.
    bubble = np.array([1.0, -2.0, 1.0])[:, None]
    cubics[:, 0] += bubble * (after[0] - 3 * step[0])
    cubics[:, -1] += bubble * (3 * step[-1] - before[-1])
    coefficients = np.concatenate([cubics, before[None], waypoints[None, :-1]])
    return JointTrajectory(joint_names, np.arange(len(waypoints)), coefficients)


def _quintic(joint_names: Sequence[str], waypoints: FloatArray) -> JointTrajectory:
    coefficients = _QUINTIC[:, None] * (waypoints[1] - waypoints[0])
    coefficients[-1] = waypoints[0]
    return JointTrajectory(joint_names, [0.0, 1.0], coefficients[:, None])


def _at(time: float, order: int) -> FloatArray:
    return power_basis(np.array([time]), order)[0]


def _last_two() -> FloatArray:
    """Return the matrix from (position, velocity, acceleration, following, goal), (5, 2, 5)."""
    zero = np.zeros(5)
    conditions = [np.concatenate([_at(0, order), zero]) for order in range(3)]
    conditions.append(np.concatenate([_at(1, 0), zero]))
    conditions.append(np.concatenate([zero, _at(0, 0)]))
    conditions += [np.concatenate([_at(1, order), -_at(0, order)]) for order in (1, 2)]
    conditions += [np.concatenate([zero, _at(1, order)]) for order in range(3)]
    values = np.zeros((10, 5))
    values[[0, 1, 2, 3, 4, 7], [0, 1, 2, 3, 3, 4]] = 1.0
    return np.linalg.solve(np.array(conditions), values).reshape(2, 5, 5).transpose(1, 0, 2)


# From (position, velocity, acceleration, following, after) to a quartic's coefficients.
_LOOK_AHEAD = np.linalg.inv(np.array([_at(0, 0), _at(0, 1), _at(0, 2), _at(1, 0), _at(2, 0)]))
_LAST_TWO = _last_two()
# Velocity and acceleration at the end of a quartic of one second.
_END_DERIVATIVES = np.array([_at(1, 1), _at(1, 2)])
