"""Conditions on efforts: limits, torque-speed lines, rates."""

from dataclasses import dataclass, replace

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray, IntArray
from tubeplanner.certificate.enclosed_quantities import enclosed_effort_rates
from tubeplanner.certificate.enclosure import Enclosure
from tubeplanner.certificate.joint_conditions import NOT_LIMITED
from tubeplanner.certificate.judged_motion import (
    EFFORT_ENCLOSURE,
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    JudgedMotion,
    not_required,
    undecided,
)
from tubeplanner.outcome import Location
from tubeplanner.robot.model import RobotModel
from tubeplanner.trajectory.joint_trajectory import JointTrajectory
from tubeplanner.trajectory.parts import MonotoneIntervals, SignChanges, sign_changes
from tubeplanner.trajectory.polynomials import maxima, peak_magnitudes, restricted


def judge_effort(motion: JudgedMotion) -> JudgedCondition:
    """Judge the effort limits, by polynomials that enclose the efforts.

    Margins are relative to the largest effort limit of a joint at any position in any direction.
    Where a joint reverses, efforts on both sides count; at start and goal, on the side of the
    motion.
    """
    limit = motion.robot.limits.effort
    if not np.isfinite(limit).any():
        return NOT_LIMITED
    motors = motion.robot.motors
    directed = (motors.backwards_friction > 0) | (motors.forwards_friction > 0)
    if motors.friction_uncertainty > 0:
        directed |= motors.viscous_friction > 0
    directed[[table.joint for table in motion.robot.limits.effort_ranges]] = True
    directed &= np.isfinite(limit)
    plain, judged = np.where(directed, np.inf, limit), []
    if np.isfinite(plain).any():
        judged.append(judged_peak(motion, motion.smooth_efforts, plain, EFFORT_ENCLOSURE))
    if directed.any():
        efforts = directed_efforts(motion, np.flatnonzero(directed))
        excess = [
            efforts.most(sign) - _effort_allowed(motion.robot, efforts, sign)
            for sign in (1.0, -1.0)
        ]
        judged.append(judged_both_ways(motion, efforts, np.array(excess), limit[efforts.joint]))
    return min(judged, key=lambda each: each.margin or 0.0)


def _effort_allowed(robot: RobotModel, efforts: "DirectedEfforts", sign: float) -> FloatArray:
    """Return the limits in one direction as polynomials, (N, R)."""
    allowed = np.zeros_like(efforts.effort)
    allowed[-1] = robot.limits.effort[efforts.joint]
    halves = 0.5 ** np.arange(len(allowed) - 1, -1, -1)
    middle = halves @ efforts.position
    for table in robot.limits.effort_ranges:
        rows = np.flatnonzero(efforts.joint == table.joint)
        q = middle[rows]
        allowed[:, rows] = table.slope(q, sign) * efforts.position[:, rows]
        allowed[-1, rows] += table.allowed(q, sign) - table.slope(q, sign) * q
    return allowed


def judge_motor_curve(motion: JudgedMotion) -> JudgedCondition:
    """Judge the torque-speed lines, by polynomials that enclose the efforts.

    Margins are relative to the saturation efforts. Both directions count: a motor that brakes has
    more than its saturation effort.
    """
    motors = motion.robot.motors
    if not motors.has_curve.any():
        return not_required(RELATIVE, "no motor has a torque-speed line")
    efforts = directed_efforts(motion, np.flatnonzero(motors.has_curve))
    saturation = motors.saturation_effort[efforts.joint]
    lost = saturation / motors.no_load_velocity[efforts.joint] * efforts.velocity
    excess = np.array([efforts.most(sign) + sign * lost for sign in (1.0, -1.0)])
    excess[:, -1] -= saturation
    return judged_both_ways(motion, efforts, excess, saturation)


def judged_both_ways(
    motion: JudgedMotion, efforts: "DirectedEfforts", excess: FloatArray, unit: FloatArray
) -> JudgedCondition:
    """Judge efforts against the allowed efforts, forwards and backwards.

    Args:
        motion: The motion.
        efforts: Its efforts on R intervals.
        excess: Excess over the allowed efforts forwards and backwards, errors included: polynomials
            as those of `efforts`, shape (2, N, R) [N m or N].
        unit: The efforts that margins are relative to, shape (R,) [N m or N].
    """
    used = excess / unit
    used[:, -1] += 1.0  # `maxima` resolves fractions of the value, which must not be 0
    rows = np.concatenate(list(used), axis=1)[:, :, None]
    peak = maxima(rows, np.ones(rows.shape[1]))
    worst = int(peak.piece[0]) % len(unit)
    margin, error = 1 - float(peak.value[0]), float(efforts.error[worst] / unit[worst])
    coverage = FOR_ALL_TIMES
    if error > EFFORT_ENCLOSURE:
        coverage = undecided(margin + error, RELATIVE)
    time = efforts.start[worst] + peak.local_time[0] * efforts.width[worst]
    location = Location(time=float(time), joint=motion.robot.joint_names[efforts.joint[worst]])
    return JudgedCondition(margin, RELATIVE, location, coverage)


# ---- Rates of the efforts, inside pieces.

# Error of enclosed rates, as a fraction of their limits: tighter than the certificate's tolerance,
# so that the planner may use most of that.
_RATE_ENCLOSURE = 1e-8


