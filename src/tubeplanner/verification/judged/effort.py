"""Effort limits."""

import numpy as np

from tubeplanner.arrays import BoolArray, FloatArray
from tubeplanner.robot.robot_model import RobotModel
from tubeplanner.verification.directed_efforts import DirectedEfforts
from tubeplanner.verification.directed_peak import judged_both_ways
from tubeplanner.verification.enclosed_peak import judged_peak
from tubeplanner.verification.judged_condition import RELATIVE, JudgedCondition, not_required
from tubeplanner.verification.judged_motion import EFFORT_ENCLOSURE, JudgedMotion


def judge_effort(motion: JudgedMotion) -> JudgedCondition:
    """Judge the effort limits, by polynomials that enclose the efforts.

    Margins are relative to the most that a joint has anywhere and in any direction. Where it
    reverses, what it needs on either side counts; at the start and the goal, on the side of the
    motion.
    """
    limit = motion.robot.limits.effort
    if not np.isfinite(limit).any():
        return not_required(RELATIVE, "no joint has this limit")
    directed = _depends_on_direction(motion.robot) & np.isfinite(limit)
    plain, asked = np.where(directed, np.inf, limit), []
    if np.isfinite(plain).any():
        asked.append(judged_peak(motion, motion.smooth_efforts, plain, EFFORT_ENCLOSURE))
    if directed.any():
        asked.append(_judge_directed(motion, directed))
    return min(asked, key=lambda each: each.margin or 0.0)


def _depends_on_direction(robot: RobotModel) -> BoolArray:
    """Return which joints have more than a smooth effort and one limit, shape (n,)."""
    motors = robot.motors
    found = (motors.backwards_friction > 0) | (motors.forwards_friction > 0)
    if motors.friction_uncertainty > 0:
        found |= motors.viscous_friction > 0
    found[[table.joint for table in robot.limits.effort_ranges]] = True
    return found


def _judge_directed(motion: JudgedMotion, which: BoolArray) -> JudgedCondition:
    efforts = motion.efforts_of(np.flatnonzero(which))
    excess = [
        efforts.most(way) - _effort_allowed(motion.robot, efforts, way) for way in (1.0, -1.0)
    ]
    unit = motion.robot.limits.effort[efforts.joint]
    return judged_both_ways(motion, efforts, np.array(excess), unit)


def _effort_allowed(robot: RobotModel, efforts: DirectedEfforts, way: float) -> FloatArray:
    """Return the limits in one direction as polynomials, (N, R)."""
    allowed = np.zeros_like(efforts.effort)
    allowed[-1] = robot.limits.effort[efforts.joint]
    halves = 0.5 ** np.arange(len(allowed) - 1, -1, -1)
    middle = halves @ efforts.position
    for table in robot.limits.effort_ranges:
        rows = np.flatnonzero(efforts.joint == table.joint)
        q = middle[rows]
        allowed[:, rows] = table.slope(q, way) * efforts.position[:, rows]
        allowed[-1, rows] += table.allowed(q, way) - table.slope(q, way) * q
    return allowed
