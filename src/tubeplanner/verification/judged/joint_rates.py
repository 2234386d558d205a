"""Limits on velocity, acceleration and jerk of the joints."""

import numpy as np

from tubeplanner.arrays import FloatArray
from tubeplanner.outcome import Place
from tubeplanner.trajectory.bernstein import peak_magnitudes
from tubeplanner.verification.joint_extremes import highest
from tubeplanner.verification.judged.velocity_by_position import velocity_by_position_left
from tubeplanner.verification.judged_condition import (
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    not_required,
)
from tubeplanner.verification.judged_motion import JudgedMotion


def judge_velocity(motion: JudgedMotion) -> JudgedCondition:
    """Judge the velocity limits, exactly, and those that depend on positions."""
    constant = _judge_derivative(motion, 1, motion.robot.limits.velocity)
    by_position = velocity_by_position_left(motion)
    asked = [each for each in (constant, by_position) if each.margin is not None]
    return min(asked, key=lambda each: each.margin or 0.0, default=constant)


def judge_acceleration(motion: JudgedMotion) -> JudgedCondition:
    """Judge the acceleration limits, exactly."""
    return _judge_derivative(motion, 2, motion.robot.limits.acceleration)


def judge_jerk(motion: JudgedMotion) -> JudgedCondition:
    """Judge the jerk limits, exactly."""
    return _judge_derivative(motion, 3, motion.robot.limits.jerk)


def _judge_derivative(motion: JudgedMotion, order: int, limit: FloatArray) -> JudgedCondition:
    """Judge a derivative of the positions against limits (n,), infinite where there is none."""
    bounded = np.flatnonzero(np.isfinite(limit))
    if len(bounded) == 0:
        return not_required(RELATIVE, "no joint has this limit")
    trajectory = motion.trajectory
    used = trajectory.derivative_coefficients(order)[:, :, bounded] / limit[bounded]
    peak = highest(peak_magnitudes(used, trajectory.widths), trajectory)
    place = Place(time=peak.time, joint=motion.robot.joint_names[bounded[peak.column]])
    return JudgedCondition(1 - peak.value, RELATIVE, place, FOR_ALL_TIMES)
