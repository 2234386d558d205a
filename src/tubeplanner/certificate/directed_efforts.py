"""Efforts over intervals without reversal, Coulomb friction included, as polynomials."""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.certificate.enclosure import Enclosure
from tubeplanner.robot.model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import MonotoneIntervals, SignChanges, sign_changes
from tubeplanner.trajectory.polynomials import restricted


@dataclass(frozen=True, eq=False)
class DirectedEfforts:
    """R intervals, each of a joint that moves without reversal and passes no corner of a table.

    Polynomials of a time that runs from 0 to 1 over each interval, highest power first, (N, R). At
    a reversal one interval ends and the next begins, so that both one-sided limits are covered.

    Attributes:
        joint: Index of the joint, shape (R,).
        start: Shape (R,) [s].
        width: Shape (R,) [s].
        position: Of the joint [rad or m].
        velocity: Of the joint [rad/s or m/s].
        effort: With nominal friction [N m or N].
        unsure: Uncertainty of the effort by that of friction, never negative [N m or N].
        error: Bound on the distance of the effort from its polynomial, shape (R,) [N m or N].
    """

    joint: IntArray
    start: FloatArray
    width: FloatArray
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    unsure: FloatArray
    error: FloatArray

    def most(self, sign: float) -> FloatArray:
        """Return upper bounds on the effort forwards (1) or backwards (-1), polynomials (N, R)."""
        most = sign * self.effort + self.unsure
        most[-1] += self.error
        return most


@dataclass(frozen=True, eq=False)
class _Parts:
    """R parts of an enclosure's intervals, shape (R,) each.

    Attributes:
        joint: Index of the joint.
        interval: Index of the enclosure's interval.
        piece: Index of the trajectory's piece.
        start: Start of the part in the interval, from 0 to 1.
        end: End of the part in the interval, from 0 to 1.
    """

    joint: IntArray
    interval: IntArray
    piece: IntArray
    start: FloatArray
    end: FloatArray


def directed_efforts(
    robot: RobotModel,
    trajectory: JointTrajectory,
    smooth: Enclosure,
    intervals: MonotoneIntervals,
    joints: IntArray,
) -> DirectedEfforts:
    """Return the efforts of some joints.

    Args:
        robot: The arm.
        trajectory: In the robot's joint order.
        smooth: Its efforts without Coulomb friction.
        intervals: Of the trajectory.
        joints: Indices of the joints, shape (k,).
    """
    instants = _instants(robot, trajectory, intervals, joints)
    parts = _parts(trajectory, smooth, instants, joints)
    joint, interval, piece = parts.joint, parts.interval, parts.piece
    start = smooth.start[interval] + smooth.width[interval] * parts.start
    width = smooth.width[interval] * (parts.end - parts.start)
    local = start - trajectory.breakpoints[piece]
    polynomials = (
        _on(trajectory.coefficients[:, piece, joint], local, width),
        _on(trajectory.derivative_coefficients(1)[:, piece, joint], local, width),
        _on(smooth.coefficients[:, interval, joint], parts.start, parts.end - parts.start),
    )
    most = max(map(len, polynomials))  # rows of the highest degree
    position, velocity, effort = (
        np.pad(rows, ((most - len(rows), 0), (0, 0))) for rows in polynomials
    )
    direction = intervals.at(piece, (local + width / 2) / trajectory.widths[piece])
    row = np.arange(len(joint))
    dry = robot.motors.coulomb_effort(direction)[row, joint]
    friction = robot.motors.viscous_friction[joint] * velocity
    friction[-1] += dry
    # Both kinds are against the same direction.
    unsure = robot.motors.friction_uncertainty * direction[row, joint] * friction
    effort[-1] += dry
    error = smooth.error[interval, joint]
    return DirectedEfforts(joint, start, width, position, velocity, effort, unsure, error)


def _instants(
    robot: RobotModel, trajectory: JointTrajectory, intervals: MonotoneIntervals, joints: IntArray
) -> SignChanges:
    """Return the instants at which joints reverse or pass corners of their effort limits."""
    inside = intervals.start > 0
    instants = [(intervals.joint[inside], intervals.piece[inside], intervals.start[inside])]
    for table in robot.limits.effort_ranges:
        beyond = np.repeat(trajectory.coefficients[:, :, [table.joint]], len(table.position), 2)
        beyond[-1] -= table.position
        passed = sign_changes(beyond, trajectory.widths)
        instants.append((np.full(len(passed.piece), table.joint), passed.piece, passed.fraction))
    joint, piece, fraction = (np.concatenate(column) for column in zip(*instants, strict=True))
    counts = np.isin(joint, joints)
    return SignChanges(joint[counts], piece[counts], fraction[counts])


def _parts(
    trajectory: JointTrajectory, smooth: Enclosure, instants: SignChanges, joints: IntArray
) -> _Parts:
    """Return every interval for each joint, cut at the joint's instants."""
    begin, widths = trajectory.breakpoints, trajectory.widths
    pieces = np.searchsorted(begin, smooth.start + smooth.width / 2, side="right") - 1
    count = len(pieces)
    position = pieces + (smooth.start - begin[pieces]) / widths[pieces]
    cut = np.searchsorted(position, instants.piece + instants.fraction, side="right") - 1
    time = begin[instants.piece] + widths[instants.piece] * instants.fraction
    fraction = np.clip((time - smooth.start[cut]) / smooth.width[cut], 0.0, 1.0)
    joint = np.append(np.repeat(joints, count), instants.column)
    interval = np.append(np.tile(np.arange(count), len(joints)), cut)
    start = np.append(np.zeros(len(joints) * count), fraction)
    order = np.lexsort((start, interval, joint))
    joint, interval, start = joint[order], interval[order], start[order]
    is_last = np.append((np.diff(interval) != 0) | (np.diff(joint) != 0), True)
    end = np.where(is_last, 1.0, np.roll(start, -1))
    return _Parts(joint, interval, pieces[interval], start, end)


def _on(rows: FloatArray, start: FloatArray, width: FloatArray) -> FloatArray:
    """Return polynomials (degree+1, R) on intervals, of times from 0 to 1."""
    return restricted(rows[:, :, None], start, width)[:, :, 0]
