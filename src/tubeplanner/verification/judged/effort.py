"""Effort limits."""

import numpy as np

from tubeplanner.outcome import Place
from tubeplanner.trajectory.bernstein import peak_magnitudes
from tubeplanner.verification.enclosed_efforts import enclosed_efforts
from tubeplanner.verification.judged_condition import (
    FOR_ALL_TIMES,
    RELATIVE,
    JudgedCondition,
    not_required,
    undecided,
)
from tubeplanner.verification.judged_motion import JudgedMotion

# How closely efforts are enclosed, as a share of their limits: tighter than the certificate's
# tolerance, so that the planner may use most of it.
_EFFORT_ENCLOSURE = 1e-8


def judge_effort(motion: JudgedMotion) -> JudgedCondition:
    """Judge the effort limits, by polynomials that enclose the efforts."""
    limit = motion.robot.limits.effort
    bounded = np.flatnonzero(np.isfinite(limit))
    if len(bounded) == 0:
        return not_required(RELATIVE, "no joint has this limit")
    efforts = enclosed_efforts(motion.robot, motion.trajectory, _EFFORT_ENCLOSURE * limit)
    used = efforts.coefficients[:, :, bounded] / limit[bounded]
    error = efforts.error[:, bounded].max(axis=0) / limit[bounded]
    peaks = peak_magnitudes(used, np.ones_like(efforts.width))
    above = peaks.value + error
    worst = int(above.argmax())
    interval = peaks.piece[worst]
    time = efforts.start[interval] + peaks.local_time[worst] * efforts.width[interval]
    coverage = FOR_ALL_TIMES
    if error[worst] > _EFFORT_ENCLOSURE:
        coverage = undecided(1 - float(peaks.value[worst]), RELATIVE)
    place = Place(time=float(time), joint=motion.robot.joint_names[bounded[worst]])
    return JudgedCondition(1 - float(above[worst]), RELATIVE, place, coverage)
