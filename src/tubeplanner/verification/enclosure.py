"""Polynomials that enclose tool pose and joint efforts of a trajectory, for all t.

On each of I intervals the quantity is interpolated at Chebyshev points. What the polynomial misses
between them is bounded by the majorant of the next Taylor coefficient, T:

    |f(u) - P(u)| <= T max |product of (u - u_i)| = T 2 / 4^N

for N points on an interval of width one (Davis, "Interpolation and Approximation", 1963, theorem
3.1.1). Intervals are halved until that is negligible. Rounding errors, some 1e-12, are not bounded.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from scipy.special import comb

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.bernstein import bernstein_coefficients, halves
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.majorants import effort_majorant, tool_majorant

_POINTS = 8
_NODES = (chebyshev.chebpts1(_POINTS) + 1) / 2
_NODE_PRODUCT = 2.0 / 4.0**_POINTS
# From values at the nodes to coefficients, highest power first.
_FIT = np.linalg.inv(np.vander(_NODES))
# A trajectory that is not enclosed after so many intervals is left as it is: its errors are large.
_MAX_INTERVALS = 200_000
_MIN_WIDTH = 1e-9  # [s]


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A quantity of c components over I intervals, as polynomials of local time u from 0 to 1.

    Attributes:
        start: Start of each interval, shape (I,) [s].
        width: Width of each interval, shape (I,) [s].
        coefficients: Shape (N, I, c), highest power first.
        error: How far the quantity may be from the polynomials, shape (I, c).
    """

    start: FloatArray
    width: FloatArray
    coefficients: FloatArray
    error: FloatArray

    def at(self, time: FloatArray) -> FloatArray:
        """Return the polynomials' values at times (N,) [s], shape (N, c)."""
        interval = np.clip(np.searchsorted(self.start, time, "right") - 1, 0, None)
        return self.within(interval, (time - self.start[interval]) / self.width[interval])

    def within(self, interval: IntArray, u: FloatArray) -> FloatArray:
        """Return the values in intervals (N,) at their local times u (N,), shape (N, c)."""
        value = np.zeros((len(u), self.coefficients.shape[2]))
        for row in self.coefficients:
            value = value * u[:, None] + row[interval]
        return value


