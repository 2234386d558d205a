"""Velocity limits that fall towards the ends of joints' ranges, exactly.

Towards an end at a distance g, a joint's velocity v keeps v <= max(0, sqrt(2 d g) - o). What that
leaves is the larger one of two concave functions of g and v, sqrt(2 d g) - o - v and -v. On a piece
of a polynomial both are polynomials of time, g and v lie in the hull of their Bernstein
coefficients, and each function is nowhere less than at the worst of these.
"""

from dataclasses import dataclass

import numpy as np

from tubeplanner.arrays import FloatArray, IntArray
from tubeplanner.outcome import Place
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.trajectory.bernstein import bernstein_coefficients, halves
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.verification.judged_condition import (
    RELATIVE,
    JudgedCondition,
    bracketed,
    not_required,
)
from tubeplanner.verification.judged_motion import JudgedMotion

_RESOLUTION = 1e-9  # of the largest velocity
_MIN_WIDTH = 2.0**-40  # of a piece
_MAX_ROWS = 1_000_000


@dataclass(frozen=True, eq=False)
class _Approaches:
    """Motions of joints towards an end of their range, A of them: upwards, then downwards.

    Attributes:
        joint: Shape (A,).
        deceleration: Shape (A,) [rad/s^2 or m/s^2].
        offset: Shape (A,) [rad/s or m/s].
        largest: What margins are relative to, shape (A,) [rad/s or m/s].
        distance: From the end, as polynomials (degree+1, pieces, A) [rad or m].
        velocity: Towards the end, likewise, of the same degree [rad/s or m/s].
    """

    joint: IntArray
    deceleration: FloatArray
    offset: FloatArray
    largest: FloatArray
    distance: FloatArray
    velocity: FloatArray

    def left(
        self, distance: FloatArray, velocity: FloatArray, which: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return both functions as shares, (K, R), of approaches (R,); -inf beyond the end."""
        with np.errstate(invalid="ignore"):
            root = np.sqrt(2 * self.deceleration[which] * distance) - self.offset[which]
        near = np.where(distance >= 0, root - velocity, -np.inf)
        return near / self.largest[which], -velocity / self.largest[which]


def velocity_by_position_left(motion: JudgedMotion) -> JudgedCondition:
    """Judge the velocity limits that depend on positions, for all t.

    Margins are relative to the joint's velocity limit or, where it has none, to the velocity from
    which it would stop over its whole range.
    """
    if not motion.robot.limits.velocity_by_position:
        return not_required(RELATIVE, "no joint has such a limit")
    trajectory = motion.trajectory
    approaches = _approaches(motion.robot, trajectory)
    lower_bound, attained, time, which = _least_left(approaches, trajectory)
    joint = motion.robot.joint_names[approaches.joint[which]]
    return bracketed(lower_bound, attained, RELATIVE, Place(time=time, joint=joint))


def _approaches(robot: RobotModel, trajectory: JointTrajectory) -> _Approaches:
    laws = robot.limits.velocity_by_position
    joint = np.array([law.joint for law in laws])
    deceleration = np.array([law.deceleration for law in laws])
    span = np.array([law.upper - law.lower for law in laws])
    limit = robot.limits.velocity[joint]
    largest = np.where(np.isfinite(limit), limit, np.sqrt(2 * deceleration * span))
    position = trajectory.coefficients[:, :, joint]
    velocity = np.zeros_like(position)
    velocity[1:] = trajectory.derivative_coefficients(1)[:, :, joint]
    to_upper, to_lower = -position, position.copy()
    to_upper[-1] += [law.upper for law in laws]
    to_lower[-1] -= [law.lower for law in laws]
    return _Approaches(
        np.tile(joint, 2),
        np.tile(deceleration, 2),
        np.tile([law.offset for law in laws], 2),
        np.tile(largest, 2),
        np.concatenate([to_upper, to_lower], axis=2),
        np.concatenate([velocity, -velocity], axis=2),
    )


def _least_left(
    approaches: _Approaches, trajectory: JointTrajectory
) -> tuple[float, float, float, int]:
    """Return a lower bound on the least margin, one that is attained, when [s], and whose it is."""
    pieces, count = approaches.distance.shape[1:]
    piece, which = np.repeat(np.arange(pieces), count), np.tile(np.arange(count), pieces)
    start, width = np.zeros(len(piece)), trajectory.widths[piece]
    smallest = _MIN_WIDTH * trajectory.widths.min()
    lower_bound, attained, time, worst, rows = np.inf, np.inf, 0.0, 0, 0
    while len(piece):
        rows += len(piece)
        near, away = approaches.left(
            _hull(approaches.distance[:, piece, which], start, width),
            _hull(approaches.velocity[:, piece, which], start, width),
            which,
        )
        ends = np.maximum(near, away)[[0, -1]]
        end, row = np.unravel_index(int(ends.argmin()), ends.shape)
        if ends[end, row] < attained:
            attained, worst = float(ends[end, row]), int(which[row])
            local = start[row] + (width[row] if end else 0.0)
            time = float(trajectory.breakpoints[piece[row]] + local)
        lower = np.maximum(near.min(axis=0), away.min(axis=0))
        split = (lower < attained - _RESOLUTION) & (width > smallest) & (rows < _MAX_ROWS)
        lower_bound = min(lower_bound, float(lower[~split].min(initial=np.inf)))
        piece, which = np.repeat(piece[split], 2), np.repeat(which[split], 2)
        start, width = halves(start[split], width[split])
    return lower_bound, attained, time, worst


def _hull(rows: FloatArray, start: FloatArray, width: FloatArray) -> FloatArray:
    """Return the Bernstein coefficients of R polynomials (degree+1, R) on intervals."""
    return bernstein_coefficients(rows[:, :, None], start, width)[:, :, 0]
