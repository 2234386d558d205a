"""Conditions on efforts: limits, torque-speed lines, rates."""

from dataclasses import replace

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.certificate.directed_efforts import DirectedEfforts
from tubeplanner.certificate.enclosed_quantities import enclosed_effort_rates
from tubeplanner.certificate.enclosure import Enclosure
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
from tubeplanner.trajectory.polynomials import maxima, peak_magnitudes


def judge_effort(motion: JudgedMotion) -> JudgedCondition:
    """Judge the effort limits, by polynomials that enclose the efforts.

    Margins are relative to the largest effort limit of a joint at any position in any direction.
    Where a joint reverses, efforts on both sides count; at start and goal, on the side of the
    motion.
    """
    limit = motion.robot.limits.effort
    if not np.isfinite(limit).any():
        return not_required(RELATIVE, "no joint has this limit")
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
        efforts = motion.efforts_of(np.flatnonzero(directed))
        excess = [
            efforts.most(sign) - _effort_allowed(motion.robot, efforts, sign)
            for sign in (1.0, -1.0)
        ]
        judged.append(judged_both_ways(motion, efforts, np.array(excess), limit[efforts.joint]))
    return min(judged, key=lambda each: each.margin or 0.0)


def _effort_allowed(robot: RobotModel, efforts: DirectedEfforts, sign: float) -> FloatArray:
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
    efforts = motion.efforts_of(np.flatnonzero(motors.has_curve))
    saturation = motors.saturation_effort[efforts.joint]
    lost = saturation / motors.no_load_velocity[efforts.joint] * efforts.velocity
    excess = np.array([efforts.most(sign) + sign * lost for sign in (1.0, -1.0)])
    excess[:, -1] -= saturation
    return judged_both_ways(motion, efforts, excess, saturation)


def judged_both_ways(
    motion: JudgedMotion, efforts: DirectedEfforts, excess: FloatArray, unit: FloatArray
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
        return not_required(RELATIVE, "no joint has this limit")
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
