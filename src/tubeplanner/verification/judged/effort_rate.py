"""Limits on how fast the efforts change."""

from dataclasses import replace

import numpy as np

from tubeplanner.verification.enclosed_efforts import enclosed_effort_rates
from tubeplanner.verification.enclosed_peak import judged_peak
from tubeplanner.verification.friction_jumps import friction_jumps
from tubeplanner.verification.judged_condition import RELATIVE, JudgedCondition, not_required
from tubeplanner.verification.judged_motion import JudgedMotion

# How closely the rates are enclosed, as a share of their limits: tighter than the certificate's
# tolerance, so that the planner may use most of it.
_RATE_ENCLOSURE = 1e-8


def judge_effort_rate(motion: JudgedMotion) -> JudgedCondition:
    """Judge the rates of the efforts inside all pieces, by polynomials that enclose them.

    Where efforts jump, at breakpoints, that is the continuity's to judge. Coulomb friction jumps
    where joints reverse, whatever the motion: the coverage says how often and how far.
    """
    limit = motion.robot.limits.effort_rate
    if not np.isfinite(limit).any():
        return not_required(RELATIVE, "no joint has this limit")
    rates = enclosed_effort_rates(motion.robot, motion.trajectory, _RATE_ENCLOSURE * limit)
    judged = judged_peak(motion, rates, limit, _RATE_ENCLOSURE)
    jumps = friction_jumps(motion, np.isfinite(limit))
    return replace(judged, coverage=f"{judged.coverage}; {jumps}") if jumps else judged