def enclosed_tool(robot: RobotModel, trajectory: JointTrajectory, tolerance: float) -> Enclosure:
    """Return the tool centre point's position, c = 3 [m].

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        tolerance: How large the error may be [m]: its norm, the same for all components.
    """

    def error(joints: FloatArray, width: FloatArray) -> FloatArray:
        return np.tile(tool_majorant(robot, joints).position[_POINTS][:, None], (1, 3))

    def value(q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        return robot.tool_position(q)

    return _enclosed(trajectory, value, error, np.full(3, tolerance))


@dataclass(frozen=True, eq=False)
class EnclosedPose:
    """Where the tool is and how it is turned, over the same I intervals.

    Attributes:
        tool: Position of the tool centre point, c = 3 [m].
        rotation: Its rotation matrix, row by row, c = 9; every column is off by at most the error.
        speed: No part of an interval is faster, shape (I,) [m/s].
        acceleration: Bound on the norm, shape (I,) [m/s^2].
        spin: Bound on the angular velocity, shape (I,) [rad/s].
        spin_rate: Bound on the angular acceleration, shape (I,) [rad/s^2].
    """

    tool: Enclosure
    rotation: Enclosure
    speed: FloatArray
    acceleration: FloatArray
    spin: FloatArray
    spin_rate: FloatArray


def enclosed_pose(
    robot: RobotModel, trajectory: JointTrajectory, tolerance: float, rotation_tolerance: float
) -> EnclosedPose:
    """Return position and orientation of the tool centre point.

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        tolerance: How large the position's error may be [m].
        rotation_tolerance: How large the error of a column of the rotation matrix may be.
    """

    def error(joints: FloatArray, width: FloatArray) -> FloatArray:
        majorant = tool_majorant(robot, joints)
        rows = [majorant.position[_POINTS]] * 3 + [majorant.axis[_POINTS]] * 9
        return np.stack(rows, axis=1)

    def value(q: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        rotation, position = robot.tool_pose(q)
        return np.hstack([position, rotation.reshape(-1, 9)])

    pose = _enclosed(trajectory, value, error, np.repeat([tolerance, rotation_tolerance], [3, 9]))
    tool, rotation = (
        Enclosure(pose.start, pose.width, pose.coefficients[:, :, part], pose.error[:, part])
        for part in (slice(3), slice(3, 12))
    )
    piece = np.searchsorted(trajectory.breakpoints, pose.start, "right") - 1
    local = pose.start - trajectory.breakpoints[piece]
    rates = tool_majorant(robot, _joint_bounds(trajectory, piece, local, pose.width)[:3])
    return EnclosedPose(
        tool,
        rotation,
        speed=rates.position[1] / pose.width,
        acceleration=2 * rates.position[2] / pose.width**2,
        spin=rates.spin[0] / pose.width,
        spin_rate=rates.spin[1] / pose.width**2,
    )


def enclosed_efforts(
    robot: RobotModel, trajectory: JointTrajectory, tolerance: FloatArray
) -> Enclosure:
    """Return the joint efforts, c = n [N m or N].

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        tolerance: How large the errors may be, shape (n,) [N m or N].
    """

    def error(joints: FloatArray, width: FloatArray) -> FloatArray:
        return effort_majorant(robot, joints, width)[_POINTS]

    return _enclosed(trajectory, robot.inverse_dynamics, error, tolerance)


def _enclosed(
    trajectory: JointTrajectory,
    value: Callable[[FloatArray, FloatArray, FloatArray], FloatArray],
    error: Callable[[FloatArray, FloatArray], FloatArray],
    tolerance: FloatArray,
) -> Enclosure:
    """Halve intervals until the interpolation's error is below the tolerance everywhere."""
    pieces = len(trajectory.widths)
    piece: IntArray = np.arange(pieces)
    start, width = np.zeros(pieces), trajectory.widths
    done: list[tuple[IntArray, FloatArray, FloatArray, FloatArray]] = []
    count = 0
    while len(piece):
        missed = _NODE_PRODUCT * error(_joint_bounds(trajectory, piece, start, width), width)
        count += len(piece)
        coarse = np.any(missed > tolerance, axis=1) & (width > _MIN_WIDTH)
        coarse &= count < _MAX_INTERVALS
        fine = ~coarse
        done.append((piece[fine], start[fine], width[fine], missed[fine]))
        piece = np.repeat(piece[coarse], 2)
        start, width = halves(start[coarse], width[coarse])
    piece = np.concatenate([part[0] for part in done])
    start, width, missed = (np.concatenate([part[i] for part in done]) for i in (1, 2, 3))
    order = np.lexsort((start, piece))
    piece, start, width, missed = piece[order], start[order], width[order], missed[order]
    states = _states(trajectory, piece, start, width)
    values = value(*(state.reshape(-1, state.shape[2]) for state in states))
    values = values.reshape(len(piece), _POINTS, -1)
    coefficients = np.einsum("kp,ipc->kic", _FIT, values)
    return Enclosure(trajectory.breakpoints[piece] + start, width, coefficients, missed)


def _joint_bounds(
    trajectory: JointTrajectory, piece: IntArray, start: FloatArray, width: FloatArray
) -> FloatArray:
    """Return bounds on the Taylor coefficients of the joint positions, in widths of the intervals.

    Shape (N+3, I, n): as many as efforts need. The k-th derivative of a polynomial has as Bernstein
    coefficients the k-th differences of the polynomial's own, times degree! / (degree - k)!.
    """
    hull = bernstein_coefficients(trajectory.coefficients[:, piece], start, width)
    degree = len(hull) - 1
    bounds = np.zeros((_POINTS + 3, *hull.shape[1:]))
    for k in range(min(degree + 1, len(bounds))):
        bounds[k] = comb(degree, k) * abs(np.diff(hull, n=k, axis=0)).max(axis=0)
    return bounds


def _states(
    trajectory: JointTrajectory, piece: IntArray, start: FloatArray, width: FloatArray
) -> list[FloatArray]:
    """Return positions, velocities and accelerations at the nodes, each (I, N, n).

    Evaluated piece by piece, so that no rounding of times crosses a breakpoint.
    """
    local = start[:, None] + width[:, None] * _NODES
    states = []
    for order in range(3):
        value = np.zeros((*local.shape, trajectory.coefficients.shape[2]))
        for row in trajectory.derivative_coefficients(order):
            value = value * local[:, :, None] + row[piece][:, None]
        states.append(value)
    return states