def judge_effort_rate(motion: JudgedMotion) -> JudgedCondition:
    """Judge the rates of the efforts inside all pieces, by polynomials that enclose the rates.

    Jumps of efforts at breakpoints are left to the continuity condition. Coulomb friction jumps
    where joints reverse, whatever the motion: the coverage says how often and how far.
    """
    limit = motion.robot.limits.effort_rate
    if not np.isfinite(limit).any():
        return NOT_LIMITED
    rates = enclosed_effort_rates(motion.robot, motion.trajectory, _RATE_ENCLOSURE * limit)
    judged = judged_peak(motion, rates, limit, _RATE_ENCLOSURE)
    jumps = friction_jumps(motion, np.isfinite(limit))
    return replace(judged, coverage=f"{judged.coverage}; {jumps}") if jumps else judged


def judged_peak(
    motion: JudgedMotion, quantity: Enclosure, limit: FloatArray, closeness: float
) -> JudgedCondition:
    """Judge the magnitudes of a quantity of every joint against limits.

    Args:
        motion: The motion.
        quantity: The quantity of its joints, c = n.
        limit: Shape (n,), infinite where there is none, but not everywhere.
        closeness: Largest error, as a fraction of the limit, of a decided condition.
    """
    bounded = np.flatnonzero(np.isfinite(limit))
    used = quantity.coefficients[:, :, bounded] / limit[bounded]
    error = quantity.error[:, bounded].max(axis=0) / limit[bounded]
    peaks = peak_magnitudes(used, np.ones_like(quantity.width))
    above = peaks.value + error
    worst = int(above.argmax())
    interval = peaks.piece[worst]
    time = quantity.start[interval] + peaks.local_time[worst] * quantity.width[interval]
    coverage = FOR_ALL_TIMES
    if error[worst] > closeness:
        coverage = undecided(1 - float(peaks.value[worst]), RELATIVE)
    location = Location(time=float(time), joint=motion.robot.joint_names[bounded[worst]])
    return JudgedCondition(1 - float(above[worst]), RELATIVE, location, coverage)


def friction_jumps(motion: JudgedMotion, joints: BoolArray) -> str:
    """Return a sentence with number, size and place of friction's jumps; empty without friction.

    Args:
        motion: The motion.
        joints: True for joints whose friction counts, shape (n,).
    """
    robot, trajectory, intervals = motion.robot, motion.trajectory, motion.intervals
    motors = robot.motors
    jump = motors.backwards_friction + motors.forwards_friction
    jump = np.where(joints, jump * (1 + motors.friction_uncertainty), 0.0)
    if not jump.any():
        return ""
    moving = np.flatnonzero(intervals.direction)
    before, after = moving[:-1], moving[1:]
    reverses = intervals.direction[before] != intervals.direction[after]
    reverses &= intervals.joint[before] == intervals.joint[after]
    at = after[reverses & (jump[intervals.joint[after]] > 0)]
    if len(at) == 0:
        return "Coulomb friction does not jump: no joint reverses"
    worst = at[jump[intervals.joint[at]].argmax()]
    joint, piece = intervals.joint[worst], intervals.piece[worst]
    time = trajectory.breakpoints[piece] + intervals.start[worst] * trajectory.widths[piece]
    unit = "N m" if robot.revolute[joint] else "N"
    location = Location(time=float(time), joint=robot.joint_names[joint])
    return (
        f"Coulomb friction, which is apart, jumps at {len(at)} reversal{'s'[: len(at) > 1]}, by "
        f"at most {jump[joint]:.3g} {unit} ({location})"
    )


# ---- Efforts over intervals without reversal, Coulomb friction included, as polynomials.


@dataclass(frozen=True, eq=False)
class DirectedEfforts:
    """R intervals, each of a joint that moves without reversal and passes no corner of a table.

    Polynomials of a time that runs from 0 to 1 over each interval, highest power first, (N, R). At
    a reversal one interval ends and the next begins, so that both one-sided limits are covered.
    """

    joint: IntArray  # index of the joint, shape (R,)
    start: FloatArray  # shape (R,) [s]
    width: FloatArray  # shape (R,) [s]
    position: FloatArray  # of the joint [rad or m]
    velocity: FloatArray  # of the joint [rad/s or m/s]
    effort: FloatArray  # with nominal friction [N m or N]
    unsure: FloatArray  # uncertainty of the effort by that of friction, never negative [N m or N]
    # bound on the distance of the effort from its polynomial, shape (R,) [N m or N]
    error: FloatArray

    def most(self, sign: float) -> FloatArray:
        """Return upper bounds on the effort forwards (1) or backwards (-1), polynomials (N, R)."""
        most = sign * self.effort + self.unsure
        most[-1] += self.error
        return most


@dataclass(frozen=True, eq=False)
class _Parts:
    """R parts of an enclosure's intervals, shape (R,) each."""

    joint: IntArray  # index of the joint
    interval: IntArray  # index of the enclosure's interval
    piece: IntArray  # index of the trajectory's piece
    start: FloatArray  # start of the part in the interval, from 0 to 1
    end: FloatArray  # end of the part in the interval, from 0 to 1


def directed_efforts(motion: JudgedMotion, joints: IntArray) -> DirectedEfforts:
    """Return the efforts of some joints of a motion, indices of shape (k,)."""
    robot, trajectory, intervals = motion.robot, motion.trajectory, motion.intervals
    smooth = motion.smooth_efforts
    parts = _parts(trajectory, smooth, _instants(robot, trajectory, intervals, joints), joints)
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
