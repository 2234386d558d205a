"""Effort limits."""

import numpy as np

from tubeplanner.verification.enclosed_efforts import enclosed_efforts
from tubeplanner.verification.enclosed_peak import judged_peak
from tubeplanner.verification.judged_condition import RELATIVE, JudgedCondition, not_required
from tubeplanner.verification.judged_motion import JudgedMotion

# How closely efforts are enclosed, as a share of their limits: tighter than the certificate's
# tolerance, so that the planner may use most of it.
_EFFORT_ENCLOSURE = 1e-8


def judge_effort(motion: JudgedMotion) -> JudgedCondition:
    """Judge the effort limits, by polynomials that enclose the efforts."""
    limit = motion.robot.limits.effort
    if not np.isfinite(limit).any():
        return not_required(RELATIVE, "no joint has this limit")
    efforts = enclosed_efforts(motion.robot, motion.trajectory, _EFFORT_ENCLOSURE * limit)
    return judged_peak(motion, efforts, limit, _EFFORT_ENCLOSURE)
